#include "multiplier_region.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>

#include "common_denominator.hpp"
#include "core/random.hpp"
#include "core/spectrum/fit.hpp"
#include "core/trace/statistics.hpp"
#include "correlated_errors.hpp"
#include "significance.hpp"
#include "singular_values.hpp"

namespace saltus {
namespace {

using common_denominator::Errors;
using common_denominator::Problem;
using common_denominator::Projection;
using common_denominator::Sandwich;
using common_denominator::Series;
using common_denominator::Solution;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Eigen::VectorXd;
using Index = Eigen::Index;

std::vector<Complex> roots_of(const VectorXd& a) {
  const auto copy = [&](auto coefficients) {
    for (std::size_t k = 0; k < coefficients.size(); ++k) coefficients[k] = a[static_cast<Index>(k)];
    const auto z = roots(coefficients);
    return std::vector<Complex>(z.begin(), z.end());
  };
  switch (a.size()) {
    case 1:
      return copy(std::array<double, 1>{});
    case 2:
      return copy(std::array<double, 2>{});
    case 3:
      return copy(std::array<double, 3>{});
    default:
      return copy(std::array<double, 4>{});
  }
}

// A real multiplier has no error across the axis.
bool on_the_axis(const Eigen::Matrix2d& covariance) { return covariance(1, 1) <= 1e-9 * covariance(0, 0); }

double distance(const Eigen::Matrix2d& covariance, Complex d) {  // Mahalanobis, squared
  const Eigen::Vector2d v(d.real(), d.imag());
  // A real multiplier has no error across the axis: a floor of rounding keeps the ellipse an ellipse.
  const Eigen::Matrix2d c = covariance + 1e-12 * covariance.trace() * Eigen::Matrix2d::Identity();
  return v.dot(c.inverse() * v);
}

}  // namespace

double MultiplierRegion::sigma(std::size_t i) const { return std::sqrt(covariance[i].trace()); }

// Hotelling's T^2 of two dimensions, whose quantile is closed.
double MultiplierRegion::reach(double level) const {
  if (!(known < 1e6)) return std::sqrt(-2.0 * std::log1p(-level));
  const double f = std::max(2.0, known);
  return std::sqrt(f * std::expm1(-2.0 * std::log1p(-level) / (f - 1.0)));
}

namespace {
// An ellipse of two dimensions, or an interval where the multiplier is real.
bool inside(const Eigen::Matrix2d& covariance, Complex centre, Complex z, double level, double reach, double known) {
  if (!on_the_axis(covariance)) return distance(covariance, z - centre) < reach * reach;
  const double t = std::abs(z.real() - centre.real()) / std::sqrt(covariance(0, 0));
  if (!(known < 1e6)) return std::erf(t / std::sqrt(2.0)) < level;
  return 2.0 * student_tail(t, known) > 1.0 - level;
}
}  // namespace

bool MultiplierRegion::holds(std::size_t i, Complex z, double level) const {
  return inside(covariance[i], multipliers[i], z, level, reach(level), known);
}

bool MultiplierRegion::holds_by_bootstrap(std::size_t i, Complex z, double level) const {
  Eigen::Matrix2d c = Eigen::Matrix2d::Zero();
  for (const auto& r : replicates) {
    const Eigen::Vector2d d(r[i].real() - multipliers[i].real(), r[i].imag() - multipliers[i].imag());
    c += d * d.transpose() / static_cast<double>(replicates.size());
  }
  return inside(c, multipliers[i], z, level, reach(level), known);
}

namespace {
// The (m, output), m >= 0, that say something of the poles: H_0, and pairs of which either stands above the noise.
// Noise that is fitted as if it were a response would promise more than it tells.
std::vector<std::pair<int, int>> responses(const Identification& id, int outputs, const RegionOptions& o) {
  std::vector<std::pair<int, int>> r;
  const auto tests = test_harmonics(id);
  int most = o.harmonics;
  if (most < 0) {
    for (const HtfEstimate& h : id.htf) most = std::max(most, h.m);
  }
  for (int m = 0; m <= most; ++m) {
    for (int c = 0; c < outputs; ++c) {
      bool there = m == 0 || tests.empty();
      for (const HarmonicTest& t : tests) there = there || (std::abs(t.m) == m && t.output == c && t.significant);
      if (there) r.emplace_back(m, c);
    }
  }
  return r;
}
}  // namespace

MultiplierRegion multiplier_region(const Identification& id, int outputs, const RegionOptions& o) {
  MultiplierRegion region;
  if (o.count < 1 || o.count > 4) return region;
  Problem p;
  p.sections = id.sections;
  p.count = o.count;
  bool known = true;
  // A constant has half the numbers of a line, and H_-m no other than H_m: it is left out.
  const auto select = [&](int m, int c) {
    std::vector<HtfEstimate> list = id.select(m, c);
    std::erase_if(list, [](const HtfEstimate& h) { return h.line == 0; });
    return list;
  };
  const std::vector<HtfEstimate> first = select(0, 0);
  p.lines = static_cast<Index>(first.size());
  const Index taps = (o.count + 1) * id.sections;
  if (2 * p.lines < taps + 4 * o.count) return region;
  for (const auto& [m, c] : responses(id, outputs, o)) {
    Series s{m, c, m > 0, VectorXcd(m > 0 ? 2 * p.lines : p.lines), VectorXd(m > 0 ? 2 * p.lines : p.lines)};
    bool complete = true;
    for (const int order : m > 0 ? std::vector<int>{m, -m} : std::vector<int>{0}) {
      const auto list = select(order, c);
      complete = complete && static_cast<Index>(list.size()) == p.lines;
      for (Index q = 0; complete && q < p.lines; ++q) {
        const HtfEstimate& h = list[static_cast<std::size_t>(q)];
        const Index row = order < 0 ? p.lines + q : q;
        s.value[row] = order < 0 ? std::conj(h.value) : h.value;
        known = known && std::isfinite(h.sigma) && h.sigma > 0.0;
        s.weight[row] = std::isfinite(h.sigma) && h.sigma > 0.0 ? 1.0 / h.sigma : 1.0;
      }
    }
    if (complete) p.series.push_back(s);
  }
  if (p.series.empty()) return region;
  if (!known) {  // each series by its own size
    for (Series& s : p.series) {
      const double size = std::sqrt(s.value.squaredNorm() / static_cast<double>(s.value.size()));
      s.weight.setConstant(size > 0.0 ? 1.0 / size : 0.0);
    }
  }
  MatrixXd raw(2 * p.lines, taps);
  for (int k = 0; k <= o.count; ++k) p.power.emplace_back(p.lines);
  for (Index q = 0; q < p.lines; ++q) {
    const auto line = static_cast<std::int64_t>(first[static_cast<std::size_t>(q)].line);
    const std::int64_t length = std::int64_t{id.sections} * id.period;
    for (Index j = 0; j < taps; ++j) {
      const Complex w = root_of_unity(-line * j, length);
      raw(q, j) = w.real();
      raw(p.lines + q, j) = w.imag();
    }
    for (int k = 0; k <= o.count; ++k) {
      p.power[static_cast<std::size_t>(k)][q] = root_of_unity(-line * k * id.sections, length);
    }
  }
  {  // A band leaves some combinations of taps free: those that it tells apart span the same responses.
    const SingularValues svd = left_singular_vectors(raw);
    Index kept = 0;
    while (kept < taps && svd.sigma[kept] > 1e-7 * svd.sigma[0]) ++kept;
    p.taps = svd.u.leftCols(kept);
  }
  Solution s = solve(p, VectorXd::Zero(o.count), 20);
  if (!s.ok) return region;
  const std::vector<Errors> errors = known ? errors_of(id, p, first) : std::vector<Errors>{};
  if (!errors.empty()) {
    const Sandwich told = covariance_of(p, s, errors);
    s.covariance = told.covariance;
    region.known = told.freedom;
  }
  for (const Series& one : p.series) region.series += one.pair ? 2 : 1;
  region.multipliers = roots_of(s.a);
  region.chi_square = 2.0 * s.cost;
  region.freedom = static_cast<double>(region.series) * static_cast<double>(2 * p.lines - p.taps.cols()) - o.count;
  const double scale = known ? 1.0 : region.chi_square / region.freedom;
  for (std::size_t i = 0; i < region.multipliers.size(); ++i) {
    const Complex x = region.multipliers[i];
    Complex slope = 1.0;  // of the polynomial at its root
    for (std::size_t k = 0; k < region.multipliers.size(); ++k) slope *= k == i ? 1.0 : x - region.multipliers[k];
    MatrixXd jacobian(2, o.count);
    for (int k = 0; k < o.count; ++k) {
      const Complex d = -std::pow(x, o.count - 1 - k) / slope;
      jacobian(0, k) = d.real();
      jacobian(1, k) = x.imag() == 0.0 ? 0.0 : d.imag();
    }
    region.covariance.emplace_back(scale * jacobian * s.covariance * jacobian.transpose());
  }
  region.status = known ? Status::ok : Status::missing;

  Random random(o.seed);
  std::vector<VectorXcd> fitted;
  const VectorXcd d = denominator(p, s.a);
  for (const Series& one : p.series) {
    const Projection complement(p, one, d);
    const VectorXcd y = one.weight.cast<Complex>().cwiseProduct(one.value);
    fitted.push_back((y - complement(y)).cwiseQuotient(one.weight.cast<Complex>()));
  }
  for (int b = 0; b < o.replicates; ++b) {
    Problem drawn = p;
    const std::vector<VectorXcd> noise = draw(p, errors, random);
    for (std::size_t i = 0; i < drawn.series.size(); ++i) {
      for (Index q = 0; q < fitted[i].size(); ++q) {
        drawn.series[i].value[q] = fitted[i][q] + std::sqrt(scale) / p.series[i].weight[q] * noise[i][q];
      }
    }
    const Solution again = solve(drawn, s.a, 0);
    if (again.ok) region.replicates.push_back(roots_of(again.a));
  }
  return region;
}

double agreement(const MultiplierRegion& a, const MultiplierRegion& b, std::size_t i) {
  const Eigen::Matrix2d c = a.covariance[i] + b.covariance[i];
  const Complex d = a.multipliers[i] - b.multipliers[i];
  // Two real ones differ along one axis only.
  if (on_the_axis(c) && d.imag() == 0.0) return std::erfc(std::abs(d.real()) / std::sqrt(2.0 * c(0, 0)));
  return std::exp(-0.5 * distance(c, d));
}

}  // namespace saltus
