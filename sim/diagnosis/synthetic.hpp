// Records made by a machine with known effects, for calibration and tests: the same experiment as a real one
// (random-phase multisines on lines that share no residue class, settled, repeated, measured with noise), and the truth
// is known.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "hal/record.hpp"
#include "machine.hpp"

namespace saltus::diagnosis {

struct Campaign {
  int experiments = 7;  // the first without stimulus
  int repeats = 4;
  int period = 64;  // [cycle] of the stimulus
  int settle = 40;  // [cycle]
  int sections = 32;
  int tones = 14;
  double amplitude = 0.15;               // [unit of the input] of each tone
  std::vector<double> noise;             // (outputs) standard deviations
  double drop = 0.0;                     // [-] share of rows missing
  double outliers = 0.0;                 // [-] share of values far off
  std::vector<double> quantum;           // (outputs) steps of the sensors, empty or 0: none
  double colour = 0.0;                   // [-] correlation of the noise from section to section
  double process = 0.0;                  // [unit of the input] random force beside it, new in every section
  std::optional<std::uint64_t> stimuli;  // their seed, where they are to be the same in other noise
};

// The values of all coefficients of a machine, some of them changed by name ("k", "quadratic_drag@body"); false and
// nothing returned for a name it does not have.
bool values_with(const Machine& m, const std::vector<std::pair<std::string, double>>& changes,
                 std::vector<double>& values);

// Empty (no rows) when the machine does not survive the campaign.
Record synthesise(const Machine& m, const std::vector<double>& values, const Campaign& c, std::uint64_t seed);

}  // namespace saltus::diagnosis
