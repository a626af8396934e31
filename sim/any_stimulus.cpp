#include "any_stimulus.hpp"

#include <Eigen/LU>
#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/spectrum/fit.hpp"
#include "core/spectrum/lines.hpp"
#include "core/spectrum/twiddles.hpp"

namespace saltus {
namespace {

using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Eigen::VectorXd;
using Index = Eigen::Index;

struct Stretch {
  std::vector<double> u;               // every sample
  std::vector<std::vector<double>> y;  // [output][sample], scaled
  Index cycles = 0;
};

struct Problem {
  int sections = 0, outputs = 0, count = 0;
  std::vector<Stretch> runs;
  Index rows = 0;     // equations of a section: cycles after the first, all runs
  Index taps = 0;     // lags 1 ... taps
  Index columns = 0;  // taps, mean cycle, decay of each run
};

// x[k] + a_1 x_f[k - N] + ... : x / A.
std::vector<double> filtered(const std::vector<double>& x, const VectorXd& a, int sections) {
  std::vector<double> f = x;
  for (std::size_t k = 0; k < f.size(); ++k) {
    for (Index i = 0; i < a.size(); ++i) {
      const auto lag = static_cast<std::size_t>(i + 1) * static_cast<std::size_t>(sections);
      if (k >= lag) f[k] -= a[i] * f[k - lag];
    }
  }
  return f;
}

// The regressors of section n.
MatrixXd regressors(const Problem& p, const std::vector<std::vector<double>>& u_filtered, const VectorXd& a, Index n) {
  MatrixXd m = MatrixXd::Zero(p.rows, p.columns);
  Index row = 0;
  for (std::size_t r = 0; r < p.runs.size(); ++r) {
    const Index begin = row;
    for (Index c = 1; c < p.runs[r].cycles; ++c, ++row) {
      const Index k = c * p.sections + n;
      for (Index j = 1; j <= std::min(p.taps, k); ++j) {
        m(row, j - 1) = u_filtered[r][static_cast<std::size_t>(k - j)];
      }
      m(row, p.taps) = 1.0;
      for (Index i = 0; i < p.count; ++i) {  // free decay: starts with unit vectors
        const Index column = p.taps + 1 + static_cast<Index>(r) * p.count + i;
        double x = row - begin == i ? 1.0 : 0.0;
        if (row - begin >= p.count) {
          for (Index l = 0; l < p.count; ++l) x -= a[l] * m(row - 1 - l, column);
        }
        m(row, column) = x;
      }
    }
  }
  return m;
}

// A signal given at the equations of section n, filtered by z^-N / A and z^-2N / A, ...: one column a coefficient.
MatrixXd delayed(const Problem& p, const VectorXd& x, const VectorXd& a) {
  MatrixXd m = MatrixXd::Zero(p.rows, p.count);
  Index row = 0;
  for (const Stretch& run : p.runs) {
    VectorXd f(run.cycles - 1);
    for (Index c = 0; c + 1 < run.cycles; ++c) {
      f[c] = x[row + c];
      for (Index i = 0; i < p.count && i < c; ++i) f[c] -= a[i] * f[c - 1 - i];
    }
    for (Index c = 0; c + 1 < run.cycles; ++c) {
      for (Index i = 0; i < p.count && i < c; ++i) m(row + c, i) = f[c - 1 - i];
    }
    row += run.cycles - 1;
  }
  return m;
}

MatrixXd outputs_of(const Problem& p, Index n) {
  MatrixXd y(p.rows, p.outputs);
  Index row = 0;
  for (const Stretch& run : p.runs) {
    for (Index c = 1; c < run.cycles; ++c, ++row) {
      for (Index o = 0; o < p.outputs; ++o) {
        y(row, o) = run.y[static_cast<std::size_t>(o)][static_cast<std::size_t>(c * p.sections + n)];
      }
    }
  }
  return y;
}

using Qr = Eigen::ColPivHouseholderQR<MatrixXd>;

MatrixXd complement(const Qr& qr, MatrixXd x) {
  const Index rank = qr.rank();
  x.applyOnTheLeft(qr.householderQ().setLength(rank).adjoint());
  x.topRows(rank).setZero();
  x.applyOnTheLeft(qr.householderQ().setLength(rank));
  return x;
}

// The basic solution over the columns that the input tells apart.
VectorXd solve(const Qr& qr, VectorXd y) {
  const Index rank = qr.rank();
  y.applyOnTheLeft(qr.householderQ().setLength(rank).adjoint());
  VectorXd x = VectorXd::Zero(qr.cols());
  x.head(rank) = qr.matrixQR().topLeftCorner(rank, rank).triangularView<Eigen::Upper>().solve(y.head(rank));
  return qr.colsPermutation() * x;
}

struct Normal {
  MatrixXd matrix;
  VectorXd rhs;
  double cost = 0.0;
  double condition = 1.0;
  Index rank = 0;   // least over the sections
  VectorXd square;  // residual of each output
};

std::vector<std::vector<double>> filtered_inputs(const Problem& p, const VectorXd& a) {
  std::vector<std::vector<double>> f;
  for (const Stretch& run : p.runs) f.push_back(filtered(run.u, a, p.sections));
  return f;
}

// Calls visit(n, qr, y, residual, slopes of output o) for every section.
template <class Visit>
Normal sweep(const Problem& p, const VectorXd& a, bool modelled, Visit&& visit) {
  Normal normal{MatrixXd::Zero(p.count, p.count), VectorXd::Zero(p.count), 0.0, 1.0, p.columns,
                VectorXd::Zero(p.outputs)};
  const auto u = filtered_inputs(p, a);
  for (Index n = 0; n < p.sections; ++n) {
    MatrixXd m = regressors(p, u, a, n);
    VectorXd scale = m.colwise().norm();
    for (Index j = 0; j < scale.size(); ++j) scale[j] = scale[j] > 0.0 ? 1.0 / scale[j] : 1.0;
    m = m * scale.asDiagonal();
    Qr qr(p.rows, p.columns);
    qr.setThreshold(1e-6);
    qr.compute(m);
    const Index rank = qr.rank();
    normal.rank = std::min(normal.rank, rank);
    normal.condition = std::max(normal.condition, std::abs(qr.matrixQR()(0, 0) / qr.matrixQR()(rank - 1, rank - 1)));
    const MatrixXd y = outputs_of(p, n);
    const MatrixXd residual = complement(qr, y);
    for (Index o = 0; o < p.outputs; ++o) {
      // Measured values include the mean cycle, which does not pass through 1 / A.
      VectorXd moving = modelled ? VectorXd(y.col(o) - residual.col(o)) : VectorXd(y.col(o));
      const VectorXd b = scale.asDiagonal() * solve(qr, y.col(o));
      moving.array() -= b[p.taps];
      const MatrixXd raw = delayed(p, moving, a);
      const MatrixXd slope = complement(qr, raw);
      normal.matrix += slope.transpose() * slope;
      normal.rhs -= slope.transpose() * residual.col(o);
      normal.square[o] += residual.col(o).squaredNorm();
      visit(n, o, qr, scale, b, raw);
    }
  }
  normal.cost = normal.square.sum();
  return normal;
}

constexpr auto nothing = [](auto&&...) {};

}  // namespace

AnyStimulusFit identify_any_stimulus(const Record& record, const AnyStimulusOptions& o) {
  const auto refuse = [&](const char* what, const char* mend) { throw RecordError(record.name, what, mend); };
  if (!record.clock_paced()) refuse("its sections are not paced by a clock", "give `# sections: clock`");
  if (record.inputs.size() != 1) refuse("it has not one input", "keep one column in `# inputs`");
  if (o.count < 1 || o.count > 4) refuse("1 to 4 multipliers can be sought", "change the count");
  Problem p;
  p.sections = *record.sections_per_cycle;
  p.outputs = static_cast<int>(record.outputs.size());
  p.count = o.count;
  p.taps = (o.count + 1) * p.sections - 1;
  for (const Experiment& e : experiments(record)) {
    const Grid grid = on_grid(record, e);
    Stretch run;
    run.cycles = grid.cycles;
    if (run.cycles < o.count + 3) continue;
    run.u = grid.inputs[0];
    run.y = grid.outputs;
    const auto known = [](double x) { return std::isfinite(x); };
    if (!std::all_of(run.u.begin(), run.u.end(), known)) refuse("an input is missing", "fill the input column");
    for (const auto& y : run.y) {
      if (!std::all_of(y.begin(), y.end(), known)) refuse("an output is missing", "cut the experiment there");
    }
    p.rows += run.cycles - 1;
    p.runs.push_back(std::move(run));
  }
  p.columns = p.taps + 1 + static_cast<Index>(p.runs.size()) * o.count;
  if (p.rows < p.columns + p.columns / 4 + 4) {
    refuse("it has too few cycles for its multipliers and sections", "record longer, or seek fewer multipliers");
  }
  // Outputs in units of their own spread.
  std::vector<double> unit(static_cast<std::size_t>(p.outputs), 0.0);
  for (std::size_t c = 0; c < unit.size(); ++c) {
    double sum = 0.0, square = 0.0, count = 0.0;
    for (const Stretch& run : p.runs) {
      for (const double v : run.y[c]) sum += v, square += v * v, count += 1.0;
    }
    unit[c] = std::sqrt(std::max(square / count - sum * sum / (count * count), 1e-300));
    for (Stretch& run : p.runs) {
      for (double& v : run.y[c]) v /= unit[c];
    }
  }

  AnyStimulusFit fit;
  VectorXd a = VectorXd::Zero(o.count);
  for (int i = 0; i < 8; ++i) {
    const Normal n = sweep(p, a, false, nothing);
    const VectorXd step = n.matrix.ldlt().solve(n.rhs);
    a += step;
    if (step.norm() < 1e-3) break;
  }
  bool settled = false;
  Normal normal = sweep(p, a, true, nothing);
  for (int i = 0; i < 15 && !settled; ++i) {
    VectorXd step = normal.matrix.ldlt().solve(normal.rhs);
    Normal next = sweep(p, a + step, true, nothing);
    for (int half = 0; half < 5 && !(next.cost <= normal.cost * (1.0 + 1e-12)); ++half) {
      step *= 0.5;
      next = sweep(p, a + step, true, nothing);
    }
    a += step;
    normal = next;
    // Settled where another step is a tenth of the standard error: which taps the input tells is a matter of rank,
    // so the cost is smooth only down to that.
    const double unit_variance = normal.cost / (static_cast<double>(p.sections) * static_cast<double>(p.outputs) *
                                                static_cast<double>(p.rows - normal.rank));
    settled = step.dot(normal.matrix * step) < 1e-2 * unit_variance || step.norm() < 1e-9;
    if (!a.allFinite()) return fit;
  }
  fit.status = settled ? Status::ok : Status::failed;
  fit.condition = normal.condition;
  const double freedom = static_cast<double>(p.sections) * static_cast<double>(p.rows - normal.rank);
  VectorXd variance = normal.square / freedom;
  for (std::size_t c = 0; c < unit.size(); ++c) {
    fit.noise.push_back(std::sqrt(variance[static_cast<Index>(c)]) * unit[c]);
  }
  const double mean_variance = variance.mean();
  const MatrixXd covariance = mean_variance * normal.matrix.inverse();

  // The lines, and the responses of the taps there.
  const std::int64_t length = std::int64_t{p.sections} * o.period;
  std::vector<int> lines;
  for (int q = 1; q <= last_line_below(o.band, o.period); ++q) {
    if (identifiable(q, o.period)) lines.push_back(q);
  }
  const auto count = static_cast<Index>(lines.size());
  MatrixXcd response(p.taps, count);
  VectorXcd denominator = VectorXcd::Ones(count);
  for (Index q = 0; q < count; ++q) {
    const std::int64_t line = lines[static_cast<std::size_t>(q)];
    for (Index j = 1; j <= p.taps; ++j) response(j - 1, q) = root_of_unity(-line * j, length);
    for (Index k = 0; k < o.count; ++k) {
      denominator[q] += a[k] * root_of_unity(-line * (k + 1) * p.sections, length);
    }
  }
  const Index orders = 2 * o.harmonics + 1;
  std::vector<MatrixXcd> value(unit.size(), MatrixXcd::Zero(orders, count));
  std::vector<MatrixXd> spread(unit.size(), MatrixXd::Zero(orders, count));
  std::vector<std::vector<MatrixXcd>> slope(  // of H with respect to each coefficient of A, the taps following
      unit.size(), std::vector<MatrixXcd>(static_cast<std::size_t>(o.count), MatrixXcd::Zero(orders, count)));
  sweep(p, a, true,
        [&](Index n, Index output, const Qr& qr, const VectorXd& scale, const VectorXd& b, const MatrixXd& raw) {
          const auto c = static_cast<std::size_t>(output);
          const Index rank = qr.rank();
          const VectorXcd gain = (response.transpose() * b.head(p.taps)).cwiseQuotient(denominator);
          // Variance of a combination w . b: |R^-T P^T S w|^2, over the taps only.
          MatrixXcd weights = MatrixXcd::Zero(p.columns, count);
          weights.topRows(p.taps) = scale.head(p.taps).asDiagonal() * response;
          weights = (qr.colsPermutation().transpose() * weights).eval();
          const auto upper = qr.matrixQR().topLeftCorner(rank, rank).triangularView<Eigen::Upper>().transpose();
          const MatrixXd re = upper.solve(MatrixXd(weights.topRows(rank).real()));
          const MatrixXd im = upper.solve(MatrixXd(weights.topRows(rank).imag()));
          const VectorXd each = (re.colwise().squaredNorm() + im.colwise().squaredNorm())
                                    .transpose()
                                    .cwiseQuotient(denominator.cwiseAbs2());
          for (Index q = 0; q < count; ++q) {
            for (Index m = 0; m < orders; ++m) {
              const Complex turn = root_of_unity(-(m - o.harmonics) * n, p.sections) / static_cast<double>(p.sections);
              value[c](m, q) += gain[q] * turn;
              spread[c](m, q) += variance[output] * each[q] / (static_cast<double>(p.sections) * p.sections);
            }
          }
          for (Index k = 0; k < o.count; ++k) {
            const VectorXd follow =
                scale.asDiagonal() * solve(qr, raw.col(k));  // minus d(F b)/da: what the taps make up for
            const VectorXcd change = (response.transpose() * follow.head(p.taps)).cwiseQuotient(denominator);
            for (Index q = 0; q < count; ++q) {
              const Complex direct =
                  -gain[q] *
                  root_of_unity(-std::int64_t{lines[static_cast<std::size_t>(q)]} * (k + 1) * p.sections, length) /
                  denominator[q];
              for (Index m = 0; m < orders; ++m) {
                slope[c][static_cast<std::size_t>(k)](m, q) += (direct + change[q]) *
                                                               root_of_unity(-(m - o.harmonics) * n, p.sections) /
                                                               static_cast<double>(p.sections);
              }
            }
          }
        });

  fit.id.sections = p.sections;
  fit.id.period = o.period;
  for (const Stretch& run : p.runs) fit.id.samples += run.cycles * p.sections;
  for (Index m = 0; m < orders; ++m) {
    for (Index q = 0; q < count; ++q) {
      for (std::size_t c = 0; c < unit.size(); ++c) {
        double total = spread[c](m, q);
        for (Index k = 0; k < o.count; ++k) {
          for (Index l = 0; l < o.count; ++l) {
            total += covariance(k, l) * std::real(slope[c][static_cast<std::size_t>(k)](m, q) *
                                                  std::conj(slope[c][static_cast<std::size_t>(l)](m, q)));
          }
        }
        fit.id.htf.push_back({static_cast<int>(m) - o.harmonics, lines[static_cast<std::size_t>(q)],
                              static_cast<int>(c), value[c](m, q) * unit[c], std::sqrt(total) * unit[c],
                              static_cast<int>(p.rows)});
      }
    }
  }
  std::vector<Complex> z;
  const auto take = [&](auto coefficients) {
    for (std::size_t k = 0; k < coefficients.size(); ++k) coefficients[k] = a[static_cast<Index>(k)];
    for (const Complex& root : roots(coefficients)) z.push_back(root);
  };
  if (o.count == 1) take(std::array<double, 1>{});
  if (o.count == 2) take(std::array<double, 2>{});
  if (o.count == 3) take(std::array<double, 3>{});
  if (o.count == 4) take(std::array<double, 4>{});
  fit.multipliers = z;
  for (std::size_t i = 0; i < z.size(); ++i) {
    Complex steep = 1.0;
    for (std::size_t k = 0; k < z.size(); ++k) steep *= k == i ? 1.0 : z[i] - z[k];
    double sum = 0.0;
    for (int k = 0; k < o.count; ++k) {
      for (int l = 0; l < o.count; ++l) {
        sum +=
            covariance(k, l) * std::real(std::pow(z[i], o.count - 1 - k) * std::conj(std::pow(z[i], o.count - 1 - l)));
      }
    }
    fit.sigma.push_back(std::sqrt(sum) / std::abs(steep));
  }
  return fit;
}

std::vector<double> chirp_input(std::int64_t cycles, int sections, double band, double amplitude) {
  const std::int64_t samples = cycles * sections, span = std::max<std::int64_t>(1, samples / 5);
  std::vector<double> u;
  for (std::int64_t n = 0; n < samples; ++n) {
    const auto t = static_cast<double>(n % span);
    u.push_back(amplitude * std::cos(std::numbers::pi * band / sections * t * t / static_cast<double>(span) + 0.1));
  }
  return u;
}

std::vector<double> binary_input(std::int64_t cycles, int sections, double amplitude, std::uint64_t seed) {
  auto state = static_cast<std::uint32_t>(Random(seed).bits() >> 41) | 1u;  // 23 bits, not all zero
  std::vector<double> u;
  for (std::int64_t n = 0; n < cycles * sections; ++n) {
    const std::uint32_t bit = (state >> 22 ^ state >> 17) & 1u;  // x^23 + x^18 + 1 is primitive
    state = (state << 1 | bit) & 0x7fffffu;
    u.push_back(bit != 0 ? amplitude : -amplitude);
  }
  return u;
}

}  // namespace saltus
