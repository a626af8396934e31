// Multiple shooting: segments cut into short pieces, each with a start of its own, that are joined to ever longer ones.
// Along a whole segment an effect that changes the gait, or sets a foot to bouncing, makes a cost with many hollows;
// along a cycle it does not, and what is found there leads into the right one.
#pragma once

#include <limits>
#include <vector>

#include "fit.hpp"

namespace saltus::diagnosis {

// From a fit to the whole segments, paced by a clock, to values and starts near another one: pieces of one cycle, two,
// four. chi2 is infinite where the machine cannot follow, or where it comes to more than `hopeless` [-] on the way: it
// can but grow. Segments in `whole` are not cut: they are fitted already.
Fit fit_growing(const Problem& p, const std::vector<int>& segments, const Fit& from, const std::vector<int>& effects,
                double hopeless = std::numeric_limits<double>::infinity(), const std::vector<int>& whole = {});

// The value of an effect with a probe, a tenth to a hundred of it, at which runs of one cycle, then of two and four,
// started anew each, fit best with all else as it is; NaN where runs are lost at any value, or fit the better the less
// there is of it. Along a cycle there are no hollows that a coarse search would miss.
double scan(const Problem& p, const std::vector<int>& segments, const Fit& from, int effect);

}  // namespace saltus::diagnosis
