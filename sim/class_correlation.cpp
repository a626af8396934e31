#include "class_correlation.hpp"

#include <Eigen/Cholesky>

#include <cmath>
#include <iterator>
#include <limits>

namespace saltus {

Eigen::MatrixXcd ClassCorrelation::root() const {
  const Eigen::MatrixXcd floored = matrix + 1e-6 * Eigen::MatrixXcd::Identity(matrix.rows(), matrix.cols());
  return Eigen::LLT<Eigen::MatrixXcd>(floored).matrixL();
}

void ClassScatter::add(int line, int harmonics, const Eigen::MatrixXcd& covariance, double freedom) {
  if (!(freedom >= 1.0) || !covariance.allFinite()) return;
  Sum& s = lines_[line];
  if (s.freedom == 0.0) {
    s = {harmonics, freedom, freedom * covariance};
  } else if (s.scatter.rows() == covariance.rows()) {
    s.scatter += freedom * covariance;
    s.freedom += freedom;
  }
}

void ClassScatter::add(int line, int harmonics, std::span<const Eigen::VectorXcd> periods) {
  if (periods.size() < 2) return;
  const auto count = static_cast<double>(periods.size());
  Eigen::VectorXcd mean = Eigen::VectorXcd::Zero(periods[0].size());
  for (const auto& y : periods) mean += y / count;
  Eigen::MatrixXcd sum = Eigen::MatrixXcd::Zero(mean.size(), mean.size());
  for (const auto& y : periods) sum += (y - mean) * (y - mean).adjoint();
  add(line, harmonics, sum / (count - 1.0), count - 1.0);
}

void ClassScatter::append(const ClassScatter& more) {
  for (const auto& [line, s] : more.lines_) add(line, s.harmonics, s.scatter / s.freedom, s.freedom);
}

ClassCorrelation ClassScatter::correlation(int line) const {
  constexpr double wanted = 12.0;  // few: a region sums over many lines, and noise changes within a tenth of a cycle
  ClassCorrelation r;
  r.line = line;
  auto above = lines_.lower_bound(line);
  if (above != lines_.end() && above->first == line) r.own = above->second.freedom;
  auto below = std::make_reverse_iterator(above);
  const auto take = [&](const Sum& s) {
    if (r.freedom == 0.0) {
      r.harmonics = s.harmonics;
      r.matrix = s.scatter;
    } else if (s.scatter.rows() != r.matrix.rows()) {
      return;
    } else {
      r.matrix += s.scatter;
    }
    r.freedom += s.freedom;
  };
  while (r.freedom < wanted && (above != lines_.end() || below != lines_.rend())) {
    // Of two neighbours as far away, both.
    const int up = above != lines_.end() ? above->first - line : std::numeric_limits<int>::max();
    const int down = below != lines_.rend() ? line - below->first : std::numeric_limits<int>::max();
    if (up <= down) take((above++)->second);
    if (down <= up) take((below++)->second);
  }
  const Eigen::VectorXd power = r.matrix.diagonal().real();
  for (Eigen::Index i = 0; i < r.matrix.rows(); ++i) {
    for (Eigen::Index j = 0; j < r.matrix.cols(); ++j) {
      const double size = std::sqrt(power[i] * power[j]);
      r.matrix(i, j) = i == j ? 1.0 : size > 0.0 ? Complex(r.matrix(i, j) / size) : Complex{};
    }
  }
  return r;
}

}  // namespace saltus
