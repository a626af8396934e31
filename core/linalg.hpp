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

}  // namespace saltus
