// The multipliers of a model's limit cycle, for whoever compares.
#pragma once

#include <vector>

#include "core/linalg.hpp"
#include "program.hpp"

namespace saltus::program {

// Non-zero ones, as `saltus orbit` finds them; throws RunError where there is no limit cycle.
std::vector<Complex> orbit_multipliers(const ModelChoice& model);

}  // namespace saltus::program
