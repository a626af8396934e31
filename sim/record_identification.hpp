// Harmonic transfer functions from a measured, clock-paced record.
#pragma once

#include "hal/record.hpp"
#include "identification.hpp"

namespace saltus {

// Estimates H_-harmonics ... H_harmonics at every line the record excites, from all whole stimulus periods after the
// settling cycles; standard errors from their scatter. Tones that answer on each other's lines are left out, and said
// so in the notes. Throws RecordError when the record is not paced by a clock, has no stimulus period or none that is
// whole, has more than one input, an input that is unknown or does not repeat, excites nothing, or does not measure an
// output at all.
Identification identify_record(const Record& record, int harmonics);

}  // namespace saltus
