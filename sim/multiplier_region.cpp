#include "multiplier_region.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/random.hpp"
#include "core/spectrum/fit.hpp"
#include "core/trace/statistics.hpp"
#include "significance.hpp"
#include "singular_values.hpp"

namespace saltus {
namespace {

using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Eigen::VectorXd;
using Index = Eigen::Index;

// Responses that share their taps: H_0 of one output, whose taps are real; or, one below the other, H_m and the
// conjugate of H_-m, which a real system has at the mirrored frequency, -omega: there the taps are complex.
struct Series {
  int m = 0, output = 0;
  bool pair = false;
  VectorXcd value;
  VectorXd weight;  // 1 / sigma
};

struct Problem {
  Index lines = 0;
  int sections = 0, count = 0;
  std::vector<VectorXcd> power;  // z^-(N k), k = 0 ... count
  MatrixXd taps;                 // orthonormal columns, (2 lines x independent taps), real parts above imaginary ones
  std::vector<Series> series;
};

// What holds at the lines, with what then holds at the mirrored ones.
VectorXcd mirrored(const VectorXcd& x, bool pair) {
  if (!pair) return x;
  VectorXcd r(2 * x.size());
  r << x, x.conjugate();
  return r;
}

VectorXcd denominator(const Problem& p, const VectorXd& a) {
  VectorXcd d = p.power[0];
  for (Index k = 0; k < a.size(); ++k) d += a[k] * p.power[static_cast<std::size_t>(k) + 1];
  return d;
}

// Taps weighted by w / A, projected out of columns: x - X (X^H X)^-1 X^H x. The taps are orthonormal before weighting,
// so that the normal equations lose no more than the weights' range, and what they lose a second pass gives back.
class Projection {
 public:
  Projection(const Problem& p, const Series& s, const VectorXcd& d)
      : p_(&p), pair_(s.pair), factor_(s.weight.cast<Complex>().cwiseQuotient(mirrored(d, s.pair))) {
    const Index n = p.lines;
    const VectorXd square = factor_.cwiseAbs2();
    VectorXd sum = square.head(n), difference = VectorXd::Zero(n);
    if (pair_) {
      sum += square.tail(n);
      difference = square.head(n) - square.tail(n);
    }
    MatrixXd weighted(2 * n, p.taps.cols());
    weighted.topRows(n) = sum.cwiseSqrt().asDiagonal() * p.taps.topRows(n);
    weighted.bottomRows(n) = sum.cwiseSqrt().asDiagonal() * p.taps.bottomRows(n);
    MatrixXd even = MatrixXd::Zero(p.taps.cols(), p.taps.cols());
    even.selfadjointView<Eigen::Lower>().rankUpdate(weighted.transpose());
    even.triangularView<Eigen::StrictlyUpper>() = even.transpose();
    if (!pair_) {
      real_.compute(even);
      return;
    }
    const MatrixXd odd = p.taps.topRows(n).transpose() * difference.asDiagonal() * p.taps.bottomRows(n);
    MatrixXcd gram(even.rows(), even.cols());
    gram.real() = even;
    gram.imag() = odd - odd.transpose();
    complex_.compute(gram);
  }

  VectorXcd operator()(const VectorXcd& x) const { return once(once(x)); }

 private:
  VectorXcd once(const VectorXcd& x) const {
    const Index n = p_->lines;
    const auto cosine = p_->taps.topRows(n), sine = p_->taps.bottomRows(n);
    const VectorXcd y = factor_.conjugate().cwiseProduct(x);
    if (!pair_) {
      const VectorXd c =
          real_.solve(VectorXd(cosine.transpose() * VectorXd(y.real()) + sine.transpose() * VectorXd(y.imag())));
      VectorXcd fitted(n);
      fitted.real() = cosine * c;
      fitted.imag() = sine * c;
      return x - factor_.cwiseProduct(fitted);
    }
    // The columns are w at the lines and their conjugates at the mirrored ones, w = cosine + i sine.
    const VectorXcd even = y.head(n) + y.tail(n), odd = Complex{0.0, -1.0} * (y.head(n) - y.tail(n));
    VectorXcd rhs(p_->taps.cols());
    rhs.real() = cosine.transpose() * VectorXd(even.real()) + sine.transpose() * VectorXd(odd.real());
    rhs.imag() = cosine.transpose() * VectorXd(even.imag()) + sine.transpose() * VectorXd(odd.imag());
    const VectorXcd c = complex_.solve(rhs);
    const VectorXd re = c.real(), im = c.imag();
    VectorXcd a(n), b(n), fitted(2 * n);
    a.real() = cosine * re;
    a.imag() = cosine * im;
    b.real() = sine * re;
    b.imag() = sine * im;
    fitted << a + Complex{0.0, 1.0} * b, a - Complex{0.0, 1.0} * b;
    return x - factor_.cwiseProduct(fitted);
  }

