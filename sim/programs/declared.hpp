// What is declared of a machine that a record is of: --set NAME=VALUE, or FILE, an earlier verdict.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../diagnosis/machine.hpp"

namespace saltus::program {

// The value of a parameter, or of an effect of a machine without a clock; UsageError for a name that it does not have.
double declared_value(const diagnosis::Machine& machine, const std::string& name, const std::string& option);

// Parameters and effects by name, in the order given. `told`: says on standard output what comes from a verdict.
std::vector<std::pair<std::string, double>> declared(const std::vector<std::string>& settings,
                                                     const diagnosis::Machine& machine, bool told);

}  // namespace saltus::program
