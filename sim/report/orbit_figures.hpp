// The picture of a limit cycle: phase portrait with its events as in Figs. 1 and 3 of Wendel & Ames 2010, the
// multipliers in the unit circle with their errors, and the singular values that the ranks were read from.
#pragma once

#include "../orbit_report.hpp"
#include "plot.hpp"

namespace saltus {

Figure orbit_figure(const OrbitReport& report);

}  // namespace saltus
