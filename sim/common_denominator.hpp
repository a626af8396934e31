// Private to multiplier_region(): what the harmonic transfer functions of a periodic system have in common, the A of
// B_m(z) / A(z^N), fitted to all of them together by variable projection.
#pragma once

#include <Eigen/Cholesky>

#include <vector>

#include "core/linalg.hpp"

namespace saltus::common_denominator {

// Responses that share their taps: H_0 of one output, whose taps are real; or, one below the other, H_m and the
// conjugate of H_-m, which a real system has at the mirrored frequency, -omega: there the taps are complex.
struct Series {
  int m = 0, output = 0;
  bool pair = false;
  Eigen::VectorXcd value;
  Eigen::VectorXd weight;  // 1 / sigma
};

struct Problem {
  Eigen::Index lines = 0;
  int sections = 0, count = 0;
  std::vector<Eigen::VectorXcd> power;  // z^-(N k), k = 0 ... count
  Eigen::MatrixXd taps;  // orthonormal columns, (2 lines x independent taps), real parts above imaginary ones
  std::vector<Series> series;
};

// What holds at the lines, with what then holds at the mirrored ones.
Eigen::VectorXcd mirrored(const Eigen::VectorXcd& x, bool pair);

Eigen::VectorXcd denominator(const Problem& p, const Eigen::VectorXd& a);

// Taps weighted by w / A, projected out of columns: x - X (X^H X)^-1 X^H x. The taps are orthonormal before weighting,
// so that the normal equations lose no more than the weights' range, and what they lose a second pass gives back.
class Projection {
 public:
  Projection(const Problem& p, const Series& s, const Eigen::VectorXcd& d);

  Eigen::VectorXcd operator()(const Eigen::VectorXcd& x) const { return once(once(x)); }

 private:
  Eigen::VectorXcd once(const Eigen::VectorXcd& x) const;

  const Problem* p_;
  bool pair_;
  Eigen::VectorXcd factor_;
  Eigen::LLT<Eigen::MatrixXd> real_;
  Eigen::LLT<Eigen::MatrixXcd> complex_;
};

// What a unit error of each weighted value of a series moves the right side by, one column a coefficient.
Eigen::MatrixXcd slope_of(const Problem& p, const Series& s, const Projection& complement,
                          const Eigen::VectorXcd& fitted);

struct Solution {
  bool ok = false;
  Eigen::VectorXd a;
  Eigen::MatrixXd covariance;  // of a, for unit complex variance of weighted values
  double cost = 0.0;
};

// From a on: so many times at most by Sanathanan & Koerner's reweighting, then by Gauss-Newton.
Solution solve(const Problem& p, Eigen::VectorXd a, int reweightings);

}  // namespace saltus::common_denominator
