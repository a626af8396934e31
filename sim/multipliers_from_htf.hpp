// Floquet multipliers from identified fundamental harmonic transfer functions (Ankarali & Cowan 2014, VI.C.3).
#pragma once

#include <array>
#include <string>
#include <vector>

#include "identification.hpp"

namespace saltus {

struct MultiplierFit {
  std::string form;                  // "2 poles, 1 zero" or "image poles"
  int output = 0;                    // whose H_0 was fitted
  std::vector<Complex> multipliers;  // by falling modulus
  std::vector<double> sigma;         // sqrt(E |error|^2), from the scatter about the fit: bias left out
  double rms = 0.0;                  // of the misfit [output unit / input unit]
  Status status = Status::failed;
  std::vector<std::pair<double, Complex>> curve;  // f [cycles a cycle], fitted H_0, over the band of the data
};

// The paper's fit, uniform weights.
MultiplierFit fit_two_poles(const Identification& id, int output);

// The exact form of a periodic system with `count` non-zero multipliers, 1 to 4, and 32 sections; status failed when
// the lines are fewer than its coefficients need.
MultiplierFit fit_image_poles(const Identification& id, int output, int count);

// The best the data give: image poles where the lines suffice, of the output with the smallest sigma; else the mean of
// two poles over the outputs, whose sigma is their scatter (NaN for a single output).
MultiplierFit best_multipliers(const Identification& id, int outputs, int count);

}  // namespace saltus
