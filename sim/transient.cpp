#include "transient.hpp"

#include <Eigen/QR>
#include <Eigen/SVD>
#include <unsupported/Eigen/FFT>

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

// A line that the input excites, and its class: cosine and sine in two columns of the steady response.
struct Tuned {
  int line = 0;
  Index column = 0;
  bool mirrored = false;  // the line is congruent to minus the class
};

// One experiment: cycles down, sections of all outputs across.
struct Sheet {
  MatrixXd y;
  MatrixXd steady;            // (cycles x unknowns of the excited classes), class 0 first
  std::vector<Tuned> tones;   // the strongest line of each class that a line can be told in
  std::size_t first_row = 0;  // of the record
  Index begin = 0, used = 0;  // cycles whose lines are taken: after settling, whole stimulus periods
  MatrixXd complement;        // (freedom x cycles but the first): what no steady response reaches
  MatrixXd free;              // (freedom x sections): y there
};

// Responses to the classes that the input excites, and the machine's own cycle (class 0).
void set_steady(Sheet& s, const std::vector<double>& u, int sections, int period, Index cycles) {
  const int length = sections * period;
  Eigen::FFT<double> fft;
  std::vector<Complex> spectrum;
  fft.fwd(spectrum, std::vector<double>(u.end() - length, u.end()));
  std::vector<double> power(static_cast<std::size_t>(period / 2 + 1), 0.0);
  std::vector<int> strongest(power.size(), 0);
  const auto strength = [&](int q) { return std::norm(spectrum[static_cast<std::size_t>(q)]); };
  for (int q = 1; 2 * q <= length; ++q) {
    const auto r = static_cast<std::size_t>(residue_class(q, period));
    power[r] += strength(q);
    if (strongest[r] == 0 || strength(q) > strength(strongest[r])) strongest[r] = q;
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
    const int q = strongest[static_cast<std::size_t>(r)];
    if (!real) s.tones.push_back({q, j, q % period != r});
    j += real ? 1 : 2;
  }
  s.steady = columns.leftCols(j);
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

// Sum of squares that neither the decay nor the excited classes explain, over all sheets. The first cycle, where the
// nilpotent part of the map still shows, is left out.
double unexplained(const std::vector<Sheet>& sheets, const VectorXd& a) {
  double sum = 0.0;
  for (const Sheet& s : sheets) {
    const Eigen::HouseholderQR<MatrixXd> qr(s.complement * decay_columns(a, s.y.rows() - 1));
    MatrixXd y = s.free;
    y.applyOnTheLeft(qr.householderQ().adjoint());
    sum += y.bottomRows(y.rows() - a.size()).squaredNorm();
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

// The decays that were found, in every sheet.
struct Decays {
  std::vector<MatrixXd> decay;      // (cycles but the first x count)
  std::vector<MatrixXd> gain;       // (count x cycles but the first): from measured cycles to the v of a section
  std::vector<MatrixXd> transient;  // (cycles x sections), the first cycle too
  VectorXd noise;                   // [unit] of each section, standard deviation
  double share = 1.0;               // of the noise of the v that is left by taking all v from the same few shapes
};

Decays find_decays(const std::vector<Sheet>& sheets, const VectorXd& a, int sections) {
  Decays d;
  const Index count = a.size(), across = sheets.front().y.cols();
  const auto height = count * static_cast<Index>(sheets.size());
  VectorXd rest = VectorXd::Zero(across);
  MatrixXd stack(height, across);
  std::vector<MatrixXd> upper;
  double freedom = 0.0;
  for (std::size_t e = 0; e < sheets.size(); ++e) {
    const Sheet& s = sheets[e];
    d.decay.push_back(decay_columns(a, s.y.rows() - 1));
    const Eigen::HouseholderQR<MatrixXd> qr(s.complement * d.decay.back());
    MatrixXd y = s.free, q = s.complement;
    y.applyOnTheLeft(qr.householderQ().adjoint());
    q.applyOnTheLeft(qr.householderQ().adjoint());
    stack.middleRows(static_cast<Index>(e) * count, count) = y.topRows(count);
    rest += y.bottomRows(y.rows() - count).colwise().squaredNorm().transpose();
    freedom += static_cast<double>(y.rows() - count);
    upper.push_back(qr.matrixQR().topRows(count).triangularView<Eigen::Upper>());
    d.gain.push_back(upper.back().triangularView<Eigen::Upper>().solve(q.topRows(count)));
  }
  d.noise.resize(across);
  for (Index c = 0; c < across; c += sections) {  // all sections of an output together
    const double mean = rest.segment(c, sections).sum() / (freedom * sections);
    d.noise.segment(c, sections).setConstant(std::sqrt(std::max(mean, 1e-300)));
  }
  // Every experiment starts `count` motions with shapes of their own, the same in all: the v have rank `count`.
  if (height > count) {
    const MatrixXd unit = stack * d.noise.cwiseInverse().asDiagonal();
    const Eigen::JacobiSVD<MatrixXd> svd(unit, Eigen::ComputeThinU | Eigen::ComputeThinV);
    const double cells = static_cast<double>(height * across), taken = static_cast<double>(count * (height + across - count));
    const double cut = svd.singularValues().tail(svd.singularValues().size() - count).squaredNorm();
    if (cut < cells - taken + 4.0 * std::sqrt(2.0 * (cells - taken))) {  // noise, by chi-square
      d.share = taken / cells;
      stack = svd.matrixU().leftCols(count) * svd.singularValues().head(count).asDiagonal() *
              svd.matrixV().leftCols(count).transpose() * d.noise.asDiagonal();
    }
  }
  for (std::size_t e = 0; e < sheets.size(); ++e) {
    const Sheet& s = sheets[e];
    const Index rows = s.y.rows() - 1;
    MatrixXd t(rows + 1, across);
    t.bottomRows(rows) = d.decay[e] * upper[e].triangularView<Eigen::Upper>().solve(
                                          stack.middleRows(static_cast<Index>(e) * count, count));
    const MatrixXd steady = s.steady.bottomRows(rows).householderQr().solve(s.y.bottomRows(rows) - t.bottomRows(rows));
    t.row(0) = s.y.row(0) - s.steady.row(0) * steady;
    d.transient.push_back(std::move(t));
  }
  return d;
}

// Sum of squares of what the sections of an output show on the excited lines, from the cosines and sines of the classes.
double on_lines(const std::vector<Tuned>& tones, const MatrixXd& classes, Index first, int sections, int period) {
  double sum = 0.0;
  for (std::size_t k = 0; k < tones.size(); ++k) {
    Complex y{};
    for (Index n = 0; n < sections; ++n) {
      const double re = classes(2 * static_cast<Index>(k), first + n), im = classes(2 * static_cast<Index>(k) + 1, first + n);
      y += Complex(re, tones[k].mirrored ? im : -im) *
           root_of_unity(-std::int64_t{tones[k].line} * n, std::int64_t{sections} * period);
    }
    sum += std::norm(y) / (static_cast<double>(sections) * sections);
  }
  return sum;
}

// Expected errors of H_0 with the transient dropped and modelled.
void weigh(const std::vector<Sheet>& sheets, const Decays& d, int sections, int period, TransientRemoval& r) {
  const Index outputs = sheets.front().y.cols() / sections;
  VectorXd left = VectorXd::Zero(outputs), response = left, noise(outputs);
  double dropping = 0.0, modelling = 0.0, seen = 0.0;  // noise let through, for noise of one
  // A line that several experiments play is averaged: noise gets less, a transient that comes with each does not.
  std::set<int> lines_played;
  double plays = 0.0;
  for (const Sheet& s : sheets) {
    for (const Tuned& t : s.tones) {
      lines_played.insert(t.line);
      plays += 1.0;
    }
  }
  const double each = plays / static_cast<double>(lines_played.size());
  for (Index c = 0; c < outputs; ++c) noise[c] = d.noise[c * sections] * d.noise[c * sections] / sections;
  for (std::size_t e = 0; e < sheets.size(); ++e) {
    const Sheet& s = sheets[e];
    const Index rows = s.y.rows() - 1;
    MatrixXd lines = MatrixXd::Zero(2 * static_cast<Index>(s.tones.size()), rows + 1);  // classes from the cycles
    for (std::size_t k = 0; k < s.tones.size(); ++k) {
      lines.block(2 * static_cast<Index>(k), s.begin, 2, s.used) =
          s.steady.block(s.begin, s.tones[k].column, s.used, 2).transpose() / static_cast<double>(s.used);
    }
    // The first cycle is told by the others where it counts.
    MatrixXd told = MatrixXd::Zero(lines.rows(), rows);
    if (s.begin == 0) {
      const MatrixXd all = s.steady.bottomRows(rows);
      const MatrixXd gain = all.householderQr().solve(MatrixXd::Identity(rows, rows));
      told = lines.col(0) * (s.steady.row(0) * gain);
    }
    const MatrixXd later = lines.rightCols(rows) + told;
    const MatrixXd through = later * d.decay[e] * d.gain[e];
    dropping += lines.squaredNorm();
    modelling += later.squaredNorm() + d.share * (through.squaredNorm() - 2.0 * later.cwiseProduct(through).sum());
    seen += lines.col(0).squaredNorm() + told.squaredNorm() +
            d.share * (through.squaredNorm() - 2.0 * told.cwiseProduct(through).sum());
    const MatrixXd leak = lines * d.transient[e], answer = lines * (s.y - d.transient[e]);
    for (Index c = 0; c < outputs; ++c) {
      left[c] += on_lines(s.tones, leak, c * sections, sections, period);
      response[c] += on_lines(s.tones, answer, c * sections, sections, period);
    }
  }
  double drop = 0.0, model = 0.0;
  for (Index c = 0; c < outputs; ++c) {
    const double size = std::max(response[c] - modelling * noise[c], 0.1 * response[c]) * static_cast<double>(outputs);
    drop += (std::max(0.0, left[c] - seen * noise[c]) + dropping * noise[c] / each) / size;
    model += modelling * noise[c] / each / size;
  }
  r.dropped = std::sqrt(drop);
  r.modelled = std::sqrt(model);
  r.inflation = std::sqrt(modelling / dropping);
}

}  // namespace

TransientRemoval remove_transient(Record& record, int count, TransientChoice choice) {
  TransientRemoval r;
  if (!record.clock_paced() || !record.stimulus_period_cycles || record.inputs.size() != 1 || count < 1 || count > 2 ||
      choice == TransientChoice::drop)
    return r;
  const int sections = *record.sections_per_cycle, period = *record.stimulus_period_cycles;
  std::vector<Sheet> sheets;
  double square = 0.0;
  std::int64_t numbers = 0;
  // Outputs in units of their own spread, so that they weigh alike, about their mean.
  std::vector<double> mean, unit;
  for (const Channel& c : record.outputs) {
    double m = 0.0, spread = 0.0;
    for (const double v : c.values) m += v / static_cast<double>(c.values.size());
    for (const double v : c.values) spread += (v - m) * (v - m) / static_cast<double>(c.values.size());
    if (!std::isfinite(spread)) return r;
    mean.push_back(m);
    unit.push_back(std::sqrt(spread));
  }
  for (const Experiment& e : experiments(record)) {
    const Grid grid = on_grid(record, e);
    const auto cycles = static_cast<Index>(grid.cycles);
    if (grid.missing_rows > 0 || e.rows != static_cast<std::size_t>(grid.cycles * sections)) return r;
    if (cycles < period) return r;
    const auto outputs = static_cast<Index>(grid.outputs.size());
    Sheet s;
    s.y.resize(cycles, sections * outputs);
    set_steady(s, grid.inputs[0], sections, period, cycles);
    s.first_row = e.first_row;
    s.begin = settling_cycles(record, grid);
    s.used = s.begin < cycles ? (cycles - s.begin) / period * period : 0;
    if (s.used == 0 || s.tones.empty() || cycles - 1 < s.steady.cols() + count + 1) return r;
    for (Index c = 0; c < outputs; ++c) {
      const auto at = static_cast<std::size_t>(c);
      const double scale = unit[at] > 0.0 ? 1.0 / unit[at] : 0.0;
      for (Index i = 0; i < cycles; ++i) {
        for (Index n = 0; n < sections; ++n) {
          s.y(i, c * sections + n) = scale * (grid.outputs[at][static_cast<std::size_t>(i * sections + n)] - mean[at]);
        }
      }
    }
    if (!s.y.allFinite()) return r;
    const Eigen::HouseholderQR<MatrixXd> qr(s.steady.bottomRows(cycles - 1));
    MatrixXd basis = MatrixXd::Identity(cycles - 1, cycles - 1);
    basis.applyOnTheLeft(qr.householderQ().adjoint());
    s.complement = basis.bottomRows(cycles - 1 - s.steady.cols());
    s.free = s.complement * s.y.bottomRows(cycles - 1);
    square += s.y.bottomRows(cycles - 1).squaredNorm();
    numbers += (cycles - 1) * s.y.cols();
    sheets.push_back(std::move(s));
  }
  if (sheets.empty() || !(square > 0.0)) return r;
  double before = 0.0;
  for (const Sheet& s : sheets) before += s.free.squaredNorm();
  r.before = std::sqrt(before / square);
  const VectorXd a = seek(sheets, count);
  r.after = std::sqrt(unexplained(sheets, a) / square);
  if (count == 2) {
    for (const Complex& z : roots(std::array<double, 2>{a[0], a[1]})) r.multipliers.push_back(z);
  } else {
    r.multipliers.push_back(-a[0]);
  }
  const Decays decays = find_decays(sheets, a, sections);
  weigh(sheets, decays, sections, period, r);
  // A gain of less than a twentieth is within what the two expectations are good to.
  const bool better = r.modelled < 0.95 * r.dropped;
  if (!(std::abs(r.multipliers[0]) < 1.0) || (choice == TransientChoice::automatic && !better)) return r;

  double start = 0.0;
  std::int64_t places = 0;
  for (std::size_t e = 0; e < sheets.size(); ++e) {
    const MatrixXd& transient = decays.transient[e];
    start += transient.row(1).squaredNorm();
    places += transient.cols();
    for (std::size_t c = 0; c < record.outputs.size(); ++c) {
      std::vector<double>& y = record.outputs[c].values;
      for (Index i = 0; i < transient.rows(); ++i) {
        for (Index k = 0; k < sections; ++k) {
          y[sheets[e].first_row + static_cast<std::size_t>(i * sections + k)] -=
              unit[c] * transient(i, static_cast<Index>(c) * sections + k);
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
