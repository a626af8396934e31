// The return maps of a cycle of events, one a guard (Wendel & Ames 2010, sec. 4): each is the composition of edge maps
// P_e = phi_tau o R_e (def. 6), from a guard through its reset along the next leg to the next guard.
#pragma once

#include <numbers>

#include "time_to_impact.hpp"

namespace saltus {

inline constexpr int max_cycle_events = 12;
inline constexpr int max_cycle_maps = max_cycle_events + 1;  // with a section among them

// One edge map: from x on the guard of `edge` through the reset to the end of `leg`. N as of Leg.
template <int N>
struct EdgeMap {
  int edge = -1;  // -1: a section, where nothing jumps
  int chart = 0;  // that it leaves
  int dim = 0;    // of that chart
  Vec<N> x = Vec<N>::Zero();
  Mat<N, N> reset = Mat<N, N>::Zero();  // D R_e at x (leg.dim x dim)
  Leg<N> leg;

  // D P_e, (leg.dim x dim): defined off the guard too, onto the tangent space of the next guard.
  Mat<N, N> derivative() const noexcept { return total_derivative(leg) * reset; }
};

// A cycle of edge maps; the end of one is the start of the next, and of the last that of the first.
template <int N>
struct Cycle {
  int count = 0;
  std::array<EdgeMap<N>, max_cycle_maps> map{};

  EdgeMap<N>& operator[](int j) noexcept { return map[static_cast<std::size_t>(j % count)]; }
  const EdgeMap<N>& operator[](int j) const noexcept { return map[static_cast<std::size_t>(j % count)]; }

  double period() const noexcept {  // [s]
    double t = 0.0;
    for (int j = 0; j < count; ++j) t += (*this)[j].leg.duration;
    return t;
  }
  // Leg that ends on the guard where map j starts.
  const Leg<N>& arrival(int j) const noexcept { return (*this)[j + count - 1].leg; }
};

// D P_q at the guard where map q starts, in the coordinates of its chart (eq. 5).
template <int N>
Mat<N, N> return_map(const Cycle<N>& cycle, int q) noexcept {
  Mat<N, N> r = cycle[q].derivative();
  for (int j = 1; j < cycle.count; ++j) r = (cycle[q + j].derivative() * r).eval();
  return r;
}

// Orthogonal projection on the tangent space of the guard where map q starts.
template <int N>
Mat<N, N> onto_guard(const Cycle<N>& cycle, int q) noexcept {
  const Vec<N> normal = cycle.arrival(q).dh.normalized();
  Mat<N, N> r = -normal * normal.transpose();
  for (int i = 0; i < cycle[q].dim; ++i) r(i, i) += 1.0;
  return r;
}

// Phi_T of the whole cycle from just after the reset of map q, saltation matrices included. The flow's direction comes
// back to itself: it has the eigenvalue 1 that the return map has not, and the others in common.
template <int N>
Mat<N, N> cycle_derivative(const Cycle<N>& cycle, int q) noexcept {
  Mat<N, N> r = Mat<N, N>::Zero();
  for (int i = 0; i < cycle[q].leg.dim; ++i) r(i, i) = 1.0;
  for (int j = 0; j < cycle.count; ++j) {
    const Leg<N>& leg = cycle[q + j].leg;
    const EdgeMap<N>& next = cycle[q + j + 1];
    const Mat<N, N> saltation = next.reset + (next.leg.f0 - next.reset * leg.f1) * (leg.dh / leg.rate).transpose();
    r = (saltation * leg.Phi * r).eval();
  }
  return r;
}

template <class M, int N>
Point<M> point_in(int chart, const Vec<N>& x) noexcept {
  Point<M> p;
  p.chart = chart;
  p.x = x.template head<max_dim<M>>();
  return p;
}

// Cuts leg j where a section meets it, or, unwatched, after `at` [s]; there the section is the plane normal to the
// flow. Map j + 1 of the cycle then starts on the section: the return maps there and at the guards are conjugate
// (Remark 4). False when the leg does not meet it, or the cycle has no room for another section.
template <class M, int N, class Watch = Unwatched>
bool cut_leg(const M& m, double dt, Cycle<N>& cycle, int j, double at, const Watch& watch = {}) noexcept {
  using End = typename Leg<N>::End;
  if (cycle.count == max_cycle_maps) return false;
  const Leg<N>& whole = cycle[j].leg;
  const Leg<N> first = follow_leg<N>(m, point_in<M>(whole.chart, whole.x0), dt, at, true, watch);
  const End wanted = std::is_same_v<Watch, Unwatched> ? End::time : End::section;
  if (!usable(first.status) || first.end != wanted) return false;
  const Leg<N> second = follow_leg<N>(m, point_in<M>(first.chart, first.x1), dt, 2.0 * whole.duration, true);
  if (!usable(second.status) || second.end != whole.end || second.edge != whole.edge) return false;
  for (int k = cycle.count; k > j + 1; --k) {
    cycle.map[static_cast<std::size_t>(k)] = cycle.map[static_cast<std::size_t>(k - 1)];
  }
  ++cycle.count;
  cycle[j].leg = first;
  EdgeMap<N>& section = cycle[j + 1];
  section = EdgeMap<N>{};
  section.chart = first.chart;
  section.dim = first.dim;
  section.x = first.x1;
  for (int i = 0; i < first.dim; ++i) section.reset(i, i) = 1.0;
  section.leg = second;
  return true;
}

// Difference of two states of one chart; a clock is an angle.
template <class M, int N>
Vec<N> state_difference(int chart, const Vec<N>& a, const Vec<N>& b) noexcept {
  Vec<N> d = a - b;
  visit_at(typename M::Charts{}, chart, [&](auto c) {
    if constexpr (HasClock<decltype(c)>) {
      constexpr double turn = 2.0 * std::numbers::pi;
      double& angle = d[clock_of<decltype(c)>()];
      angle -= turn * std::round(angle / turn);
    }
  });
  return d;
}

}  // namespace saltus
