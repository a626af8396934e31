// The simplest walking model: massless straight legs, a point mass at the hip, feet of vanishing mass. Garcia,
// Chatterjee, Ruina & Coleman 1998. Dimensionless: lengths by the leg, times by sqrt(leg / g). It has two gaits at each
// small slope, a long one, stable at 0.009, and a short one, unstable.
#pragma once

#include "core/hybrid/model.hpp"

namespace saltus {

namespace simplest_walker {
// (theta, theta', phi, phi'): the stance leg from the normal of the slope, positive leaning up; the angle between the
// legs
struct Swing : Chart<4> {};
struct Impact : Edge<Swing, Swing> {};
struct Ankle {  // the stance leg against the ground
  static constexpr bool rotary = true;
};
}  // namespace simplest_walker

template <class S = double>
struct SimplestWalker {
  using Swing = simplest_walker::Swing;
  using Impact = simplest_walker::Impact;
  using Charts = List<Swing>;
  using Edges = List<Impact>;
  using Ports = List<simplest_walker::Ankle>;
  using U = Vec<0, S>;
  using X = Vec<4, S>;
  static constexpr std::string_view name = "simplest_walker";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"theta", "rad"}, Quantity{"phi", "rad"}, Quantity{"rate_theta", "rad/s"},
                                      Quantity{"rate_phi", "rad/s"}};
  static constexpr std::string_view note =
      "There is a second, shorter gait; at slope 0.009 it is unstable: --start 0.194,-0.204,0.388,-0.015 finds it.";

  S slope = 0.009;  // [rad]

  static constexpr auto parameters() { return std::array{Parameter{"slope", "rad", &SimplestWalker::slope}}; }

  X flow(Swing, const X& x, const U&) const noexcept {
    const S fall = sin(x[0] - slope);
    return {x[1], fall, x[3], fall + (x[1] * x[1] - cos(x[0] - slope)) * sin(x[2])};
  }
  // The swing foot comes down on the slope ahead. While the stance leg leans back, or the foot moves up, it may pass
  // through the ground, as it must without knees.
  S guard(Impact, const X& x, const U&) const noexcept {
    const S foot = 2.0 * x[0] - x[2];
    const S rising = 2.0 * x[1] - x[3];
    const S back = x[0] > rising ? x[0] : rising;
    return foot > back ? foot : back;
  }
  X reset(Impact, const X& x, const U&) const noexcept {
    const S c = cos(2.0 * x[0]);
    return {-x[0], c * x[1], -2.0 * x[0], c * (1.0 - c) * x[1]};
  }
  X output(Swing, const X& x, const U&) const noexcept { return {x[0], x[2], x[1], x[3]}; }
  // A torque in units of hip mass x g x leg.
  Motion<S, 4> port(simplest_walker::Ankle, Swing, const X& x) const noexcept {
    return {x[0], x[1], {0.0, 1.0, 0.0, 1.0}};
  }

  // In units of hip mass x g x leg, counted from the stance foot: constant along the flow.
  S energy(Swing, const X& x) const noexcept { return 0.5 * x[1] * x[1] + cos(x[0] - slope); }
  // The hip over the stance foot: a walker below it has fallen.
  S upright(Swing, const X& x) const noexcept { return cos(x[0] - slope); }

  Start<Swing, S> start() const noexcept { return {X{0.2003, -0.1998, 0.4006, -0.0158}}; }
};
static_assert(check<SimplestWalker<>>());

}  // namespace saltus
