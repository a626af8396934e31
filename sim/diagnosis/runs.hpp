// Runs of a machine along a segment, as fits and signatures take them.
#pragma once

#include <algorithm>
#include <cmath>
#include <span>

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

}  // namespace saltus::diagnosis
