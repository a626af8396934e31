#include "section_maps.hpp"

#include <Eigen/Dense>

#include <cmath>
#include <numbers>

#include "eigenvalues.hpp"

namespace saltus::rhythm {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using Index = Eigen::Index;

constexpr double weakest = 0.3;  // [-] correlation of a direction with what the section before sees of it

VectorXd weights_of(const Pairs& p, const VectorXd& weight) {
  VectorXd own(p.x.rows());
  for (Index i = 0; i < own.size(); ++i) own[i] = weight[p.visit[at(i)]];
  return own;
}

}  // namespace

Pairs pairs_of(const Passages& w, int section, int ahead) {
  std::vector<const VectorXd*> x, y, z;
  std::vector<double> u;
  Pairs p;
  const int j = section % w.per_chart;
  for (std::size_t i = 0; i < w.visits.size(); ++i) {
    const Visit& v = w.visits[i];
    if (w.place(v) != section - j || v.x.empty()) continue;
    const auto a = Place{&v, j}.x(), b = from_here(w, v, j, ahead).x(), c = from_here(w, v, j, -1).x();
    if (a == nullptr || b == nullptr || c == nullptr) continue;
    x.push_back(a);
    y.push_back(b);
    z.push_back(c);
    u.push_back(v.input[static_cast<std::size_t>(j)]);
    p.visit.push_back(static_cast<int>(i));
  }
  const auto n = static_cast<Index>(x.size());
  p.x.resize(n, w.dim);
  p.y.resize(n, w.dim);
  p.z.resize(n, w.dim);
  p.u = Eigen::Map<const VectorXd>(u.data(), n);
  for (Index i = 0; i < n; ++i) {
    p.x.row(i) = x[at(i)]->transpose();
    p.y.row(i) = y[at(i)]->transpose();
    p.z.row(i) = z[at(i)]->transpose();
  }
  return p;
}

MatrixXd centred(const MatrixXd& m, const VectorXd& weight) {
  return m.rowwise() - (weight.transpose() * m / weight.sum()).eval().row(0);
}

Frame frame_of(const Pairs& p, const VectorXd& noise_x, const VectorXd& noise_z) {
  const auto n = p.x.rows();
  const VectorXd one = VectorXd::Ones(n);
  const MatrixXd x = centred(p.x, one) * noise_x.cwiseInverse().asDiagonal();
  const MatrixXd z = centred(p.z, one) * noise_z.cwiseInverse().asDiagonal();
  const Eigen::JacobiSVD<MatrixXd> svd(x.transpose() * z / static_cast<double>(n),
                                       Eigen::ComputeFullU | Eigen::ComputeFullV);
  Frame f;
  // Of noise alone the largest singular value is about 2 sqrt(coordinates / rows) times that of a direction's scatter.
  const double none = 4.0 * std::sqrt(static_cast<double>(p.x.cols()) / static_cast<double>(n));
  const auto tells = [&](Index k) {
    const double own = (x * svd.matrixU().col(k)).squaredNorm() * (z * svd.matrixV().col(k)).squaredNorm();
    return svd.singularValues()[k] * static_cast<double>(n) > weakest * std::sqrt(own);
  };
  while (f.directions < p.x.cols() && svd.singularValues()[f.directions] > none && tells(f.directions)) ++f.directions;
  f.in = svd.matrixU().transpose() * noise_x.cwiseInverse().asDiagonal();
  f.out = noise_x.asDiagonal() * svd.matrixU();
  f.seen = svd.matrixV().transpose() * noise_z.cwiseInverse().asDiagonal();
  return f;
}

