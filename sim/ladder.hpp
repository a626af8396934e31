// The same campaign at several amplitudes, extrapolated to amplitude zero: what the linearised motion does.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "identification.hpp"

namespace saltus {

struct Ladder {
  std::vector<double> amplitude;  // [input unit] of each rung
  std::array<int, 3> degree{};    // estimates that took a polynomial of degree 0, 1, 2 in the square of the amplitude
  int misfits = 0;                // estimates that none of these fits, by chi-square at 5 %: lower the amplitudes
};

// Every H_m of the rungs, which hold the same lines, extrapolated by extrapolate_to_zero(); all else is of the first
// rung. Where no standard errors are known the highest degree is taken, and none are known of the result.
Identification extrapolate(std::span<const Identification> rungs, Ladder& ladder);

}  // namespace saltus
