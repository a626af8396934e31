// Harmonic transfer functions from a record with any measured input: a chirp, a random binary sequence, whatever drove
// the machine.
#pragma once

#include <cstdint>
#include <vector>

#include "hal/record.hpp"
#include "identification.hpp"

namespace saltus {

struct AnyStimulusOptions {
  int count = 2;       // non-zero multipliers, 1 to 4
  int period = 64;     // [cycle] resolution of the lines at which the HTFs are given: f = line / period
  double band = 10.0;  // [cycles a cycle] lines strictly below
  int harmonics = 1;   // H_-harmonics ... H_harmonics
};

struct AnyStimulusFit {
  Identification id;  // sigma from the residual's scatter: without repeats there is no other noise
  std::vector<Complex> multipliers;
  std::vector<double> sigma;  // of the multipliers, sqrt(E |error|^2)
  double condition = 0.0;     // [-] of the worst section's regressors, columns scaled: above 1e6 the input
                              // leaves directions untold, and sigma is large where the input has no power
  std::vector<double> noise;  // [output unit] standard deviation of the residual, each output
  Status status = Status::failed;
};

// Exactly the form of a linear periodic system: section n of every cycle obeys
//   y[cN + n] + a_1 y[(c-1)N + n] + ... = sum_j b_n[j] u[cN + n - j],  0 < j < (count + 1) N,
// with one A for all sections and outputs (see ImagePoleFit). Least squares on the output itself, b_n, the mean cycle
// and the decay of the start of each experiment projected out section by section (variable projection), so neither
// periodicity nor settling is asked for; the noise is taken as white. Throws RecordError where the record is not paced
// by a clock, has no known single input, or too few cycles.
AnyStimulusFit identify_any_stimulus(const Record& record, const AnyStimulusOptions& options = {});

// A cosine that sweeps from 0 to `band` [cycles a cycle] in a fifth of the experiment, and again; `cycles` long, one
// value a section.
std::vector<double> chirp_input(std::int64_t cycles, int sections, double band, double amplitude);

// A maximal-length binary sequence of 2^23 - 1 sections, plus and minus `amplitude`, from a place that the seed
// chooses.
std::vector<double> binary_input(std::int64_t cycles, int sections, double amplitude, std::uint64_t seed);

}  // namespace saltus
