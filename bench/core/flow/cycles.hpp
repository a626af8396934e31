// The cycles that cycle_bench.cpp and sundials_bench.cpp measure, from the limit cycle once around.
#pragma once

#include <limits>
#include <memory>
#include <type_traits>

#include "core/orbit/orbit.hpp"
#include "sim/models/hopper.hpp"
#include "sim/models/kneed_biped.hpp"

namespace saltus {

// Where a cycle begins, and when it is over: after `span` seconds, or with the reset of the edge Last.
template <class M, class Last>
struct Cycle {
  using Model = M;
  M m;
  Point<M> start;
  double span = 1e3;  // [s] infinity is no time for a peer's solver

  template <class E>
  static constexpr bool ends_with = std::is_same_v<E, Last>;

  // The largest of any coordinate; infinite in another chart.
  double error(const Point<M>& p) const {
    if (p.chart != start.chart) return std::numeric_limits<double>::infinity();
    return Vec<max_dim<M>>(orbit::difference(p, start)).template lpNorm<Eigen::Infinity>();
  }
};

struct Never {};
using HopperCycle = Cycle<Hopper<>, Never>;
using BipedCycle = Cycle<KneedBiped<>, kneed_biped::FootStrike>;

inline const HopperCycle& hopper_cycle() {
  static const HopperCycle cycle = [] {
    HopperCycle c;
    auto system = std::make_unique<LdtpOf<Hopper<>, 2>>();
    c.start = find_orbit<2>(c.m, timebase_of(c.m, 8192), ClockPhases{2}, *system).point[0];
    c.span = 1.0;
    return c;
  }();
  return cycle;
}

inline const BipedCycle& biped_cycle() {
  static const BipedCycle cycle = [] {
    using E = kneed_biped::FootStrike;
    BipedCycle c;
    auto system = std::make_unique<LdtpOf<KneedBiped<>, 1>>();
    const auto found = find_orbit<1>(c.m, timebase_of(c.m, 8192), AtEdge<E>{}, *system);
    c.start.set(E::to{}, c.m.reset(E{}, found.point[0].in(E::from{}), Input<KneedBiped<>>::Zero()));
    return c;
  }();
  return cycle;
}

}  // namespace saltus
