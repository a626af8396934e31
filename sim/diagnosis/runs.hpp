// Runs of a machine along a segment, as fits and signatures take them.
#pragma once

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "fit.hpp"

namespace saltus::diagnosis {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Square root of the weight of each row: sqrt(measurements) / noise.
inline Eigen::VectorXd weights(const Data& data, const Segment& s) {
  Eigen::VectorXd w(s.count.size());
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  for (Eigen::Index i = 0; i < w.size(); ++i) w[i] = std::sqrt(s.count[i]) / data.noise[i % ny];
  return w;
}

inline Response respond(const Problem& p, const Segment& s, std::span<const double> values, const Start& start) {
  return p.machine->values_only(values, s.course(p.h_max), start);
}
inline Response sensitivities(const Problem& p, const Segment& s, std::span<const double> values, const Start& start,
                              std::span<const int> wanted) {
  return p.machine->run(values, s.course(std::max(p.h_max, p.h_slope)), start, wanted, true);
}

// What a segment's own start does not imitate: S (S'S + prior)^-1 S' taken out of weighted rows, where S is what the
// start does to them and the prior the spread of its coordinates.
class WithoutStart {
 public:
  WithoutStart() = default;
  WithoutStart(const Segment& s, Eigen::MatrixXd weighted) : S_(std::move(weighted)) {
    Eigen::MatrixXd ss = S_.transpose() * S_;
    for (Eigen::Index i = 0; i < ss.rows(); ++i) {
      const double spread = s.spread_of(static_cast<std::size_t>(i));
      ss(i, i) += 1.0 / (spread * spread);
    }
    solver_.compute(ss);
  }
  template <class Columns>
  Eigen::MatrixXd operator()(const Columns& c) const {
    return c - S_ * solver_.solve(S_.transpose() * c);
  }

 private:
  Eigen::MatrixXd S_;  // (rows x starts)
  Eigen::LDLT<Eigen::MatrixXd> solver_;
};

}  // namespace saltus::diagnosis
