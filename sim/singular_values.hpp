// Singular value decomposition of run-time sized matrices, compiled once: it is dear.
#pragma once

#include <Eigen/Core>

namespace saltus {

struct SingularValues {
  Eigen::VectorXd sigma;  // (k) falling, k = min(rows, columns)
  Eigen::MatrixXd u;      // (rows x k) left vectors; empty unless asked for
};

// Values alone, or with the left vectors.
SingularValues singular_values(const Eigen::MatrixXd& matrix);
SingularValues left_singular_vectors(const Eigen::MatrixXd& matrix);

}  // namespace saltus
