// What the theory assumes of a cycle and the analysis of its matrices cannot see (Wendel & Ames 2010): that it repeats
// (Definition 4, A1), and that its resets have constant rank near their guards (A3; that their images are submanifolds
// then follows from the constant-rank theorem).
#pragma once

#include "rank.hpp"
#include "shooting.hpp"

namespace saltus {

// A second round, from where the first one ended.
struct Periodicity {
  bool same_order = false;  // rho(n) = rho(n + k)
  double time = 0.0;        // [s] largest |I_n + T - I_{n+k}|
  double state = 0.0;       // largest |c_n - c_{n+k}| at a guard, relative to 1 + the size of the state
  double allowed = 0.0;     // the same, of what the mismatch that Newton's method may leave grows to on the way

  bool holds() const noexcept { return same_order && state <= allowed; }
};

template <class M, int N>
Periodicity repeat(const M& m, double dt, const Cycle<N>& cycle) noexcept {
  Periodicity r;
  r.same_order = true;
  Cycle<N> second = cycle;
  Search search;
  double t = 0.0;
  Mat<N, N> way = Mat<N, N>::Identity();  // what a mismatch at the start has become
  for (int j = 0; j < cycle.count; ++j) {
    second[j].x = j == 0 ? cycle.arrival(0).x1 : second[j - 1].leg.x1;
    orbit::evaluate_map(m, dt, 8.0 * cycle.period(), Unwatched{}, second[j]);
    if (!orbit::expected_end(m, second[j].leg, cycle[j].edge, cycle[j + 1].edge, search)) {
      r.same_order = false;
      return r;
    }
    t += second[j].leg.duration - cycle[j].leg.duration;
    const auto& x = cycle[j].leg.x1;
    const auto gap = state_difference<M>(second[j].leg.chart, second[j].leg.x1, x);
    r.time = std::fmax(r.time, std::abs(t));
    r.state = std::fmax(r.state, gap.template lpNorm<Eigen::Infinity>() / (1.0 + x.template lpNorm<Eigen::Infinity>()));
    way = (cycle[j].derivative() * way).eval();
    r.allowed = std::fmax(r.allowed, orbit::mismatch * (1.0 + way.norm()));
  }
  return r;
}

// Singular values of D R_e on the tangent space of the guard at points of the guard around x.
template <int N>
struct ResetSample {
  int points = 0;
  std::array<double, static_cast<std::size_t>(N)> least{}, most{};  // of each singular value, falling
  // Of a singular value: what rounding does to the matrix, and, by its change from point to point, rounding of the
  // point.
  double rounding = 0.0;

  // The rank is `rank` at every point: what counts stays above the tolerance, what does not below.
  bool constant(int rank, double tolerance) const noexcept {
    const auto r = static_cast<std::size_t>(rank);
    return points > 0 && (rank == 0 || least[r - 1] > tolerance) && (rank == N || !(most[r] > tolerance));
  }
  bool constant(int rank) const noexcept { return constant(rank, rounding); }

  // The smallest singular value that counts, over that; infinite where none does.
  double margin(int rank) const noexcept {
    return rank == 0 ? std::numeric_limits<double>::infinity() : least[static_cast<std::size_t>(rank - 1)] / rounding;
  }
};

// Samples at distance `reach`, relative to 1 + the coordinate, along every coordinate of x, both ways.
template <class M, int N>
ResetSample<N> sample_reset(const M& m, const EdgeMap<N>& map, double reach) noexcept {
  ResetSample<N> r;
  r.least.fill(std::numeric_limits<double>::infinity());
  visit_at(typename M::Edges{}, map.edge, [&](auto e) {
    using E = decltype(e);
    constexpr int n = E::from::dim;
    constexpr int to = E::to::dim;
    using D = Dual<n>;
    using LM = Rebind<M, D>;
    const LM lifted = lift<D>(m);
    const Input<LM> u = Input<LM>::Constant(D(0.0));
    constexpr double unit = 64.0 * std::numeric_limits<double>::epsilon();
    const auto derivative = [&](const Vec<n>& x) -> Mat<to, n> {
      return gradient_of(Vec<to, D>(lifted.reset(e, variables<n, n>(x, 0), u)));
    };
    const Mat<to, n> here = derivative(map.x.template head<n>());
    for (int i = 0; i < 2 * n; ++i) {
      Vec<n> x = map.x.template head<n>();
      x[i / 2] += (i % 2 == 0 ? reach : -reach) * (1.0 + std::abs(x[i / 2]));
      Vec<n> normal = Vec<n>::Zero();
      for (int k = 0; k < 8; ++k) {  // back onto the guard, along its gradient
        const D h = lifted.guard(e, variables<n, n>(x, 0), u);
        for (int c = 0; c < n; ++c) normal[c] = h.gradient[static_cast<std::size_t>(c)];
        x -= normal * (h.value / normal.squaredNorm());
      }
      normal.normalize();
      const Mat<to, n> reset = derivative(x);
      Mat<N, N> wide = Mat<N, N>::Zero();
      wide.template topLeftCorner<to, n>() = reset - (reset * normal) * normal.transpose();
      if (!wide.allFinite()) continue;
      const auto sigma = singular_values<N>(wide);
      ++r.points;
      const double curvature = (reset - here).norm() / std::fmax(reach, (x - map.x.template head<n>()).norm());
      const double rounding = unit * (reset.norm() + (1.0 + x.norm()) * curvature);
      if (rounding > r.rounding) r.rounding = rounding;
      for (std::size_t k = 0; k < sigma.size(); ++k) {
        r.least[k] = std::fmin(r.least[k], sigma[k]);
        r.most[k] = std::fmax(r.most[k], sigma[k]);
      }
    }
  });
  return r;
}

}  // namespace saltus
