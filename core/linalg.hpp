// Fixed-size vectors and matrices. Nothing here allocates; a table of matrices is a std::array of small ones.
#pragma once

#include <Eigen/Core>

#include <array>
#include <complex>

namespace saltus {

template <int N, class T = double>
using Vec = Eigen::Matrix<T, N, 1>;

template <int R, int C, class T = double>
using Mat = Eigen::Matrix<T, R, C>;

using Complex = std::complex<double>;

// a / b without the standard's care for extreme numbers, which every library takes in its own way. b = 0: not finite.
inline Complex quotient(const Complex& a, const Complex& b) noexcept {
  const double square = b.real() * b.real() + b.imag() * b.imag();
  return {(a.real() * b.real() + a.imag() * b.imag()) / square, (a.imag() * b.real() - a.real() * b.imag()) / square};
}

}  // namespace saltus
