#include "singular_values.hpp"

#include <Eigen/SVD>

namespace saltus {
namespace {

SingularValues decompose(const Eigen::MatrixXd& matrix, unsigned vectors) {
  const Eigen::BDCSVD<Eigen::MatrixXd> svd(matrix, vectors);
  SingularValues r;
  r.sigma = svd.singularValues();
  if (vectors != 0) r.u = svd.matrixU();
  return r;
}

}  // namespace

SingularValues singular_values(const Eigen::MatrixXd& matrix) { return decompose(matrix, 0); }
SingularValues left_singular_vectors(const Eigen::MatrixXd& matrix) { return decompose(matrix, Eigen::ComputeThinU); }

}  // namespace saltus
