// Fits where an impact of the machine and that of the record may lie on either side of a section. A sample between them
// is off by the whole jump, however little the impacts are apart: such samples outweigh all others, and no slope tells
// of which to mend first. Without those beside the record's impacts the cost has no such steps.
#pragma once

#include <optional>
#include <vector>

#include "fit.hpp"

namespace saltus::diagnosis {

// The data without the samples beside what jumps in them; nothing where nothing does.
std::optional<Data> without_jumps(const Data& data);

// Does a fit leave so much that impacts may be on the wrong side?
bool misses_far(const Problem& p, const std::vector<int>& segments, const Fit& f);

// As fit() does; and where that misses far, once more by way of the samples away from jumps. The better of the two.
Fit fit_past_events(const Problem& p, const std::vector<int>& segments, const Fit& from,
                    const std::vector<int>& effects);

}  // namespace saltus::diagnosis
