#include "past_events.hpp"

#include <algorithm>
#include <cmath>

namespace saltus::diagnosis {
namespace {

// Samples whose next one is off by far more than is usual, in any output.
std::vector<Eigen::Index> jumps_of(const Segment& s, Eigen::Index outputs) {
  constexpr double jump = 8.0;  // [-] times the median
  const Eigen::Index samples = s.y.size() / outputs;
  std::vector<Eigen::Index> found;
  for (Eigen::Index j = 0; j < outputs; ++j) {
    std::vector<double> steps;
    for (Eigen::Index i = 0; i + 1 < samples; ++i)
      steps.push_back(std::abs(s.y[(i + 1) * outputs + j] - s.y[i * outputs + j]));
    if (steps.empty()) continue;
    std::vector<double> sorted = steps;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    for (Eigen::Index i = 0; i + 1 < samples; ++i) {
      const bool known = s.count[i * outputs + j] > 0.0 && s.count[(i + 1) * outputs + j] > 0.0;
      if (known && steps[static_cast<std::size_t>(i)] > jump * *middle) found.push_back(i);
    }
  }
  return found;
}

}  // namespace

std::optional<Data> without_jumps(const Data& data) {
  constexpr Eigen::Index beside = 2;  // samples to either side of a jump
  const auto outputs = static_cast<Eigen::Index>(data.outputs());
  Data thin = data;
  bool any = false;
  for (Segment& s : thin.segments) {
    const Eigen::Index samples = s.y.size() / outputs;
    for (const Eigen::Index i : jumps_of(s, outputs)) {
      const Eigen::Index first = std::max<Eigen::Index>(0, i + 1 - beside), end = std::min(samples, i + 1 + beside);
      s.count.segment(first * outputs, (end - first) * outputs).setZero();
      any = true;
    }
  }
  if (!any) return std::nullopt;
  return thin;
}

bool misses_far(const Problem& p, const std::vector<int>& segments, const Fit& f) {
  constexpr double far = 4.0;  // [-] of chi squared over measurements
  double rows = 0.0;
  for (const int s : segments) rows += p.data->segments[static_cast<std::size_t>(s)].measured();
  return !(f.chi2 < far * rows);
}

Fit fit_past_events(const Problem& p, const std::vector<int>& segments, const Fit& from,
                    const std::vector<int>& effects) {
  const Fit plain = fit(p, segments, from, effects);
  if (!misses_far(p, segments, plain)) return plain;
  const auto thin = without_jumps(*p.data);
  if (!thin) return plain;
  Problem away = p;
  away.data = &*thin;
  Fit f = fit(away, segments, from, effects);
  if (!f.converged) f = fit(away, segments, f, effects);
  f = fit(p, segments, f, effects);
  return f.cost() < plain.cost() ? f : plain;
}

}  // namespace saltus::diagnosis