// T = (y' z)(x' z)^-1, which noise in x does not bias.
MatrixXd map_of(const Pairs& p, const Frame& here, const Frame& there, Index n, const VectorXd& weight_of_stays) {
  const VectorXd weight = weights_of(p, weight_of_stays);
  const MatrixXd x = centred(p.x, weight) * here.in.topRows(n).transpose();
  const MatrixXd y = centred(p.y, weight) * there.in.topRows(n).transpose();
  const MatrixXd z = weight.asDiagonal() * (centred(p.z, weight) * here.seen.topRows(n).transpose());
  const MatrixXd xz = x.transpose() * z;
  return (y.transpose() * z) * xz.fullPivLu().inverse();
}

std::vector<Complex> multipliers_of(const std::vector<Pairs>& steps, const std::vector<Frame>& frames, int directions,
                                    const VectorXd& weight) {
  MatrixXd cycle = MatrixXd::Identity(directions, directions);
  for (std::size_t c = 0; c < steps.size(); ++c) {
    const Frame& there = frames[(c + 1) % frames.size()];
    cycle = (map_of(steps[c], frames[c], there, directions, weight) * cycle).eval();
  }
  return cycle.allFinite() ? eigenvalues(cycle) : std::vector<Complex>{};
}

std::vector<Complex> in_order(std::vector<Complex> values, const std::vector<Complex>& like) {
  std::vector<Complex> r;
  for (const Complex& z : like) {
    const auto nearest = std::min_element(values.begin(), values.end(), [&](const Complex& a, const Complex& b) {
      return std::abs(a - z) < std::abs(b - z);
    });
    r.push_back(*nearest);
    values.erase(nearest);
  }
  return r;
}

std::vector<Complex> multipliers_of_all(const std::vector<std::vector<Pairs>>& steps,
                                        const std::vector<std::vector<Frame>>& frames, int directions,
                                        const VectorXd& weight) {
  const double share = 1.0 / static_cast<double>(steps.size());
  std::vector<Complex> first, mean(static_cast<std::size_t>(directions), 0.0);
  VectorXd polynomial = VectorXd::Zero(directions);  // coefficients of 1, z, z^2 ... below the leading one
  for (std::size_t j = 0; j < steps.size(); ++j) {
    auto roots = multipliers_of(steps[j], frames[j], directions, weight);
    if (roots.empty()) return {};
    if (j == 0) first = roots;
    roots = in_order(std::move(roots), first);
    Eigen::VectorXcd c = Eigen::VectorXcd::Zero(directions + 1);
    c[0] = 1.0;
    for (std::size_t k = 0; k < roots.size(); ++k) {  // times (z - root)
      mean[k] += share * roots[k];
      for (auto i = static_cast<Index>(k) + 1; i > 0; --i) c[i] = c[i - 1] - roots[k] * c[i];
      c[0] *= -roots[k];
    }
    polynomial += share * c.head(directions).real();
  }
  const bool paired = std::all_of(mean.begin(), mean.end(), [&](const Complex& z) {
    return std::any_of(mean.begin(), mean.end(),
                       [&](const Complex& other) { return std::abs(other - std::conj(z)) < 1e-9; });
  });
  if (paired) return mean;
  MatrixXd companion = MatrixXd::Zero(directions, directions);
  companion.diagonal(-1).setOnes();
  companion.col(directions - 1) = -polynomial;
  return eigenvalues(companion);
}

std::vector<double> spread_of(const std::vector<std::vector<Pairs>>& steps,
                              const std::vector<std::vector<Frame>>& frames, const std::vector<Complex>& multipliers,
                              const VectorXd& weight) {
  std::vector<double> r(multipliers.size(), 0.0);
  for (std::size_t j = 0; j < steps.size(); ++j) {
    const auto own = in_order(multipliers_of(steps[j], frames[j], static_cast<int>(r.size()), weight), multipliers);
    for (std::size_t i = 0; i < r.size(); ++i) r[i] += std::norm(own[i] - multipliers[i]);
  }
  for (double& x : r) x = std::sqrt(x / static_cast<double>(steps.size()));
  return r;
}

