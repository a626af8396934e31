// Everything that Wendel & Ames 2010 ask of a cycle, at every guard of it, with the error of each number. All
// tolerances come from two computations of the same cycle, with steps h and h/2: their difference bounds the error of
// the finer one, by a factor of 15 where the method's fourth order shows.
#pragma once

#include "conditioned_multipliers.hpp"
#include "return_map.hpp"

namespace saltus {

// What keeps ranks and multipliers from being trusted.
enum class Doubt : unsigned char {
  none,
  other_order,      // the two step sizes do not see the same events: one was missed
  grazing,          // a guard is met almost tangentially
  coarse,           // the derivative of the flow is not consistent with the flow, eq. 3
  undecided_rank,   // a singular value is neither clearly zero nor clearly not, and no theorem tells
  undecided_image,  // of the image of a guard, whether the flow crosses it
  outside_bounds,   // a rank contradicts Theorem 1, Lemma 3 or Theorem 4
  unequal_spectra,  // the guards disagree on the non-zero multipliers
  not_isolated,     // a multiplier is 1 to within rounding: a family of cycles, or a fold
  not_periodic,     // a second round differs from the first (Definition 4, A1)
  rank_changes,     // the rank of a reset is not constant around its guard (A3)
};

// An edge: its reset and its edge map, on the tangent space of the guard.
template <int N>
struct EdgeAnalysis {
  EdgeRank rank;             // what the bounds are made of
  Rank<N> reset, map;        // of D R_e and D P_e
  Bounds bounds;             // Lemma 3
  double guard_angle = 0.0;  // sine of the flow to the guard (A2)
  double image_angle = 0.0;  // sine of the next flow to the tangent space of R_e(G_e); 0 where that is all of the chart
  double image_tolerance = 0.0;
};

// The leg after an edge.
template <int N>
struct LegAnalysis {
  double invariant = 0.0;  // eq. 3, relative residual
  double kernel = 0.0;     // |Dphi f(x0)| / (|Dphi| |f(x0)|): Theorem 1's kernel
  Rank<N> total;           // of Dphi_tau: dimension - 1
  Rank<N> section;         // of Dphi_tau from the plane normal to f(x0): the same, a diffeomorphism (Cor. 1)
  ConditionedMultipliers<N> eigenvalues;  // of Dphi_tau in the coordinates of its chart
};

// The return map of a guard, just before its edge.
template <int N>
struct GuardAnalysis {
  Rank<N> rank;                        // of DP_q on the tangent space of the guard
  Bounds bounds;                       // Theorem 4, or Theorem 3 with one edge
  ConditionedMultipliers<N> spectrum;  // of DP_q in the coordinates of its chart
  ZeroMultipliers zeros;
  double one = 0.0;  // |Phi_T f - f| / |f|: the trivial eigenvalue 1 of the whole cycle's derivative
};

template <int N>
struct CycleAnalysis {
  Doubt doubt = Doubt::none;
  int at = 0;          // edge map where the doubt arose
  bool finer = false;  // smaller steps would lessen the error that it rests on
  int count = 0;
  std::array<EdgeAnalysis<N>, max_cycle_events> edge{};
  std::array<LegAnalysis<N>, max_cycle_events> leg{};
  std::array<GuardAnalysis<N>, max_cycle_events> guard{};
  double spread = 0.0;   // largest distance between the non-zero spectra of two guards
  double allowed = 0.0;  // what their errors allow
};

namespace orbit {
inline constexpr double epsilon = std::numeric_limits<double>::epsilon();

// `magnitude`: the sum of the absolute values of what each entry was summed from.
template <int N>
Measured<N> measured(const Mat<N, N>& coarse, const Mat<N, N>& fine, const Mat<N, N>& magnitude) noexcept {
  const Mat<N, N> difference = (coarse - fine).cwiseAbs();
  const Mat<N, N> rounding = (64.0 * epsilon) * magnitude;
  return {fine, coarse, difference.norm() + rounding.norm(), rounding.norm(), difference / 8.0 + rounding / 4.0};
}

template <int N>
Mat<N, N> magnitude(const Leg<N>& leg) noexcept {
  return leg.Phi.cwiseAbs() + leg.f1.cwiseAbs() * time_to_impact_gradient(leg).cwiseAbs().transpose();
}

// Of a reset: a derivative is known to the rounding of its states at best, however small it is itself.
template <int N>
Mat<N, N> magnitude(const EdgeMap<N>& map) noexcept {
  Mat<N, N> r = map.reset.cwiseAbs();
  if (map.edge < 0) return r;
  for (int i = 0; i < map.leg.dim; ++i) {
    for (int j = 0; j < map.dim; ++j) r(i, j) += std::abs(map.leg.x0[i]) / (1.0 + std::abs(map.x[j]));
  }
  return r;
}

// An error in one edge map passes through the maps before and behind it as they are, not as their magnitudes: products
// of those would grow from passage to passage where the cycle contracts.
template <int N>
Measured<N> measured_return_map(const Cycle<N>& coarse, const Cycle<N>& fine, int q) noexcept {
  std::array<Mat<N, N>, max_cycle_maps> before;  // from the guard of q to that of each map
  before[0] = onto_guard(fine, q);
  for (int j = 1; j < fine.count; ++j) {
    const auto at = static_cast<std::size_t>(j);
    before[at] = fine[q + j - 1].derivative() * before[at - 1];
  }
  Mat<N, N> behind = Mat<N, N>::Identity();
  Mat<N, N> size = return_map(fine, q).cwiseAbs() * before[0].cwiseAbs();
  for (int j = fine.count; j-- > 0;) {
    const EdgeMap<N>& map = fine[q + j];
    size += behind.cwiseAbs() * magnitude(map.leg) * magnitude(map) * before[static_cast<std::size_t>(j)].cwiseAbs();
    behind = (behind * map.derivative()).eval();
  }
  return measured<N>(return_map(coarse, q) * onto_guard(coarse, q), return_map(fine, q) * before[0], size);
}

// Smaller steps lessen the error.
template <int N>
bool steps_dominate(const Measured<N>& m) noexcept {
  return m.tolerance > 2.0 * m.rounding;
}

// Sine of the angle between f and the span of the first `rank` columns of u.
template <int N>
double angle_to_span(const Vec<N>& f, const Mat<N, N>& u, int rank) noexcept {
  Vec<N> rest = f;
  for (int i = 0; i < rank; ++i) rest -= u.col(i) * u.col(i).dot(f);
  return rest.norm() / f.norm();
}
}  // namespace orbit

// Multipliers of the return map where map q starts, from the cycle with steps h and h/2. `bounds`: of its rank, where
// they are known.
template <int N>
ConditionedMultipliers<N> multipliers_at(const Cycle<N>& coarse, const Cycle<N>& fine, int q,
                                         Bounds bounds = {0, N}) noexcept {
  bounds.upper = std::min(bounds.upper, fine[q].dim - 1);
  const auto m = orbit::measured_return_map(coarse, fine, q);
  return conditioned_multipliers<N>(m, fine[q].dim, rank_of<N>(m, bounds));
}

// `coarse` and `fine` are the same limit cycle, found with steps h and h/2. Numbers behind a doubt mean nothing.
template <int N>
CycleAnalysis<N> analyse(const Cycle<N>& coarse, const Cycle<N>& fine) noexcept {
  using orbit::measured;
  constexpr double grazing = 1e-6;   // [-] sine
  constexpr double isolated = 1e-6;  // [-] from 1; at a fold Newton's method knows the state to rounding over this
  constexpr double vague = 1e-3;     // [-] error of a multiplier that is as good as none
  CycleAnalysis<N> out;
  out.count = fine.count;
  const auto doubt = [&](Doubt d, int at, bool finer = true) {
    if (out.doubt != Doubt::none) return;
    out.doubt = d;
    out.at = at;
    out.finer = finer;
  };
  // Whether the rank is known; if not, which doubt that is.
  const auto known = [&](const Rank<N>& rank, Bounds bounds, const Measured<N>& m, int at) {
    if (!rank.known()) {
      doubt(rank.counted > bounds.upper ? Doubt::outside_bounds : Doubt::undecided_rank, at, orbit::steps_dominate(m));
    }
    return rank.known();
  };
  if (coarse.count != fine.count) doubt(Doubt::other_order, 0);
  for (int j = 0; j < fine.count && out.doubt == Doubt::none; ++j) {
    if (coarse[j].edge != fine[j].edge) doubt(Doubt::other_order, j);
    const Leg<N>& leg = fine[j].leg;
    const double change = std::abs(leg.rate - coarse[j].leg.rate);
    if (leg.status != Status::ok || !(transversality(leg) > grazing) || !(change < 0.1 * std::abs(leg.rate))) {
      doubt(Doubt::grazing, j + 1);
    }
    if (!(invariant_residual(leg) < 1e-4)) doubt(Doubt::coarse, j);
  }
  if (out.doubt != Doubt::none) return out;

  std::array<EdgeRank, max_cycle_events> ranks{};
  for (int j = 0; j < fine.count; ++j) {
    EdgeAnalysis<N>& e = out.edge[static_cast<std::size_t>(j)];
    const EdgeMap<N>& map = fine[j];
    const Mat<N, N> tangent = onto_guard(fine, j);
    const Mat<N, N> tangent_coarse = onto_guard(coarse, j);
    const auto reset =
        measured<N>(coarse[j].reset * tangent_coarse, map.reset * tangent, orbit::magnitude(map) * tangent.cwiseAbs());
    const Bounds room{0, std::min(map.dim - 1, map.leg.dim)};
    e.reset = rank_of<N>(reset, room);
    e.guard_angle = transversality(fine.arrival(j));
    if (!known(e.reset, room, reset, j)) continue;
    const int r = e.reset.value;
    e.image_angle = orbit::angle_to_span<N>(map.leg.f0, decompose<N>(reset.value).u, r);
    const double smallest = r > 0 ? e.reset.sigma[static_cast<std::size_t>(r - 1)] : 1.0;
    const double rounding = reset.rounding / smallest + 64.0 * orbit::epsilon;
    e.image_tolerance = (reset.tolerance - reset.rounding) / smallest +
                        (map.leg.f0 - coarse[j].leg.f0).norm() / map.leg.f0.norm() + rounding;
    e.rank = {map.dim, map.leg.dim, r, e.image_angle > orbit::clear * e.image_tolerance};
    if (!e.rank.transverse && !e.rank.decreasing() && e.image_angle > rounding) {
      doubt(Doubt::undecided_image, j, e.image_tolerance > 2.0 * rounding);
    }
    e.bounds = lemma3(e.rank);
    const auto p = measured<N>(coarse[j].derivative() * tangent_coarse, map.derivative() * tangent,
                               orbit::magnitude(map.leg) * (orbit::magnitude(map) * tangent.cwiseAbs()));
    e.map = rank_of<N>(p, e.bounds);
    known(e.map, e.bounds, p, j);
    ranks[static_cast<std::size_t>(j)] = e.rank;
  }

  for (int j = 0; j < fine.count; ++j) {
    LegAnalysis<N>& l = out.leg[static_cast<std::size_t>(j)];
    const Leg<N>& leg = fine[j].leg;
    const Leg<N>& leg_coarse = coarse[j].leg;
    const auto total = measured<N>(total_derivative(leg_coarse), total_derivative(leg), orbit::magnitude(leg));
    l.invariant = invariant_residual(leg);
    l.kernel = (total.value * leg.f0).norm() / (total.value.norm() * leg.f0.norm());
    const Bounds all_but_one{leg.dim - 1, leg.dim - 1};  // Theorem 1
    l.total = rank_of<N>(total, all_but_one);
    const Vec<N> f = leg.f0.normalized();
    Measured<N> section = total;
    section.value -= total.value * f * f.transpose();
    section.coarse -= total.coarse * f * f.transpose();
    l.section = rank_of<N>(section, all_but_one);
    l.eigenvalues = conditioned_multipliers<N>(total, leg.dim, l.total);
    if (known(l.total, all_but_one, total, j)) known(l.section, all_but_one, total, j);
  }
  if (out.doubt != Doubt::none) return out;

  const std::span<const EdgeRank> edges(ranks.data(), static_cast<std::size_t>(fine.count));
  for (int q = 0; q < fine.count; ++q) {
    const auto at = static_cast<std::size_t>(q);
    GuardAnalysis<N>& g = out.guard[at];
    const auto m = orbit::measured_return_map(coarse, fine, q);
    g.bounds = theorem4(edges, at);
    g.rank = rank_of<N>(m, g.bounds);
    g.spectrum = conditioned_multipliers<N>(m, fine[q].dim, g.rank);
    const Vec<N> f = fine[q].leg.f0;
    g.one = (cycle_derivative(fine, q) * f - f).norm() / f.norm();
    if (!known(g.rank, g.bounds, m, q)) continue;
    g.zeros = classify(edges, at, g.rank.value, g.spectrum.nonzero, g.spectrum.untold);
    // A zero that no theorem asks for is a number like others, and its error tells what it is worth.
    const auto last = static_cast<std::size_t>(fine[q].dim - 1);
    if (g.zeros.chain + g.zeros.nilpotent > 0 && !(g.spectrum.error[last] < vague)) {
      doubt(Doubt::undecided_rank, q, orbit::steps_dominate(m));
    }
    for (int i = 0; i < g.spectrum.nonzero; ++i) {
      if (std::abs(g.spectrum.value[static_cast<std::size_t>(i)] - 1.0) < isolated) doubt(Doubt::not_isolated, q);
    }
    const auto& first = out.guard[0].spectrum;
    if (q > 0 && first.status == Status::ok) {
      const double spread = spectral_distance(first, g.spectrum);
      const double allowed = allowed_distance(first, g.spectrum);
      out.spread = std::fmax(out.spread, spread);
      out.allowed = std::fmax(out.allowed, allowed);
      if (spread > allowed) doubt(Doubt::unequal_spectra, q, orbit::steps_dominate(m));
    }
  }
  return out;
}

}  // namespace saltus
