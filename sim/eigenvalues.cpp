#include "eigenvalues.hpp"

#include <Eigen/Eigenvalues>

#include <algorithm>

namespace saltus {

std::vector<Complex> eigenvalues(const Eigen::MatrixXd& matrix) {
  if (matrix.rows() == 0 || !matrix.allFinite()) return {};
  const Eigen::EigenSolver<Eigen::MatrixXd> solver(matrix, false);
  std::vector<Complex> r;
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) r.push_back(solver.eigenvalues()[i]);
  std::sort(r.begin(), r.end(), [](const Complex& a, const Complex& b) {
    const double d = std::abs(a) - std::abs(b);
    if (std::abs(d) > 1e-12 * (std::abs(a) + std::abs(b))) return d > 0.0;
    return a.imag() > b.imag();
  });
  return r;
}

std::vector<Complex> nonzero_multipliers(const Eigen::MatrixXd& return_map) {
  std::vector<Complex> r = eigenvalues(return_map);
  std::erase_if(r, [](const Complex& z) { return !(std::abs(z) > 1e-6); });
  return r;
}

}  // namespace saltus
