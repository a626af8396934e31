// Multiple shooting: segments cut into short pieces, each with a start of its own, then into ever longer ones. Along a
// whole segment an effect that changes the gait, or sets a foot to bouncing, makes a cost with many hollows; along a
// cycle it does not, and what is found there leads into the right one.
#pragma once

#include <limits>
#include <vector>

#include "fit.hpp"

namespace saltus::diagnosis {

// From a fit to the whole segments, paced by a clock, to values and starts near another one: pieces of one cycle, two,
// four, as long as the machine can follow them. chi2 is infinite where it cannot follow the shortest, or where it comes
// to more than `hopeless` [-] on the way: it can but grow.
Fit fit_growing(const Problem& p, const std::vector<int>& segments, const Fit& from, const std::vector<int>& effects,
                const FitOptions& options = {}, double hopeless = std::numeric_limits<double>::infinity());

}  // namespace saltus::diagnosis
