#include "forecast.hpp"

#include "../median.hpp"

#include <algorithm>
#include <cmath>

namespace saltus::diagnosis {
namespace {

constexpr double unpredictable =
    20.0;  // [-] growth of an error of the start: beyond it a run says little about the model

// The outputs of a run; empty where the model does not finish it. `most`: by how much an error of its start grows.
std::vector<double> run_free(const Problem& p, const Segment& s, const std::vector<double>& values,
                             double* most = nullptr) {
  const std::size_t n = s.samples();
  Start start = s.guess;
  std::fill(start.x.begin(), start.x.end(), 0.0);
  start.x.resize(p.machine->free_coordinates(start.chart).size(), 0.0);
  // From the shortest piece on, or the start may be found a turn away.
  const std::size_t enough = std::clamp<std::size_t>(n / 10, 10, 80);
  for (std::size_t samples = 10;; samples = std::min(2 * samples, enough)) {
    if (!start_from(p, s, values, samples, start)) return {};
    if (samples == enough) break;
  }
  const Response y = p.machine->values_only(values, s.course(p.h_max), start);
  if (!usable(y.status)) return {};
  if (most != nullptr) *most = growth(p, s, values, start);
  return y.y;
}

}  // namespace

FreeRun free_runs(const Problem& p, const std::vector<int>& segments, double horizon,
                  const std::vector<double>& declared, const std::vector<double>& refit,
                  const std::vector<double>& after, std::vector<Trace>* traces) {
  const Data& data = *p.data;
  const std::size_t ny = data.outputs();
  const std::vector<double>* const values[3] = {&declared, &refit, &after};
  FreeRun f;
  f.horizon = horizon;
  std::vector<double>* const rms[3] = {&f.before, &f.refit, &f.after};
  std::vector<double>* const end[3] = {&f.end_before, &f.end_refit, &f.end_after};
  std::vector<double>* const middle[3] = {&f.median_before, &f.median_refit, &f.median_after};
  auto& each = f.each;
  each.resize(3 * ny);
  std::vector<double> squares(3 * ny, 0.0), late(3 * ny, 0.0), count(ny, 0.0), late_count(ny, 0.0);
  for (const int index : segments) {
    const Segment& s = data.segments[static_cast<std::size_t>(index)];
    std::vector<double> y[3];
    double most = 0.0;  // as what was found has it, the most faithful of the three
    for (int k = 0; k < 3; ++k) y[k] = run_free(p, s, *values[k], k == 2 ? &most : nullptr);
    if (most > unpredictable) {
      ++f.unstable;
      continue;
    }
    ++f.runs;
    if (y[0].empty() || y[1].empty() || y[2].empty()) {
      ++f.lost;
      continue;
    }
    f.begin.push_back(s.t[s.first]);
    const std::size_t n = s.samples(), tail = n - std::max<std::size_t>(1, n / 10);
    for (std::size_t j = 0; j < ny; ++j) {
      double own[3] = {0.0, 0.0, 0.0}, seen = 0.0;
      for (std::size_t i = 0; i < n; ++i) {
        const std::size_t row = i * ny + j;
        if (!(s.count[static_cast<Eigen::Index>(row)] > 0.0)) continue;
        seen += 1.0;
        late_count[j] += i >= tail;
        for (int k = 0; k < 3; ++k) {
          const double e = s.y[static_cast<Eigen::Index>(row)] - y[k][row];
          own[k] += e * e;
          if (i >= tail) late[static_cast<std::size_t>(k) * ny + j] += e * e;
        }
      }
      count[j] += seen;
      for (int k = 0; k < 3; ++k) {
        squares[static_cast<std::size_t>(k) * ny + j] += own[k];
        each[static_cast<std::size_t>(k) * ny + j].push_back(std::sqrt(own[k] / std::max(1.0, seen)));
      }
      if (traces == nullptr) continue;
      Trace t;
      t.output = j;
      for (std::size_t i = 0; i < n; ++i) {
        const std::size_t row = i * ny + j;
        t.t.push_back(s.t[s.first + i]);
        t.measured.push_back(s.count[static_cast<Eigen::Index>(row)] > 0.0 ? s.y[static_cast<Eigen::Index>(row)]
                                                                           : std::nan(""));
        t.refit.push_back(y[1][row]);
        t.after.push_back(y[2][row]);
      }
      traces->push_back(std::move(t));
    }
  }
  for (int k = 0; k < 3; ++k) {
    for (std::size_t j = 0; j < ny; ++j) {
      const std::size_t at = static_cast<std::size_t>(k) * ny + j;
      rms[k]->push_back(std::sqrt(squares[at] / std::max(1.0, count[j])));
      end[k]->push_back(std::sqrt(late[at] / std::max(1.0, late_count[j])));
      middle[k]->push_back(median(each[at]));
    }
  }
  return f;
}

}  // namespace saltus::diagnosis
