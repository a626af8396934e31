// Sections that are not met at their instants: how much the instants scatter, and what that does to the HTFs.
#pragma once

#include "hal/record.hpp"
#include "identification.hpp"

namespace saltus {

struct TimingJitter {
  double seconds = 0.0;  // [s] standard deviation of the instants at which outputs are taken
  double sigma = 0.0;    // [s] its standard error; grows with what the two causes below leave unexplained
  bool found = false;    // its square is above zero by three standard errors
};

// From repeats of a periodic stimulus. An output taken late by d is off by its rate times d: where the cycle moves fast
// it scatters more between repeats. The variance of each section is that of the sensor, alike at all, plus the square
// of the rate times that of the instants, alike at all sections and for all outputs: weighted least squares. Rates are
// those of the mean cycle; sections beside a kink of it, where its Fourier series and its differences disagree, are
// left out. Nothing is found in a record that is not paced by a clock of known period, or that has no repeats.
TimingJitter estimate_jitter(const Record& record);

// An output at frequency w taken at instants that scatter by s shrinks to exp(-w^2 s^2 / 2) of itself on average.
// Undoes that, in the standard errors too; w is the frequency of the output, `cycle_period` in [s]. For outputs that
// are smooth from section to section. One whose rate the input drives at once, a velocity, has a corner wherever the
// input steps: how the two sides of the corner are met decides its bias, which near half the sections a cycle may even
// vanish.
void correct_jitter(Identification& id, double seconds, double cycle_period);

}  // namespace saltus
