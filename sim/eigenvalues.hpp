// Eigenvalues of matrices of any size, for tables and reports: one instantiation of Eigen's solver for all of them.
#pragma once

#include <vector>

#include "core/linalg.hpp"

namespace saltus {

// By falling modulus, of a conjugate pair the one with the positive imaginary part first.
std::vector<Complex> eigenvalues(const Eigen::MatrixXd& matrix);

// Those of a return map that are not zero: larger than what rounding leaves of zero, 1e-6.
std::vector<Complex> nonzero_multipliers(const Eigen::MatrixXd& return_map);

}  // namespace saltus
