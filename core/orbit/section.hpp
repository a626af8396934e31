// Poincaré sections, as families met one after the other in time: N phases of the clock (isochrons of a clock-driven
// model), N values of the kinematic phase, or the guard of an edge.
//
// A family has
//   static constexpr bool on_grid        met at ticks of the time base, nothing to locate
//   int count() const                    sections a cycle
//   value(i, m, C, x, u)                 surface of section i in chart C; falls through zero when the section is met
#pragma once

#include <cmath>
#include <numbers>

#include "../flow/advance.hpp"

namespace saltus {

// Section i is the clock angle 2 pi i / count (Ankarali & Cowan 2014, VI.B: isochrons).
struct ClockPhases {
  static constexpr bool on_grid = true;
  int sections = 32;

  int count() const noexcept { return sections; }
  template <class M, class C>
  ScalarOf<M> value(int i, const M&, C, const Vec<C::dim, ScalarOf<M>>& x, const Input<M>&) const noexcept {
    using S = ScalarOf<M>;
    constexpr double turn = 2.0 * std::numbers::pi;
    const S ahead = turn * i / sections - x[clock_of<C>()];
    return ahead - S(turn * std::round(value_of(ahead) / turn));  // from half a turn before to half a turn after
  }
};

// Section i is the kinematic phase -2 pi i / count, of the angle of (position - o_p)/s_p + i (velocity - o_v)/s_v: two
// outputs of the model. The angle decreases in time, and sections are ordered in time (Ankarali & Cowan 2014, VI.B).
struct KinematicPhases {
  static constexpr bool on_grid = false;
  int sections = 32;
  int position = 0, velocity = 1;  // outputs
  double o_p = 1.9, o_v = 0.0;     // [unit of the output] origin
  double s_p = 0.3, s_v = 1.9;     // [unit of the output] scale

  int count() const noexcept { return sections; }
  template <class M, class C>
  ScalarOf<M> value(int i, const M& m, C c, const Vec<C::dim, ScalarOf<M>>& x, const Input<M>& u) const noexcept {
    const double phase = -2.0 * std::numbers::pi * i / sections;
    const Output<M> y = m.output(c, x, u);
    return (y[velocity] - o_v) * (cos(phase) / s_v) - (y[position] - o_p) * (sin(phase) / s_p);
  }
};

// The guard of edge E: the section is met just before the reset, and left through it.
template <class E>
struct AtEdge {
  static constexpr bool on_grid = false;
  using edge = E;

  static constexpr int count() noexcept { return 1; }
  template <class M, class C>
  ScalarOf<M> value(int, const M& m, C, const Vec<C::dim, ScalarOf<M>>& x, const Input<M>& u) const noexcept {
    if constexpr (std::is_same_v<C, typename E::from>) {
      return m.guard(E{}, x, u);
    } else {
      return 1.0;  // the section does not reach into this chart
    }
  }
};

// One section of a family, as a watch for `advance`.
template <class Family>
struct SectionWatch {
  using edge = typename EdgeNamed<Family>::type;
  const Family& family;
  int index;

  template <class M, class C>
  ScalarOf<M> value(const M& m, C c, const Vec<C::dim, ScalarOf<M>>& x, const Input<M>& u) const noexcept {
    return family.value(index, m, c, x, u);
  }
};

}  // namespace saltus
