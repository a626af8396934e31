// Eigenvalues of a return map, by falling modulus. Expensive to compile (an EigenSolver a dimension): include it where
// multipliers are asked for and nowhere else.
#pragma once

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "../linalg.hpp"

namespace saltus {

// Non-finite entries give non-finite multipliers. The conjugate with the positive imaginary part comes first.
template <int N>
std::array<Complex, static_cast<std::size_t>(N)> multipliers(const Mat<N, N>& monodromy) noexcept {
  std::array<Complex, static_cast<std::size_t>(N)> r{};
  if (!monodromy.allFinite()) {
    r.fill(Complex(std::numeric_limits<double>::quiet_NaN(), 0.0));
    return r;
  }
  const Eigen::EigenSolver<Mat<N, N>> solver(monodromy, false);
  for (int i = 0; i < N; ++i) r[static_cast<std::size_t>(i)] = solver.eigenvalues()[i];
  std::sort(r.begin(), r.end(), [](const Complex& a, const Complex& b) {
    const double d = std::abs(a) - std::abs(b);
    // A conjugate pair has one modulus up to rounding.
    if (std::abs(d) > 1e-12 * (std::abs(a) + std::abs(b))) return d > 0.0;
    return a.imag() > b.imag();
  });
  return r;
}

}  // namespace saltus
