// Compass-gait biped: two straight legs and a hip, walking down a slope without actuation. Goswami, Thuilot & Espiau
// 1996 (INRIA RR-2996). Angles from the vertical, positive leaning up the slope; ns is the swing leg, s the stance leg.
#pragma once

#include <numbers>

#include "core/hybrid/model.hpp"
#include "linkage.hpp"

namespace saltus {

namespace compass_gait {
struct Swing : Chart<4> {};  // (ns, s [rad], their rates [rad/s])
struct Impact : Edge<Swing, Swing> {};
struct Ankle {    // the stance leg against the ground
  static constexpr bool rotary = true;
};
struct Hip {      // the swing leg against the stance leg
  static constexpr bool internal = true;
  static constexpr bool rotary = true;
};
}  // namespace compass_gait

template <class S = double>
struct CompassGait {
  using Swing = compass_gait::Swing;
  using Impact = compass_gait::Impact;
  using Charts = List<Swing>;
  using Edges = List<Impact>;
  using Ports = List<compass_gait::Ankle, compass_gait::Hip>;
  using U = Vec<0, S>;
  using V2 = Vec<2, S>;
  using X = Vec<4, S>;
  static constexpr std::string_view name = "compass_gait";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"theta_ns", "rad"}, Quantity{"theta_s", "rad"},
                                      Quantity{"rate_ns", "rad/s"}, Quantity{"rate_s", "rad/s"}};

  static constexpr std::string_view note =
      "There is a second, shorter gait; at the default parameters it is unstable: --start -0.31,0.205,-0.71,-1.21 "
      "finds "
      "it.";

  S hip_mass = 10.0;                         // [kg]
  S leg_mass = 5.0;                          // [kg]
  S a = 0.5;                                 // [m]   from the foot to the leg's centre of mass
  S b = 0.5;                                 // [m]   from there to the hip
  S slope = 3.0 / 180.0 * std::numbers::pi;  // [rad]
  S g = 9.8;                                 // [m/s^2]

  static constexpr auto parameters() {
    return std::array{Parameter{"hip_mass", "kg", &CompassGait::hip_mass},
                      Parameter{"leg_mass", "kg", &CompassGait::leg_mass},
                      Parameter{"a", "m", &CompassGait::a},
                      Parameter{"b", "m", &CompassGait::b},
                      Parameter{"slope", "rad", &CompassGait::slope},
                      Parameter{"g", "m/s^2", &CompassGait::g}};
  }

  X flow(Swing, const X& x, const U&) const noexcept {
    const V2 q = legs().acceleration(V2{x[0], x[1]}, V2{x[2], x[3]}, g, S(0.0));
    return {x[2], x[3], q[0], q[1]};
  }
  // The swing foot comes down on the slope ahead. While the stance leg leans back, or the foot moves up, it may pass
  // through the ground, as it must without knees.
  S guard(Impact, const X& x, const U&) const noexcept {
    const S foot = x[0] + x[1] + 2.0 * slope;
    const S rising = x[2] + x[3];  // times 1 s; only its sign matters
    const S leaning = x[1] + slope;
    const S back = leaning > rising ? leaning : rising;
    return foot > back ? foot : back;
  }
  // The swing foot stops and becomes the pivot, and the legs change names.
  X reset(Impact, const X& x, const U&) const noexcept {
    const S l = a + b;
    const S px = l * (cos(x[1]) * x[3] - cos(x[0]) * x[2]);
    const S py = l * (sin(x[0]) * x[2] - sin(x[1]) * x[3]);
    const V2 v = legs().stopped(V2{x[1], x[0]}, V2{x[3], x[2]}, px, py);
    return {x[1], x[0], v[0], v[1]};
  }
  X output(Swing, const X& x, const U&) const noexcept { return x; }

  // Torques at the joints [N m].
  Motion<S, 4> port(compass_gait::Ankle, Swing, const X& x) const noexcept {
    return {x[1], x[3], torque(x, V2{0.0, 1.0})};
  }
  Motion<S, 4> port(compass_gait::Hip, Swing, const X& x) const noexcept {
    return {x[0] - x[1], x[2] - x[3], torque(x, V2{1.0, -1.0})};
  }

  // [J], counted from the stance foot: constant along the flow.
  S energy(Swing, const X& x) const noexcept { return legs().energy(V2{x[0], x[1]}, V2{x[2], x[3]}, g, S(0.0)); }
  // [m], the hip over the stance foot: a walker below it has fallen.
  S upright(Swing, const X& x) const noexcept { return (a + b) * cos(x[1]); }

  Start<Swing, S> start() const noexcept { return {X{-0.3234, 0.2187, -0.3772, -1.0918}}; }

 private:
  Linkage<2, S> legs() const noexcept {
    Linkage<2, S> r;
    r.add(leg_mass, V2{0.0, a});
    r.add(hip_mass, V2{0.0, a + b});
    r.add(leg_mass, V2{-b, a + b});
    return r;
  }
  X torque(const X& x, const V2& joint) const noexcept {
    const V2 q = legs().mass_inverse(V2{x[0], x[1]}) * joint;
    return {0.0, 0.0, q[0], q[1]};
  }
};
static_assert(check<CompassGait<>>());

}  // namespace saltus
