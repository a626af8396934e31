#include "transient.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "core/spectrum/fit.hpp"
#include "core/spectrum/lines.hpp"
#include "core/spectrum/twiddles.hpp"

namespace saltus {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using Index = Eigen::Index;

// One experiment: cycles down, sections of all outputs across.
struct Sheet {
  MatrixXd y;
  MatrixXd steady;            // (cycles x unknowns of the excited classes)
  std::size_t first_row = 0;  // of the record
};

// Responses to the classes that the input excites, and the machine's own cycle (class 0).
MatrixXd steady_columns(const std::vector<double>& u, int sections, int period, Index cycles) {
  const int length = sections * period;
  std::vector<double> power(static_cast<std::size_t>(period / 2 + 1), 0.0);
  for (int n = 0; n < sections; ++n) {  // section by section, the cycles' own transform tells the classes
    for (int r = 0; r <= period / 2; ++r) {
      Complex sum{};
      for (int c = 0; c < period; ++c) {
        const auto at = u.size() - static_cast<std::size_t>(length) + static_cast<std::size_t>(c * sections + n);
        sum += u[at] * root_of_unity(-std::int64_t{r} * c, period);
      }
      power[static_cast<std::size_t>(r)] += std::norm(sum);
    }
  }
  const double largest = *std::max_element(power.begin(), power.end());
  std::vector<int> classes{0};
  for (int r = 1; r <= period / 2; ++r) {
    if (power[static_cast<std::size_t>(r)] > 1e-6 * largest) classes.push_back(r);
  }
  MatrixXd columns(cycles, 2 * static_cast<Index>(classes.size()));
  Index j = 0;
  for (const int r : classes) {
    const bool real = 2 * r % period == 0;
    for (Index c = 0; c < cycles; ++c) {
      const Complex w = root_of_unity(std::int64_t{r} * c, period);
      columns(c, j) = w.real();
      if (!real) columns(c, j + 1) = w.imag();
    }
    j += real ? 1 : 2;
  }
  return columns.leftCols(j);
}

// lambda^c, real and imaginary parts, from the coefficients of the polynomial whose roots the multipliers are.
MatrixXd decay_columns(const VectorXd& a, Index cycles) {
  MatrixXd columns = MatrixXd::Zero(cycles, a.size());
  // The solutions of d[c] + a_0 d[c-1] + ... = 0 that start with a unit vector: no root is needed.
  for (Index i = 0; i < a.size(); ++i) {
    for (Index c = 0; c < cycles; ++c) {
      double x = c == i ? 1.0 : 0.0;
      if (c >= a.size()) {
        for (Index k = 0; k < a.size(); ++k) x -= a[k] * columns(c - 1 - k, i);
      }
      columns(c, i) = x;
    }
  }
  return columns;
}

// Sum of squares that neither the decay nor the excited classes explain, over all sheets; without decay when a is
// empty. The first cycle, where the nilpotent part of the map still shows, is left out.
double unexplained(const std::vector<Sheet>& sheets, const VectorXd& a) {
  double sum = 0.0;
  for (const Sheet& s : sheets) {
    const Index rows = s.y.rows() - 1;
    MatrixXd design(rows, a.size() + s.steady.cols());
    design << decay_columns(a, rows), s.steady.bottomRows(rows);
    const Eigen::HouseholderQR<MatrixXd> qr(design);
    MatrixXd y = s.y.bottomRows(rows);
    y.applyOnTheLeft(qr.householderQ().adjoint());
    sum += y.bottomRows(rows - design.cols()).squaredNorm();
  }
  return sum;
}

VectorXd coefficients(int count, double radius, double angle) {
  VectorXd a(count);
  if (count == 1) {
    a << -radius * std::cos(angle);
  } else {
    a << -2.0 * radius * std::cos(angle), radius * radius;
  }
  return a;
}

// The decay that leaves least: a coarse grid of the unit disc, then a simplex-free descent by shrinking steps.
VectorXd seek(const std::vector<Sheet>& sheets, int count) {
  VectorXd best;
  double least = std::numeric_limits<double>::infinity();
  const auto consider = [&](const VectorXd& a) {
    const double cost = unexplained(sheets, a);
    if (!(cost < least)) return false;
    least = cost;
    best = a;
    return true;
  };
  constexpr double pi = std::numbers::pi;
  for (const double radius : {0.25, 0.5, 0.7, 0.85}) {
    const int angles = count == 1 ? 2 : 9;
    for (int i = 0; i < angles; ++i) consider(coefficients(count, radius, pi * i / (angles - 1)));
  }
  double step = 0.2;
  // Newton's method on a quadratic through the points around; shrinking the stencil with the step.
  while (step > 1e-7) {
    const VectorXd centre = best;
    const double middle = least;
    VectorXd gradient(count);
    MatrixXd curvature(count, count);
    const auto cost = [&](Index i, double di, Index j, double dj) {
      VectorXd a = centre;
      a[i] += di;
      a[j] += dj;
      return unexplained(sheets, a);
    };
    const double h = std::max(0.1 * step, 1e-5);
    for (Index i = 0; i < count; ++i) {
      const double up = cost(i, h, i, 0.0), down = cost(i, -h, i, 0.0);
      gradient[i] = (up - down) / (2.0 * h);
      curvature(i, i) = (up - 2.0 * middle + down) / (h * h);
      for (Index j = 0; j < i; ++j) {
        curvature(i, j) = curvature(j, i) =
            (cost(i, h, j, h) - cost(i, h, j, -h) - cost(i, -h, j, h) + cost(i, -h, j, -h)) / (4.0 * h * h);
      }
    }
    VectorXd move = -curvature.colPivHouseholderQr().solve(gradient);
    if (!move.allFinite() || move.norm() > step) move *= step / std::max(move.norm(), step);
    if (!move.allFinite() || !consider(centre + move)) {
      if (!consider(centre - step * gradient / std::max(gradient.norm(), 1e-300))) step *= 0.3;
      continue;
    }
    step = std::min(step, 4.0 * move.norm());
  }
  return best;
}

}  // namespace

