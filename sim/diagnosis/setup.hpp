// From a record and a machine to a problem that can be fitted: starting guesses, and steps fine enough.
#pragma once

#include "fit.hpp"

namespace saltus::diagnosis {

// Guesses every segment's start from the model's own orbit, and how far off the guess may be. Throws RecordError when
// the declared model has no orbit to compare with.
void guess_starts(const Problem& p, Data& data, const std::string& record);

// The longest step whose error no measurement of the record would notice.
double choose_step(const Problem& p);

}  // namespace saltus::diagnosis