  const Problem* p_;
  bool pair_;
  VectorXcd factor_;
  Eigen::LLT<MatrixXd> real_;
  Eigen::LLT<MatrixXcd> complex_;
};

// Normal equations of one linear problem around a; Gauss-Newton, or Sanathanan & Koerner's where `modelled` is false.
struct Normal {
  MatrixXd matrix;
  VectorXd rhs;
  double cost = 0.0;
};

// What a unit error of each weighted value of a series moves the right side by, one column a coefficient.
MatrixXcd slope_of(const Problem& p, const Series& s, const Projection& complement, const VectorXcd& fitted) {
  MatrixXcd slope(fitted.size(), p.count);
  for (Index k = 0; k < p.count; ++k) {
    slope.col(k) = complement(fitted.cwiseProduct(mirrored(p.power[static_cast<std::size_t>(k) + 1], s.pair)));
  }
  return slope;
}

Normal normal_equations(const Problem& p, const VectorXd& a, bool modelled) {
  Normal n{MatrixXd::Zero(p.count, p.count), VectorXd::Zero(p.count), 0.0};
  const VectorXcd d = denominator(p, a);
  for (const Series& s : p.series) {
    const Projection complement(p, s, d);
    const VectorXcd y = s.weight.cast<Complex>().cwiseProduct(s.value);
    const VectorXcd residual = complement(y);
    n.cost += residual.squaredNorm();
    const VectorXcd fitted = (modelled ? VectorXcd(y - residual) : y).cwiseQuotient(mirrored(d, s.pair));
    const MatrixXcd slope = slope_of(p, s, complement, fitted);
    n.matrix += (slope.adjoint() * slope).real();
    n.rhs -= (slope.adjoint() * residual).real();
  }
  return n;
}

struct Solution {
  bool ok = false;
  VectorXd a;
  MatrixXd covariance;  // of a, for unit complex variance of weighted values
  double cost = 0.0;
};

Solution solve(const Problem& p, VectorXd a, int reweightings) {
  for (int i = 0; i < reweightings; ++i) {
    // The equation error A y - B, weighted by the last A, is linear in A: its value at a is the residual there.
    const Normal n = normal_equations(p, a, false);
    const VectorXd step = n.matrix.ldlt().solve(n.rhs);
    a += step;
    if (step.norm() < 1e-2 * (1.0 + a.norm())) break;  // Gauss-Newton goes on from here
  }
  Solution r;
  Normal n = normal_equations(p, a, true);
  for (int i = 0; i < 30; ++i) {
    const VectorXd step = n.matrix.ldlt().solve(n.rhs);
    double length = 1.0;
    Normal next = normal_equations(p, a + step, true);
    for (int half = 0; half < 6 && !(next.cost <= n.cost * (1.0 + 1e-12)); ++half) {
      length *= 0.5;
      next = normal_equations(p, a + length * step, true);
    }
    // Far below the noise, for the cost is some thousands of its variances; or of rounding.
    const bool small = step.dot(n.matrix * step) < 1e-8 * n.cost || step.norm() < 1e-9 * (1.0 + a.norm());
    a += length * step;
    n = next;
    if (!a.allFinite()) return r;
    if (small) {
      r.ok = true;
      break;
    }
  }
  r.a = a;
  r.cost = n.cost;
  r.covariance = 0.5 * n.matrix.inverse();
  return r;
}

// The estimates of one line: the series and the row where each stands, as its conjugate where `mirrored`, and how their
// errors go together.
struct Errors {
  struct Place {
    std::size_t series;
    Index row;
    bool mirrored;
  };
  std::vector<Place> place;
  MatrixXcd correlation;
  double own = 0.0;  // complex degrees of freedom of the line's own repeats
};

std::vector<Errors> errors_of(const Identification& id, const Problem& p, const std::vector<HtfEstimate>& lines) {
  std::vector<Errors> all;
  for (Index q = 0; q < p.lines; ++q) {
    const ClassCorrelation* known = id.correlation(lines[static_cast<std::size_t>(q)].line);
    if (known == nullptr) return {};
    Errors e;
    e.own = known->own;
    std::vector<Index> rows;
    const auto enter = [&](std::size_t series, int m, int output, Index row) {
      e.place.push_back({series, row, m < 0});
      const bool held = std::abs(m) <= known->harmonics && known->row(m, output) < known->matrix.rows();
      rows.push_back(held ? known->row(m, output) : -1);
    };
    for (std::size_t i = 0; i < p.series.size(); ++i) {
      const Series& s = p.series[i];
      enter(i, s.m, s.output, q);
      if (s.pair) enter(i, -s.m, s.output, p.lines + q);
    }
    const auto n = static_cast<Index>(rows.size());
    e.correlation = MatrixXcd::Identity(n, n);
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j < n; ++j) {
        const Index a = rows[static_cast<std::size_t>(i)], b = rows[static_cast<std::size_t>(j)];
        if (i != j && a >= 0 && b >= 0) e.correlation(i, j) = known->matrix(a, b);
      }
    }
    all.push_back(std::move(e));
  }
  return all;
}

