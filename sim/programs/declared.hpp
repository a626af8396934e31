// What is declared of a machine that a record is of: --set NAME=VALUE, or FILE, an earlier verdict.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../diagnosis/machine.hpp"

namespace saltus::program {

// Of what a value is asked: a tolerance belongs to a parameter, or to an effect of a machine without a clock.
enum class Sized { parameters, effects_too };

// The value of a parameter or an effect; UsageError for a name that the machine does not have.
double declared_value(const diagnosis::Machine& machine, const std::string& name, const std::string& option,
                      Sized sized = Sized::parameters);

// Parameters and effects by name, in the order given. `told`: says on standard output what comes from a verdict.
std::vector<std::pair<std::string, double>> declared(const std::vector<std::string>& settings,
                                                     const diagnosis::Machine& machine, bool told);

}  // namespace saltus::program