TransientRemoval remove_transient(Record& record, int count) {
  TransientRemoval r;
  if (!record.clock_paced() || !record.stimulus_period_cycles || record.inputs.size() != 1 || count < 1 || count > 2)
    return r;
  const int sections = *record.sections_per_cycle, period = *record.stimulus_period_cycles;
  std::vector<Sheet> sheets;
  double square = 0.0;
  std::int64_t numbers = 0;
  for (const Experiment& e : experiments(record)) {
    const Grid grid = on_grid(record, e);
    const auto cycles = static_cast<Index>(grid.cycles);
    if (grid.missing_rows > 0 || e.rows != static_cast<std::size_t>(grid.cycles * sections)) return r;
    if (cycles < period) return r;
    const auto outputs = static_cast<Index>(grid.outputs.size());
    Sheet s{MatrixXd(cycles, sections * outputs), steady_columns(grid.inputs[0], sections, period, cycles), e.first_row};
    if (cycles - 1 < s.steady.cols() + count + 2) return r;
    for (Index c = 0; c < outputs; ++c) {
      const std::vector<double>& y = grid.outputs[static_cast<std::size_t>(c)];
      double mean = 0.0, spread = 0.0;
      for (const double v : y) mean += v / static_cast<double>(y.size());
      for (const double v : y) spread += (v - mean) * (v - mean) / static_cast<double>(y.size());
      const double unit = spread > 0.0 ? 1.0 / std::sqrt(spread) : 0.0;  // outputs of different units weigh alike
      for (Index i = 0; i < cycles; ++i) {
        for (Index n = 0; n < sections; ++n) {
          s.y(i, c * sections + n) = unit * (y[static_cast<std::size_t>(i * sections + n)] - mean);
        }
      }
    }
    if (!s.y.allFinite()) return r;
    square += s.y.bottomRows(cycles - 1).squaredNorm();
    numbers += (cycles - 1) * s.y.cols();
    sheets.push_back(std::move(s));
  }
  if (sheets.empty() || !(square > 0.0)) return r;
  r.before = std::sqrt(unexplained(sheets, VectorXd()) / square);
  const VectorXd a = seek(sheets, count);
  r.after = std::sqrt(unexplained(sheets, a) / square);
  if (count == 2) {
    for (const Complex& z : roots(std::array<double, 2>{a[0], a[1]})) r.multipliers.push_back(z);
  } else {
    r.multipliers.push_back(-a[0]);
  }
  if (!(std::abs(r.multipliers[0]) < 1.0) || !(r.after < r.before)) return r;

  double start = 0.0;
  std::int64_t places = 0;
  for (const Sheet& s : sheets) {
    const Index rows = s.y.rows() - 1;
    const MatrixXd decay = decay_columns(a, rows);
    MatrixXd design(rows, count + s.steady.cols());
    design << decay, s.steady.bottomRows(rows);
    const MatrixXd v = design.householderQr().solve(s.y.bottomRows(rows)).topRows(count);
    const MatrixXd transient = decay * v;
    start += transient.row(0).squaredNorm();
    places += transient.cols();
    for (std::size_t c = 0; c < record.outputs.size(); ++c) {
      // Back in the output's unit.
      std::vector<double>& y = record.outputs[c].values;
      const std::size_t n = static_cast<std::size_t>(rows + 1) * static_cast<std::size_t>(sections);
      double mean = 0.0, spread = 0.0;
      for (std::size_t i = 0; i < n; ++i) mean += y[s.first_row + i] / static_cast<double>(n);
      for (std::size_t i = 0; i < n; ++i) {
        spread += (y[s.first_row + i] - mean) * (y[s.first_row + i] - mean) / static_cast<double>(n);
      }
      for (Index i = 0; i < rows; ++i) {
        for (Index k = 0; k < sections; ++k) {
          y[s.first_row + static_cast<std::size_t>((i + 1) * sections + k)] -=
              std::sqrt(spread) * transient(i, static_cast<Index>(c) * sections + k);
        }
      }
    }
  }
  // Cycles after which the transient is as small as what it was taken out to.
  const double size = std::sqrt(start / static_cast<double>(places));
  const double floor = std::max(r.after * std::sqrt(square / static_cast<double>(numbers)), 1e-15);
  r.cycles_saved =
      static_cast<int>(std::ceil(std::max(0.0, std::log(floor / size) / std::log(std::abs(r.multipliers[0])))));
  r.removed = true;
  return r;
}

}  // namespace saltus