// Covariance of the solution where the errors of a line go together, the weights being those of errors that do not:
// M^-1 (sum over the lines of S* C S / 2) M^-1 (Eicker, Huber & White). A line's errors are circular, those of
// different lines independent.
struct Sandwich {
  MatrixXd covariance;
  double freedom = 0.0;  // real, by Satterthwaite's rule: each line tells with what its own repeats do
};

Sandwich covariance_of(const Problem& p, const Solution& s, const std::vector<Errors>& errors) {
  const VectorXcd d = denominator(p, s.a);
  std::vector<MatrixXcd> slope;
  MatrixXd matrix = MatrixXd::Zero(p.count, p.count), middle = matrix;
  for (const Series& one : p.series) {
    const Projection complement(p, one, d);
    const VectorXcd y = one.weight.cast<Complex>().cwiseProduct(one.value);
    slope.push_back(slope_of(p, one, complement, VectorXcd(y - complement(y)).cwiseQuotient(mirrored(d, one.pair))));
    matrix += (slope.back().adjoint() * slope.back()).real();
  }
  const auto parts = [&](const Errors& e) -> MatrixXd {
    MatrixXcd rows(static_cast<Index>(e.place.size()), p.count);
    for (std::size_t i = 0; i < e.place.size(); ++i) {
      const auto row = slope[e.place[i].series].row(e.place[i].row);
      rows.row(static_cast<Index>(i)) = row;
      if (e.place[i].mirrored) rows.row(static_cast<Index>(i)) = row.conjugate();
    }
    return 0.5 * (rows.adjoint() * e.correlation * rows).real();
  };
  const MatrixXd inverse = matrix.inverse();
  double sum = 0.0, square = 0.0;
  for (const Errors& e : errors) {
    const MatrixXd part = parts(e);
    const double size = (inverse * part * inverse).trace();
    middle += part;
    sum += size;
    square += size * size / std::max(1.0, e.own);
  }
  return {inverse * middle * inverse, 2.0 * sum * sum / square};
}

// Noise of every series in units of its sigma, as the errors go together or, where nothing tells, independent.
std::vector<VectorXcd> draw(const Problem& p, const std::vector<Errors>& errors, Random& random) {
  const auto circular = [&] {
    const double re = random.normal(), im = random.normal();
    return std::sqrt(0.5) * Complex{re, im};
  };
  std::vector<VectorXcd> noise;
  for (const Series& s : p.series) {
    noise.emplace_back(s.value.size());
    for (Index q = 0; errors.empty() && q < s.value.size(); ++q) noise.back()[q] = circular();
  }
  for (const Errors& e : errors) {
    const Index n = e.correlation.rows();
    VectorXcd z(n);
    for (Index i = 0; i < n; ++i) z[i] = circular();
    z = (ClassCorrelation{0, 0, 0.0, 0.0, e.correlation}.root() * z).eval();
    for (std::size_t i = 0; i < e.place.size(); ++i) {
      const Complex x = z[static_cast<Index>(i)];
      noise[e.place[i].series][e.place[i].row] = e.place[i].mirrored ? std::conj(x) : x;
    }
  }
  return noise;
}

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