VectorXd drawn(std::size_t n, Random& random) {
  VectorXd w = VectorXd::Zero(static_cast<Index>(n));
  for (std::size_t i = 0; i < n; ++i)
    w[std::min(static_cast<Index>(n) - 1, static_cast<Index>(random.uniform() * static_cast<double>(n)))] += 1.0;
  return w;
}

double sigma_of(const std::vector<double>& squares, bool complex) {
  return std::sqrt(median(squares) / (complex ? std::numbers::ln2 : 0.455));
}

std::vector<Pairs> steps_of(const Passages& w, int j) {
  std::vector<Pairs> r;
  for (std::size_t c = 0; c < w.order.size(); ++c)
    r.push_back(pairs_of(w, static_cast<int>(c) * w.per_chart + j, w.per_chart));
  return r;
}

std::vector<Frame> frames_at(const Layout& layout, int j) {
  std::vector<Frame> r;
  for (std::size_t c = 0; c < layout.passages.order.size(); ++c)
    r.push_back(layout.frames[c * static_cast<std::size_t>(layout.passages.per_chart) + static_cast<std::size_t>(j)]);
  return r;
}

Chain chain_of(const std::vector<Pairs>& pairs, const std::vector<Frame>& frames, int directions,
               const VectorXd& weight) {
  Chain chain;
  for (std::size_t s = 0; s < pairs.size(); ++s) {
    const Pairs& p = pairs[s];
    const VectorXd own = weights_of(p, weight);
    const Frame& there = frames[(s + 1) % frames.size()];
    MatrixXd x(p.x.rows(), directions + 1), z(p.x.rows(), directions + 1);
    const MatrixXd u = centred(p.u, own);
    x << centred(p.x, own) * frames[s].in.topRows(directions).transpose(), u;
    z << centred(p.z, own) * frames[s].seen.topRows(directions).transpose(), u;
    z = own.asDiagonal() * z;
    const MatrixXd y = centred(p.y, own) * there.in.topRows(directions).transpose();
    const MatrixXd both = (y.transpose() * z) * (x.transpose() * z).eval().fullPivLu().inverse();
    chain.A.push_back(both.leftCols(directions));
    chain.B.push_back(both.col(directions));
  }
  return chain;
}

Eigen::MatrixXcd htf_at(const Chain& chain, const std::vector<Frame>& frames, double f, int harmonics) {
  const auto N = static_cast<Index>(chain.A.size());
  const Index n = chain.A.front().rows();
  const double w = 2.0 * std::numbers::pi * f / static_cast<double>(N);
  const auto input = [&](Index k) { return std::polar(1.0, w * static_cast<double>(k)); };
  Eigen::MatrixXcd phi = Eigen::MatrixXcd::Identity(n, n);
  Eigen::VectorXcd forced = Eigen::VectorXcd::Zero(n);
  for (Index k = 0; k < N; ++k) {
    forced = chain.A[at(k)] * forced + chain.B[at(k)] * input(k);
    phi = (chain.A[at(k)] * phi).eval();
  }
  Eigen::VectorXcd x =
      (std::polar(1.0, w * static_cast<double>(N)) * Eigen::MatrixXcd::Identity(n, n) - phi).fullPivLu().solve(forced);
  const Index outputs = frames.front().out.rows();
  Eigen::MatrixXcd h = Eigen::MatrixXcd::Zero(2 * harmonics + 1, outputs);
  for (Index k = 0; k < N; ++k) {
    const Eigen::VectorXcd y = frames[at(k)].out.leftCols(n) * x;
    for (int m = -harmonics; m <= harmonics; ++m) {
      const double turn =
          2.0 * std::numbers::pi * static_cast<double>(m) * static_cast<double>(k) / static_cast<double>(N);
      h.row(m + harmonics) += y.transpose() * std::conj(input(k)) * std::polar(1.0 / static_cast<double>(N), -turn);
    }
    x = (chain.A[at(k)] * x + chain.B[at(k)] * input(k)).eval();
  }
  return h;
}

}  // namespace saltus::rhythm
