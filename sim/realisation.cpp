#include "realisation.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <stdexcept>

#include "core/random.hpp"
#include "eigenvalues.hpp"
#include "multiplier_region.hpp"
#include "periodic_model.hpp"
#include "singular_values.hpp"

namespace saltus {
namespace {

using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Index = Eigen::Index;

constexpr double turn = 2.0 * std::numbers::pi;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

// G_n(omega_q), (N x ny) for each line.
std::vector<MatrixXcd> gains(const std::vector<MatrixXcd>& htf, Index sections) {
  MatrixXcd fourier(sections, sections);
  for (Index n = 0; n < sections; ++n) {
    for (Index m = 0; m < sections; ++m) fourier(n, m) = root_of_unity(n * m, sections);
  }
  std::vector<MatrixXcd> g;
  for (const MatrixXcd& h : htf) g.push_back(fourier * h);
  return g;
}

// Outputs of the cycle from section n on, one column a line, real parts beside imaginary ones; outputs in units of
// `scale`. What the inputs of that cycle explain is projected out: the returned triangle has the same singular values
// and left singular vectors as the projected data.
MatrixXd projected(const std::vector<MatrixXcd>& g, const std::vector<double>& omega, Index n,
                   const Eigen::VectorXd& scale) {
  const Index lines = static_cast<Index>(g.size()), sections = g[0].rows(), ny = g[0].cols();
  MatrixXd data(2 * lines, sections * (1 + ny));  // transposed
  for (Index q = 0; q < lines; ++q) {
    for (Index j = 0; j < sections; ++j) {
      const Complex w = phasor(omega[at(q)] * static_cast<double>(j));
      data(q, j) = w.real();
      data(lines + q, j) = w.imag();
      for (Index c = 0; c < ny; ++c) {
        const Complex y = g[at(q)]((n + j) % sections, c) * w / scale[c];
        data(q, sections + j * ny + c) = y.real();
        data(lines + q, sections + j * ny + c) = y.imag();
      }
    }
  }
  const Eigen::HouseholderQR<MatrixXd> qr(data);
  MatrixXd r = qr.matrixQR().block(sections, sections, sections * ny, sections * ny);
  return r.triangularView<Eigen::Upper>().transpose();
}

Eigen::VectorXd scales(const HtfTable& t, const std::vector<MatrixXcd>& g) {
  Eigen::VectorXd scale = Eigen::VectorXd::Zero(t.outputs);
  for (const MatrixXcd& x : g) scale += x.colwise().squaredNorm().transpose();
  scale = (scale / static_cast<double>(g.size() * at(t.sections))).cwiseSqrt();
  for (Index c = 0; c < t.outputs; ++c) {
    if (!(scale[c] > 0.0)) throw std::invalid_argument("an output does not respond: nothing to realise");
  }
  return scale;
}

std::vector<MatrixXcd> noise_like(const HtfTable& t, Random& random) {
  std::vector<MatrixXcd> e;
  const auto circular = [&] {
    const double re = random.normal(), im = random.normal();
    return Complex{re, im} / std::numbers::sqrt2;
  };
  for (std::size_t q = 0; q < t.sigma.size(); ++q) {
    const MatrixXd& s = t.sigma[q];
    MatrixXcd x = MatrixXcd::Zero(s.rows(), s.cols());
    if (t.errors.empty()) {
      for (Index i = 0; i < s.rows(); ++i) {
        for (Index c = 0; c < s.cols(); ++c) x(i, c) = s(i, c) * circular();
      }
    } else {
      const ClassCorrelation& own = t.errors[q];
      Eigen::VectorXcd z(own.matrix.rows());
      for (Complex& one : z) one = circular();
      z = (own.root() * z).eval();
      for (int m = -own.harmonics; m <= own.harmonics; ++m) {
        const auto row = static_cast<Index>(wrap(m, t.sections));
        for (int c = 0; c < t.outputs; ++c) x(row, c) = s(row, c) * z[own.row(m, c)];
      }
    }
    e.push_back(x);
  }
  return e;
}

std::vector<Complex> multipliers_at(const PeriodicModel& m, int section) {
  const MatrixXd mono = m.monodromy(section);
  return nonzero_multipliers(mono);
}

// The columns of the observability matrix of each section, in units of `scale`.
std::vector<MatrixXd> observability(const std::vector<MatrixXcd>& g, const HtfTable& t, const Eigen::VectorXd& scale,
                                    const RealisationOptions& o, const std::vector<int>* dims, double noise,
                                    Realisation& out) {
  std::vector<MatrixXd> basis;
  Index largest = 0;
  for (Index n = 0; n < t.sections; ++n) {
    const SingularValues svd = left_singular_vectors(projected(g, t.omega, n, scale));
    const auto& s = svd.sigma;
    const double threshold = std::max(noise, o.tolerance * s[0]);
    Index dim = 0;
    if (dims != nullptr) {
      dim = (*dims)[at(n)];
    } else {
      while (dim < s.size() - 1 && s[dim] > threshold) ++dim;
      if (o.order > 0) dim = std::min<Index>(dim, o.order);
      dim = std::max<Index>(dim, 1);
    }
    basis.push_back(svd.u.leftCols(dim));
    if (dim > largest) {
      largest = dim;
      out.threshold = threshold;
      out.singular.assign(s.data(), s.data() + std::min<Index>(s.size(), dim + 4));
    }
  }
  return basis;
}

void build(const std::vector<MatrixXcd>& g, const HtfTable& t, const RealisationOptions& o,
           const std::vector<int>* dims, double noise, Realisation& r) {
  const Eigen::VectorXd scale = scales(t, g);
  const std::vector<MatrixXd> basis = observability(g, t, scale, o, dims, noise, r);
  PeriodicModel& m = r.model;
  m = PeriodicModel{t.sections, t.outputs, {}, {}, {}};
  const Index ny = t.outputs, rows = (t.sections - 1) * ny;
  for (Index n = 0; n < t.sections; ++n) {
    const MatrixXd& next = basis[at((n + 1) % t.sections)];
    m.A.push_back(next.topRows(rows).completeOrthogonalDecomposition().solve(basis[at(n)].bottomRows(rows)));
    m.C.push_back(scale.asDiagonal() * basis[at(n)].topRows(ny));
  }
  fit_inputs(t, g, scale, m);
}

// Largest singular value of the noise alone, over the sections looked at.
double noise_level(const HtfTable& t, const Eigen::VectorXd& scale, Random& random) {
  bool exact = true;
  for (const MatrixXd& s : t.sigma) exact = exact && !(s.maxCoeff() > 0.0);
  if (exact) return 0.0;
  double level = 0.0;
  for (Index draw = 0; draw < 6; ++draw) {
    const auto e = gains(noise_like(t, random), t.sections);
    level = std::max(level, singular_values(projected(e, t.omega, draw * t.sections / 6, scale)).sigma[0]);
  }
  return 1.05 * level;
}

// The outermost pair of harmonics that was measured; 0 where none beside H_0 was.
Index outermost_pair(const HtfTable& t) {
  Index outermost = 0;
  for (const MatrixXcd& h : t.value) {
    for (Index m = 1; 2 * m <= t.sections; ++m) {
      if (h.row(m).squaredNorm() + h.row(t.sections - m).squaredNorm() > 0.0) outermost = std::max(outermost, m);
    }
  }
  return outermost;
}

// Largest singular value of the outermost measured pair alone, over the sections looked at, where others are missing.
double missing_level(const HtfTable& t, const Eigen::VectorXd& scale) {
  const Index m = outermost_pair(t);
  if (m == 0 || 2 * m >= t.sections) return 0.0;
  std::vector<MatrixXcd> pair;
  for (const MatrixXcd& h : t.value) {
    MatrixXcd alone = MatrixXcd::Zero(h.rows(), h.cols());
    alone.row(m) = h.row(m);
    alone.row(t.sections - m) = h.row(t.sections - m);
    pair.push_back(alone);
  }
  const std::vector<MatrixXcd> g = gains(pair, t.sections);
  double level = 0.0;
  for (Index look = 0; look < 6; ++look) {
    level = std::max(level, singular_values(projected(g, t.omega, look * t.sections / 6, scale)).sigma[0]);
  }
  return 1.05 * level;
}

int rank_of_map(const MatrixXd& map) {
  int rank = 0;
  for (const double sigma : singular_values(map).sigma) rank += sigma > 1e-6 ? 1 : 0;
  return rank;
}

}  // namespace

Bounds rank_bounds(const std::vector<MatrixXd>& maps) {
  std::vector<int> ranks, inside;  // dimensions of the sections; the product begins and ends at the least
  for (const MatrixXd& a : maps) {
    ranks.push_back(rank_of_map(a));
    inside.push_back(static_cast<int>(a.cols()));
  }
  if (!inside.empty()) inside.erase(std::min_element(inside.begin(), inside.end()));
  return sylvester(ranks, inside);
}

HtfTable table_of(const Identification& id, int outputs) {
  HtfTable t;
  t.sections = id.sections;
  t.outputs = outputs;
  std::map<int, std::size_t> place;
  for (const HtfEstimate& h : id.htf) {
    if (h.output >= outputs || h.input != 0) continue;
    const auto [where, fresh] = place.emplace(h.line, t.omega.size());
    if (fresh) {
      t.omega.push_back(turn * h.line / (static_cast<double>(id.period) * id.sections));
      t.value.emplace_back(MatrixXcd::Zero(id.sections, outputs));
      t.sigma.emplace_back(MatrixXd::Zero(id.sections, outputs));
    }
    const auto m = static_cast<Index>(wrap(h.m, id.sections));
    t.value[where->second](m, h.output) = h.value;
    t.sigma[where->second](m, h.output) = std::isfinite(h.sigma) ? h.sigma : 0.0;
  }
  for (const auto& [line, q] : place) {
    const ClassCorrelation* errors = id.correlation(line);
    if (errors == nullptr || errors->matrix.rows() != (2 * errors->harmonics + 1) * outputs) return t;
  }
  t.errors.resize(t.omega.size());
  for (const auto& [line, q] : place) t.errors[q] = *id.correlation(line);
  return t;
}

Realisation realise(const HtfTable& t, const RealisationOptions& o) {
  if (t.sections < 2 || t.outputs < 1 || t.omega.size() * 2 < at(t.sections) * at(t.outputs + 1) + 8) {
    throw std::invalid_argument("a realisation needs at least " +
                                std::to_string((t.sections * (t.outputs + 1) + 9) / 2) + " lines; there are " +
                                std::to_string(t.omega.size()));
  }
  Realisation r;
  const std::vector<MatrixXcd> g = gains(t.value, t.sections);
  Random random(o.seed);
  const double noise = noise_level(t, scales(t, g), random);
  r.limit = missing_level(t, scales(t, g));
  build(g, t, o, nullptr, std::max(noise, r.limit), r);

  const int least = r.model.smallest_section();
  r.rank = rank_of_map(r.model.monodromy(least));
  r.multipliers = multipliers_at(r.model, least);
  for (int n = 0; n < t.sections; ++n) {
    const auto other = multipliers_at(r.model, n);
    for (std::size_t i = 0; i < std::min(other.size(), r.multipliers.size()); ++i) {
      r.inconsistency = std::max(r.inconsistency, std::abs(other[i] - r.multipliers[i]));
    }
  }
  Eigen::VectorXd largest = Eigen::VectorXd::Zero(t.outputs);
  for (const MatrixXcd& h : t.value) largest = largest.cwiseMax(h.row(0).cwiseAbs().transpose());
  double square = 0.0;
  for (std::size_t q = 0; q < t.omega.size(); ++q) {
    const MatrixXcd d = r.model.htf(t.omega[q]) - t.value[q];
    for (Index c = 0; c < t.outputs; ++c) {
      r.error = std::max(r.error, d.col(c).cwiseAbs().maxCoeff() / largest[c]);
      square += d.col(c).squaredNorm() / (largest[c] * largest[c]);
    }
  }
  r.error_rms = std::sqrt(square / static_cast<double>(t.omega.size() * at(t.sections) * at(t.outputs)));

  if (o.replicates < 2 || noise == 0.0) return r;
  // Parametric bootstrap: the realised model's own HTFs with fresh noise, realised again with the same dimensions.
  std::vector<int> dims;
  for (int n = 0; n < t.sections; ++n) dims.push_back(r.model.dim(n));
  HtfTable drawn = t;
  std::vector<MatrixXcd> clean;
  for (const double omega : t.omega) clean.push_back(r.model.htf(omega));
  const auto shift = [&](const HtfTable& table, const std::vector<int>& sizes) {
    Realisation again;
    build(gains(table.value, t.sections), table, o, &sizes, noise, again);
    std::vector<double> moved;
    const auto z = multipliers_at(again.model, least);
    for (const Complex& one : r.multipliers) {
      double nearest = std::abs(one);  // one that is gone is off by its own size
      for (const Complex& x : z) nearest = std::min(nearest, std::abs(x - one));
      moved.push_back(nearest * nearest);
    }
    return moved;
  };
  std::vector<double> spread(r.multipliers.size(), 0.0);
  for (int b = 0; b < o.replicates; ++b) {
    const auto e = noise_like(t, random);
    for (std::size_t q = 0; q < clean.size(); ++q) drawn.value[q] = clean[q] + e[q];
    const auto moved = shift(drawn, dims);
    for (std::size_t i = 0; i < spread.size(); ++i) spread[i] += moved[i] / o.replicates;
  }
  // States just below the noise are left out, which is a bias of their size: what one more in each section changes.
  std::vector<int> wider = dims;
  for (int& d : wider) ++d;
  std::vector<double> bias = shift(t, wider);
  // Harmonics that were not measured are another: what the outermost measured pair changes.
  const Index outermost = outermost_pair(t);
  if (2 * outermost < t.sections && outermost > 0) {
    HtfTable fewer = t;
    for (MatrixXcd& h : fewer.value) {
      h.row(outermost).setZero();
      h.row(t.sections - outermost).setZero();
    }
    const auto missing = shift(fewer, dims);
    for (std::size_t i = 0; i < bias.size(); ++i) bias[i] += missing[i];
  }
  for (std::size_t i = 0; i < spread.size(); ++i) r.sigma.push_back(std::sqrt(spread[i] + bias[i]));
  return r;
}

Realisation realise(const Identification& id, int outputs, const RealisationOptions& o) {
  Realisation r = realise(table_of(id, outputs), o);
  RegionOptions options;
  options.count = std::clamp<int>(static_cast<int>(r.multipliers.size()), 1, 4);
  const MultiplierRegion region = multiplier_region(id, outputs, options);
  if (!usable(region.status)) return r;
  r.sigma.resize(r.multipliers.size(), 0.0);
  for (std::size_t i = 0; i < r.multipliers.size(); ++i) {
    double nearest = std::abs(r.multipliers[i]), sigma = 0.0;  // one that is not there is off by its own size
    for (std::size_t k = 0; k < region.multipliers.size(); ++k) {
      const double distance = std::abs(region.multipliers[k] - r.multipliers[i]);
      if (distance < nearest) nearest = distance, sigma = region.sigma(k);
    }
    r.sigma[i] = std::hypot(std::max(r.sigma[i], sigma), nearest);
  }
  return r;
}

}  // namespace saltus
