// From a record and a machine to a problem that can be fitted: starting guesses, and steps fine enough.
#pragma once

#include "fit.hpp"

namespace saltus::diagnosis {

// Guesses every segment's start from the model's own orbit, and how far off the guess may be. Throws RecordError when
// the declared model has no orbit to compare with.
void guess_starts(const Problem& p, Data& data, const std::string& record);

// Starts every segment where a machine of these values would be had only the segment's own history disturbed it: after
// a change that moves the orbit far, or to another gait. False, and nothing changed, where it has no orbit.
bool settle_starts(const Problem& p, Fit& f);

// The longest step, at the values of a fit, whose error no measurement of the record would notice: `trifle` [-] of chi
// squared.
double choose_step(const Problem& p, const Fit& f, double trifle = 0.05);

// The same where the step that is taken was chosen for other values and its error is noticed at these; else that one.
double finer_step(const Problem& p, const Fit& f);

}  // namespace saltus::diagnosis
