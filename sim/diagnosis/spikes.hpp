// Single values far from what their neighbours say: a bit that flipped on the wire, an encoder that slipped a count.
#pragma once

#include <cstddef>

#include "hal/record.hpp"

namespace saltus::diagnosis {

// Takes them out of a record's outputs, as missing, and says how many there were. Outputs in rad may jump by
// whole turns, which is no spike.
std::size_t take_out_spikes(Record& record);

}  // namespace saltus::diagnosis
