// Where a record is not the machine's alone, or says nothing: it was touched, or it stood still.
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "../median.hpp"
#include "stretches.hpp"

namespace saltus::diagnosis {
namespace {

constexpr double hardly = 0.01;    // [-] of how far the liveliest stretches move
constexpr double window = 0.2;     // [s]
constexpr double far_off = 12.0;   // [-] deviations
constexpr double seen = 6.0;       // [-] standard errors of the force itself
constexpr double accidents = 0.1;  // [-] share of windows; more is the model's fault

// Windows in which the same may be expected: all; of a machine in steps those as far into the same chart.
std::vector<std::vector<std::size_t>> alike_in(const Stretches& s, bool in_steps) {
  std::map<std::pair<int, int>, std::vector<std::size_t>> groups;  // by chart, and place in it
  int place = 0;
  for (std::size_t k = 0; k < s.origin.size(); ++k) {
    const auto same_step = [&](const Origin& a, const Origin& b) {
      return a.experiment == b.experiment && a.cycle == b.cycle;
    };
    const int chart = s.data.segments[k].guess.chart;
    const bool on = k > 0 && same_step(s.origin[k], s.origin[k - 1]) && s.data.segments[k - 1].guess.chart == chart;
    place = on ? place + 1 : 0;
    groups[in_steps ? std::pair{chart, place} : std::pair{0, 0}].push_back(k);
  }
  std::vector<std::vector<std::size_t>> r;
  for (auto& [key, group] : groups) r.push_back(std::move(group));
  return r;
}

}  // namespace

std::vector<int> standing_still(const Stretches& s) {
  const Data& data = s.data;
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  Eigen::Index best = 0;
  double most = 0.0;
  for (Eigen::Index j = 0; j < ny; ++j) {
    double low = 1e300, high = -1e300;
    for (const Segment& g : data.segments) {
      for (Eigen::Index i = j; i < g.y.size(); i += ny) {
        if (!(g.count[i] > 0.0)) continue;
        low = std::min(low, g.y[i]);
        high = std::max(high, g.y[i]);
      }
    }
    if ((high - low) / data.noise[j] > most) {
      most = (high - low) / data.noise[j];
      best = j;
    }
  }
  std::vector<double> range;
  for (const Segment& g : data.segments) {
    double low = 1e300, high = -1e300;
    for (Eigen::Index i = best; i < g.y.size(); i += ny) {
      if (!(g.count[i] > 0.0)) continue;
      low = std::min(low, g.y[i]);
      high = std::max(high, g.y[i]);
    }
    range.push_back(std::max(0.0, high - low));
  }
  std::vector<double> sorted = range;
  const auto wide = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() * 9 / 10);
  std::nth_element(sorted.begin(), wide, sorted.end());
  const double limit = std::max(12.0 * data.noise[best], hardly * *wide);
  std::vector<int> r;
  for (std::size_t k = 0; k < range.size(); ++k) {
    if (range[k] < limit) r.push_back(static_cast<int>(k));
  }
  return r;
}

std::vector<bool> touched(const Record& record, const Machine& machine, const Cut& cut) {
  Cut fine = cut;
  fine.length = window;
  Stretches s = cut_into_stretches(record, machine, fine);
  if (s.data.segments.size() < 20) return {};
  Problem p;
  p.machine = &machine;
  p.data = &s.data;
  p.h_max = s.spacing;
  guess_starts_from_data(p, s.data, record.name);
  std::vector<int> forces, all;
  for (std::size_t i = 0; i < machine.coefficients.size(); ++i) {
    if (machine.coefficients[i].name.rfind("constant_force@", 0) == 0) forces.push_back(static_cast<int>(i));
  }
  for (std::size_t k = 0; k < s.data.segments.size(); ++k) all.push_back(static_cast<int>(k));
  if (forces.empty()) return {};
  const Signatures g = signatures(p, all, declared_fit(p), forces);
  const auto alike = alike_in(s, machine.in_steps);
  std::vector<bool> hit(all.size(), false);
  for (Eigen::Index c = 0; c < g.C.cols(); ++c) {
    std::vector<double> force(all.size(), 0.0), error(all.size(), 0.0);
    for (std::size_t k = 0; k < all.size(); ++k) {
      const Eigen::Index end = k + 1 < all.size() ? g.offset[k + 1] : g.C.rows();
      const auto part = Eigen::seqN(g.offset[k], end - g.offset[k]);
      const double information = g.C(part, c).squaredNorm();
      if (!(information > 0.0)) continue;
      force[k] = g.C(part, c).dot(g.r(part)) / information;
      error[k] = 1.0 / std::sqrt(information);
    }
    const double middle = median(force);
    std::vector<double> off;
    for (const double f : force) off.push_back(std::abs(f - middle));
    const double usual = 1.4826 * median(off);
    for (const std::vector<std::size_t>& group : alike) {
      std::vector<double> here;
      for (const std::size_t k : group) here.push_back(force[k]);
      const double expected = median(here);
      // What a model lacks may act in one part of a step, and is there in every step.
      for (const std::size_t k : group) {
        const double beyond = std::abs(force[k] - expected);
        hit[k] = hit[k] || (off[k] > far_off * usual && beyond > 0.5 * off[k] && beyond > seen * error[k]);
      }
    }
  }
  const auto count = std::count(hit.begin(), hit.end(), true);
  if (count == 0 || static_cast<double>(count) > accidents * static_cast<double>(hit.size())) return {};
  std::vector<bool> rows(record.rows(), false);
  for (std::size_t k = 0; k < hit.size(); ++k) {
    if (!hit[k]) continue;
    const Segment& seg = s.data.segments[k];
    const std::size_t n = seg.samples();
    const std::size_t from = s.origin[k].row, margin = n / 2;
    for (std::size_t i = from - std::min(from, margin); i < std::min(record.rows(), from + n + margin); ++i) {
      if (record.experiment[i] == record.experiment[from]) rows[i] = true;
    }
  }
  return rows;
}

}  // namespace saltus::diagnosis
