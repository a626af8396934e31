// Where a phase passes its levels, on parabolas through the samples about.
#include <Eigen/LU>

#include <numbers>
#include <tuple>

#include "passages.hpp"

namespace saltus::rhythm {
namespace {

using Eigen::VectorXd;
using Index = Eigen::Index;

// A parabola through the samples about one: its coefficients about their middle time, and what it leaves.
struct Parabola {
  Eigen::Vector3d c = Eigen::Vector3d::Zero();
  Eigen::Matrix3d inverse = Eigen::Matrix3d::Zero();  // of the normal equations
  double squares = 0.0;
  Index n = 0;
};
Parabola parabola(const std::vector<double>& t, const std::vector<double>& y, std::size_t from, std::size_t to,
                  double middle, double scale) {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  Parabola p;
  for (std::size_t i = from; i < to; ++i) {
    if (!std::isfinite(y[i])) continue;
    const double s = (t[i] - middle) / scale;
    const Eigen::Vector3d row(1.0, s, s * s);
    A += row * row.transpose();
    b += row * y[i];
    ++p.n;
  }
  if (p.n < half_window) return p;
  p.inverse = A.inverse();
  p.c = p.inverse * b;
  for (std::size_t i = from; i < to; ++i) {
    if (!std::isfinite(y[i])) continue;
    const double s = (t[i] - middle) / scale;
    const double e = y[i] - p.c.dot(Eigen::Vector3d(1.0, s, s * s));
    p.squares += e * e;
  }
  return p;
}

// Rows about one that lie between the same two events, half a window on either side at most.
std::pair<std::size_t, std::size_t> about(const Samples& s, std::size_t centre) {
  const auto most = at(half_window);
  std::size_t from = centre, to = centre + 1;
  while (from > 0 && centre - from < most && s.stay[from - 1] == s.stay[centre]) --from;
  while (to < s.t.size() && to - centre <= most && s.stay[to] == s.stay[centre]) ++to;
  return {from, to};
}

// Where the phase passes the level, about a sample: [window] from it on, and how far off it is there.
struct Met {
  double s = 0.0, off = 1.0;
};
Met meet(const Passages& w, const Samples& s, std::size_t from, std::size_t to, double middle, double level) {
  const double scale = w.spacing * static_cast<double>(half_window);
  const bool angle = w.plane.has_value();
  const Parabola p = parabola(s.t, s.y[angle ? w.plane->output : w.phase], from, to, middle, scale);
  Parabola rate;
  double cosine = 0.0, sine = 0.0;
  if (angle) {
    rate = p;
    if (w.plane->rate >= 0) {
      rate = parabola(s.t, s.y[static_cast<std::size_t>(w.plane->rate)], from, to, middle, scale);
    } else {  // the parabola's own
      rate.c = {p.c[1] / scale, 2.0 * p.c[2] / scale, 0.0};
    }
    cosine = std::cos(-2.0 * std::numbers::pi * level) / w.plane->s_v;
    sine = std::sin(-2.0 * std::numbers::pi * level) / w.plane->s_p;
  }
  if (p.n < half_window || (angle && rate.n < half_window)) return {};
  const auto value = [](const Parabola& q, double x) { return q.c[0] + x * (q.c[1] + x * q.c[2]); };
  const auto slope = [](const Parabola& q, double x) { return q.c[1] + 2.0 * q.c[2] * x; };
  const auto ahead = [&](double x) {
    if (!angle) return value(p, x) - level;
    return (value(rate, x) - w.plane->o_v) * cosine - (value(p, x) - w.plane->o_p) * sine;
  };
  Met m;
  for (int k = 0; k < 20; ++k) {
    const double d = angle ? slope(rate, m.s) * cosine - slope(p, m.s) * sine : slope(p, m.s);
    m.s = std::clamp(m.s - ahead(m.s) / (std::abs(d) > 1e-300 ? d : 1e-300), -1.0, 1.0);
  }
  m.off = std::abs(ahead(m.s)) / (1.0 + std::abs(angle ? 0.0 : level));
  return m;
}

}  // namespace

std::vector<double> phase_of(const Passages& w, const Samples& s) {
  if (!w.plane) return s.y[w.phase];
  const double scale = w.spacing * static_cast<double>(half_window);
  const auto& y = s.y[w.plane->output];
  std::vector<double> r(s.t.size(), std::nan(""));
  for (std::size_t i = 0; i < r.size(); ++i) {
    if (s.stay[i] < 0) continue;
    const auto [from, to] = about(s, i);
    const Parabola p = parabola(s.t, y, from, to, s.t[i], scale);
    if (p.n < half_window) continue;
    double v = p.c[1] / scale;
    if (w.plane->rate >= 0) v = s.y[static_cast<std::size_t>(w.plane->rate)][i];
    const double turns = -std::atan2((v - w.plane->o_v) / w.plane->s_v, (p.c[0] - w.plane->o_p) / w.plane->s_p) /
                         (2.0 * std::numbers::pi);
    r[i] = turns - std::floor(turns);
  }
  return r;
}

std::optional<Located> locate(const Passages& w, const Samples& s, const std::vector<double>& phase, std::size_t first,
                              std::size_t rows, int section) {
  const double level = w.level[static_cast<std::size_t>(section)];
  // Noise may cross a level more than once: the middle one.
  std::vector<double> crossings;
  for (std::size_t i = first + 1; i < first + rows; ++i) {
    if (s.stay[i] < 0 || s.stay[i] != s.stay[i - 1]) continue;
    double before = phase[i - 1] - level, after = phase[i] - level;
    if (w.plane) {
      before -= std::round(before);
      after -= std::round(after);
      if (before < 0.0 && after >= 0.0 && after - before < 0.5) crossings.push_back(static_cast<double>(i));
    } else if (before * after <= 0.0) {
      crossings.push_back(static_cast<double>(i));
    }
  }
  if (crossings.empty()) return {};
  const double scale = w.spacing * static_cast<double>(half_window);
  auto centre = static_cast<std::size_t>(median(crossings));
  Located r;
  std::size_t from = 0, to = 0;
  bool there = false;
  for (int round = 0; round < 4; ++round) {
    std::tie(from, to) = about(s, centre);
    if (centre < from + 2 || centre + 2 >= to) break;
    const Met m = meet(w, s, from, to, s.t[centre], level);
    r.when = s.t[centre] + m.s * scale;
    there = m.off < 1e-9;
    const auto nearer = static_cast<std::size_t>(std::lower_bound(s.t.begin() + static_cast<std::ptrdiff_t>(from),
                                                                  s.t.begin() + static_cast<std::ptrdiff_t>(to),
                                                                  r.when - 0.5 * w.spacing) -
                                                 s.t.begin());
    if (nearer == centre) break;
    centre = std::min(nearer, to - 1);
  }
  if (!there) return {};
  r.x.resize(w.dim);
  r.variance.resize(w.dim);
  Index k = 0;
  const auto add = [&](double value, double variance) {
    r.x[k] = value;
    r.variance[k++] = variance;
  };
  double radius = 0.0, radius_variance = 0.0;
  Index radius_at = -1;
  const double angle = -2.0 * std::numbers::pi * level;
  const auto add_to_radius = [&](double value, double variance, double o, double scaled) {
    radius += (value - o) * scaled;
    radius_variance += variance * scaled * scaled;
  };
  for (std::size_t o = 0; o < s.y.size(); ++o) {
    const Parabola q = parabola(s.t, s.y[o], from, to, r.when, scale);
    if (q.n < half_window) return {};
    const double noise = q.squares / std::max(1.0, static_cast<double>(q.n - 3));
    const double value = noise * q.inverse(0, 0), slope = noise * q.inverse(1, 1) / (scale * scale);
    const bool rate_told = w.rate_of[o] < 0 && !w.rate_measured[o];
    if (w.plane && o == w.plane->output) {
      radius_at = k++;
      add_to_radius(q.c[0], value, w.plane->o_p, std::cos(angle) / w.plane->s_p);
      if (rate_told) add_to_radius(q.c[1] / scale, slope, w.plane->o_v, std::sin(angle) / w.plane->s_v);
    } else if (w.plane && static_cast<int>(o) == w.plane->rate) {
      add_to_radius(q.c[0], value, w.plane->o_v, std::sin(angle) / w.plane->s_v);
    } else {
      if (w.plane || o != w.phase) add(q.c[0], value);
      if (rate_told) add(q.c[1] / scale, slope);
    }
  }
  if (radius_at >= 0) {
    r.x[radius_at] = radius;
    r.variance[radius_at] = radius_variance;
    if (!(radius > 0.0)) return {};
  }
  return r;
}

}  // namespace saltus::rhythm
