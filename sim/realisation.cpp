#include "realisation.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <stdexcept>

#include "core/random.hpp"
#include "eigenvalues.hpp"
#include "multiplier_region.hpp"
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

// The B of least squares on all harmonics, given A and C: the phasors of the state are linear in it. The response of
// G_n to B[k] depends on the line only through z = exp(i omega N) and a phase, so lines of equal z share their work.
void fit_inputs(const HtfTable& t, const std::vector<MatrixXcd>& g, const Eigen::VectorXd& scale, PeriodicModel& m) {
  const Index sections = t.sections;
  std::vector<Index> start(at(sections) + 1, 0);  // of B[k] among the unknowns
  for (Index k = 0; k < sections; ++k) start[at(k) + 1] = start[at(k)] + m.A[at(k)].rows();
  const Index unknowns = start.back();
  std::map<std::int64_t, std::vector<std::size_t>> classes;
  for (std::size_t q = 0; q < t.omega.size(); ++q) {
    const double cycles = t.omega[q] * static_cast<double>(sections) / turn;
    classes[std::llround((cycles - std::floor(cycles)) * 1e9)].push_back(q);
  }
  MatrixXd normal = MatrixXd::Zero(unknowns, unknowns);
  Eigen::VectorXd rhs = Eigen::VectorXd::Zero(unknowns);
  for (const auto& [key, members] : classes) {
    const Complex back = phasor(-t.omega[members[0]] * static_cast<double>(sections));
    MatrixXcd response(sections * t.outputs, unknowns);  // of y at section n in time, from B[k] u at section k of one
    for (Index k = 0; k < sections; ++k) {               // cycle, summed over all cycles before
      const Index next = (k + 1) % sections, size = start[at(k) + 1] - start[at(k)];
      const MatrixXd mono = m.monodromy(static_cast<int>(next));
      MatrixXcd x = (MatrixXcd::Identity(size, size) - back * mono).partialPivLu().inverse();
      for (Index j = 1; j <= sections; ++j) {
        const Index n = (k + j) % sections;
        // Sections before k + 1 of the same cycle hear of it one cycle later.
        const Complex delay = k + j >= sections ? back : Complex{1.0};
        for (Index c = 0; c < t.outputs; ++c) {
          response.block(n * t.outputs + c, start[at(k)], 1, size) = m.C[at(n)].row(c) / scale[c] * (x * delay);
        }
        x = (m.A[at(n)] * x).eval();
      }
    }
    const MatrixXcd gram = response.adjoint() * response;
    for (Index k = 0; k < sections; ++k) {
      for (Index l = 0; l < sections; ++l) {
        Complex weight{};
        for (const std::size_t q : members) weight += phasor(t.omega[q] * static_cast<double>(l - k));
        normal.block(start[at(k)], start[at(l)], start[at(k) + 1] - start[at(k)], start[at(l) + 1] - start[at(l)]) +=
            (weight *
             gram.block(start[at(k)], start[at(l)], start[at(k) + 1] - start[at(k)], start[at(l) + 1] - start[at(l)]))
                .real();
      }
    }
    for (const std::size_t q : members) {
      Eigen::VectorXcd y(sections * t.outputs);
      for (Index n = 0; n < sections; ++n) {
        for (Index c = 0; c < t.outputs; ++c) {
          y[n * t.outputs + c] = g[q](n, c) / scale[c] * phasor(t.omega[q] * static_cast<double>(n));
        }
      }
      const Eigen::VectorXcd v = response.adjoint() * y;
      for (Index k = 0; k < sections; ++k) {
        const Index size = start[at(k) + 1] - start[at(k)];
        rhs.segment(start[at(k)], size) +=
            (phasor(-t.omega[q] * static_cast<double>(k)) * v.segment(start[at(k)], size)).real();
      }
    }
  }
  // Inputs that the band does not hold have no say: the least-norm answer.
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(normal);
  const Eigen::VectorXd& lambda = solver.eigenvalues();
  Eigen::VectorXd x = solver.eigenvectors().transpose() * rhs;
  for (Index i = 0; i < unknowns; ++i) x[i] = lambda[i] > 1e-13 * lambda[unknowns - 1] ? x[i] / lambda[i] : 0.0;
  x = (solver.eigenvectors() * x).eval();
  m.B.clear();
  for (Index k = 0; k < sections; ++k) m.B.push_back(x.segment(start[at(k)], start[at(k) + 1] - start[at(k)]));
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

int PeriodicModel::smallest_section() const {
  int best = 0;
  for (int n = 1; n < sections; ++n) {
    if (dim(n) < dim(best)) best = n;
  }
  return best;
}

MatrixXd PeriodicModel::monodromy(int n) const {
  MatrixXd r = MatrixXd::Identity(dim(n), dim(n));
  for (int k = 0; k < sections; ++k) r = (A[at((n + k) % sections)] * r).eval();
  return r;
}

MatrixXcd PeriodicModel::htf(double omega) const {
  const Complex back = phasor(-omega);
  Eigen::VectorXcd particular = Eigen::VectorXcd::Zero(dim(0));
  for (std::size_t n = 0; n < A.size(); ++n) particular = ((A[n] * particular + B[n]) * back).eval();
  const MatrixXcd closure = MatrixXcd::Identity(dim(0), dim(0)) - monodromy(0) * phasor(-omega * sections);
  Eigen::VectorXcd x = closure.partialPivLu().solve(particular);
  MatrixXcd h = MatrixXcd::Zero(sections, outputs);
  for (Index n = 0; n < sections; ++n) {
    const Eigen::VectorXcd y = C[at(n)] * x;
    for (Index m = 0; m < sections; ++m) {
      h.row(m) += (y * root_of_unity(-m * n, sections)).transpose() / static_cast<double>(sections);
    }
    x = ((A[at(n)] * x + B[at(n)]) * back).eval();
  }
  return h;
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

std::string realisation_json(const Realisation& r) {
  const auto matrix = [](const MatrixXd& m) {
    nlohmann::json rows = nlohmann::json::array();
    for (Index i = 0; i < m.rows(); ++i) {
      nlohmann::json row = nlohmann::json::array();
      for (Index j = 0; j < m.cols(); ++j) row.push_back(m(i, j));
      rows.push_back(row);
    }
    return rows;
  };
  nlohmann::json j{{"sections_per_cycle", r.model.sections},
                   {"outputs", r.model.outputs},
                   {"dim", nlohmann::json::array()},
                   {"rank", r.rank},
                   {"htf_error", r.error},
                   {"singular_values", r.singular},
                   {"threshold", r.threshold},
                   {"missing_harmonics_limit", r.limit},
                   {"inconsistency", r.inconsistency},
                   {"stable", r.stable()},
                   {"multipliers", nlohmann::json::array()},
                   {"A", nlohmann::json::array()},
                   {"B", nlohmann::json::array()},
                   {"C", nlohmann::json::array()}};
  if (r.bounds) j["rank_bounds"] = {r.bounds->lower, r.bounds->upper};
  for (int n = 0; n < r.model.sections; ++n) {
    j["dim"].push_back(r.model.dim(n));
    j["A"].push_back(matrix(r.model.A[at(n)]));
    j["B"].push_back(matrix(r.model.B[at(n)]));
    j["C"].push_back(matrix(r.model.C[at(n)]));
  }
  for (std::size_t i = 0; i < r.multipliers.size(); ++i) {
    nlohmann::json z{{"re", r.multipliers[i].real()}, {"im", r.multipliers[i].imag()}, {"sigma", nullptr}};
    if (i < r.sigma.size()) z["sigma"] = r.sigma[i];
    j["multipliers"].push_back(z);
  }
  return j.dump(1) + "\n";
}

PeriodicModel periodic_model_of(const std::string& text) {
  constexpr Index most = 256;
  const auto refuse = [](const std::string& why) { throw std::invalid_argument(why); };
  const nlohmann::json j = nlohmann::json::parse(text, nullptr, false);
  for (const char* key : {"sections_per_cycle", "outputs", "dim", "A", "B", "C"}) {
    if (!j.is_object() || !j.contains(key)) refuse(std::string("it is no state-space model in JSON: no '") + key + "'");
  }
  PeriodicModel r;
  try {
    r.sections = j.at("sections_per_cycle");
    r.outputs = j.at("outputs");
    const std::vector<Index> dim = j.at("dim");
    const std::size_t sections = dim.size();
    const auto sensible = [](Index d) { return d >= 0 && d <= most; };
    if (r.sections < 1 || sections != at(r.sections)) refuse("'dim' has not one number for each section");
    if (r.outputs < 1 || !sensible(r.outputs) || !std::all_of(dim.begin(), dim.end(), sensible)) {
      refuse("'outputs' or 'dim' has a number that is none of outputs or states");
    }
    const auto read = [&](const char* name, std::size_t n, Index rows, Index cols) {
      const std::vector<std::vector<double>> given = j.at(name).at(n);
      const auto fits = [&](const std::vector<double>& row) { return row.size() == at(cols); };
      if (given.size() != at(rows) || !std::all_of(given.begin(), given.end(), fits)) {
        refuse(std::string(name) + " of section " + std::to_string(n) + " is not " + std::to_string(rows) + " x " +
               std::to_string(cols));
      }
      MatrixXd m(rows, cols);
      for (Index i = 0; i < rows; ++i) {
        for (Index k = 0; k < cols; ++k) m(i, k) = given[at(i)][at(k)];
      }
      return m;
    };
    for (std::size_t n = 0; n < sections; ++n) {
      const Index next = dim[(n + 1) % sections];
      r.A.push_back(read("A", n, next, dim[n]));
      r.B.push_back(read("B", n, next, 1));
      r.C.push_back(read("C", n, r.outputs, dim[n]));
    }
  } catch (const nlohmann::json::exception& e) {
    refuse(e.what());
  }
  return r;
}

std::string realisation_csv(const Realisation& r) {
  std::string csv = "matrix,section,row,column,value\n";
  const auto write = [&](const char* name, int n, const MatrixXd& m) {
    for (Index i = 0; i < m.rows(); ++i) {
      for (Index j = 0; j < m.cols(); ++j) {
        char line[96];
        std::snprintf(line, sizeof line, "%s,%d,%d,%d,%.17g\n", name, n, static_cast<int>(i), static_cast<int>(j),
                      m(i, j));
        csv += line;
      }
    }
  };
  for (int n = 0; n < r.model.sections; ++n) {
    write("A", n, r.model.A[at(n)]);
    write("B", n, r.model.B[at(n)]);
    write("C", n, r.model.C[at(n)]);
  }
  return csv;
}

}  // namespace saltus
