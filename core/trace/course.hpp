// A stretch of a measurement that a model is run along: sample times and the inputs held from each to the next.
#pragma once

#include <cstddef>
#include <span>

namespace saltus {

// Samples 0 ... first - 1 are history, there for inputs that act late; the model's start is the state at t[first].
struct Course {
  std::span<const double> t;  // (n) [s] rising
  std::span<const double> u;  // (n x nu) row after row, held from t[i] to t[i + 1]
  std::size_t first = 0;      // the first sample whose outputs are wanted
  double h_max = 0.01;        // [s] longest step of the integrator
};

}  // namespace saltus
