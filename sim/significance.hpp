// Which harmonics are there at all, decided by test.
#pragma once

#include <vector>

#include "identification.hpp"

namespace saltus {

struct HarmonicTest {
  int m = 0, output = 0;
  int lines = 0;
  double norm = 0.0;         // root of the mean of |H_m|^2 over the lines, noise taken off [output unit / input unit]
  double mean_square = 0.0;  // of |H_m| / sigma: 1 for noise alone
  double chance = 1.0;       // probability of that or more from noise alone
  bool significant = false;  // chance below the level shared among all tests (Bonferroni)
};

// One test for each harmonic and output, by m and then output. Empty where the standard errors are not known.
std::vector<HarmonicTest> test_harmonics(const Identification& id, double level = 0.001);

}  // namespace saltus
