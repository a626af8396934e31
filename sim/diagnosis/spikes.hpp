// Single values far from what their neighbours say: a bit that flipped on the wire, an encoder that slipped a count.
#pragma once

#include <cstddef>
#include <vector>

#include "data.hpp"
#include "hal/record.hpp"

namespace saltus::diagnosis {

// Takes them out of a record's outputs, as missing, and says how many there were. Outputs in rad may jump by
// whole turns, which is no spike.
std::size_t take_out_spikes(Record& record);

// The same of what a model leaves of them, which is smooth where the record need not be: leaves out values whose
// residual is far from its neighbours', several of which may be outliers too. Returns how many there were.
// `residual`: one for each of `segments`, as long as its y.
std::size_t leave_out_far(Data& data, const std::vector<int>& segments, const std::vector<Eigen::VectorXd>& residual);

}  // namespace saltus::diagnosis
