// A compass-gait walking robot: two straight legs of different make, an outer pair and an inner one, joined at a hip
// whose motor turns one against the other. A counterweighted boom carries the hip, so that what weighs there is not
// what has inertia there. The chart is the leg that stands. `hip` is the angle of the inner leg against the outer one,
// `stance` that of the standing leg from the vertical, positive leaning back; the motor's torque acts along `hip`.
#pragma once

#include "core/hybrid/model.hpp"
#include "linkage.hpp"

namespace saltus {

namespace compass_gait_robot {
struct Outer : Chart<4> {};  // (hip, stance [rad], their rates [rad/s])
struct Inner : Chart<4> {};
struct InnerImpact : Edge<Outer, Inner> {};  // the inner leg comes down
struct OuterImpact : Edge<Inner, Outer> {};
struct Hip {  // the inner leg against the outer one
  static constexpr bool internal = true;
  static constexpr bool rotary = true;
};
struct Ankle {  // the standing leg against the ground
  static constexpr bool rotary = true;
};
}  // namespace compass_gait_robot

template <class S = double>
struct CompassGaitRobot {
  using Outer = compass_gait_robot::Outer;
  using Inner = compass_gait_robot::Inner;
  using InnerImpact = compass_gait_robot::InnerImpact;
  using OuterImpact = compass_gait_robot::OuterImpact;
  using Charts = List<Outer, Inner>;
  using Edges = List<InnerImpact, OuterImpact>;
  using Ports = List<compass_gait_robot::Hip, compass_gait_robot::Ankle>;
  using U = Vec<1, S>;
  using V2 = Vec<2, S>;
  using X = Vec<4, S>;
  static constexpr std::string_view name = "compass_gait_robot";
  static constexpr std::array inputs{Quantity{"u", "V"}};
  static constexpr std::array outputs{Quantity{"hip", "rad"}, Quantity{"stance", "rad"}};

  S leg_mass = 0.7;           // [kg]     of each leg
  S leg_length = 0.2778;      // [m]
  S com_inner = 0.0448;       // [m]      from the hip to the leg's centre of mass
  S com_outer = 0.0502;       // [m]
  S inertia_inner = 0.00432;  // [kg m^2] of the leg about the hip
  S inertia_outer = 0.00437;  // [kg m^2]
  S hip_mass = 2.0;           // [kg]     what has inertia at the hip, boom and counterweight included
  S hip_gravity_mass = -0.4;  // [kg]     what weighs there
  S motor_constant = 0.0182;  // [N m/V]
  S g = 9.81;                 // [m/s^2]

  static constexpr auto parameters() {
    using M = CompassGaitRobot;
    return std::array{Parameter{"leg_mass", "kg", &M::leg_mass},
                      Parameter{"leg_length", "m", &M::leg_length},
                      Parameter{"com_inner", "m", &M::com_inner},
                      Parameter{"com_outer", "m", &M::com_outer},
                      Parameter{"inertia_inner", "kg m^2", &M::inertia_inner},
                      Parameter{"inertia_outer", "kg m^2", &M::inertia_outer},
                      Parameter{"hip_mass", "kg", &M::hip_mass},
                      Parameter{"hip_gravity_mass", "kg", &M::hip_gravity_mass},
                      Parameter{"motor_constant", "N m/V", &M::motor_constant},
                      Parameter{"g", "m/s^2", &M::g}};
  }
  // Standard deviation of a parameter where nobody says, as a share of its value; below zero: the usual. What the boom
  // makes of the hip is not known; inertias and centres of mass come from a swing test.
  static constexpr double uncertainty(std::string_view parameter) {
    if (parameter == "hip_mass") return 0.5;
    if (parameter == "hip_gravity_mass") return 2.0;
    if (parameter == "leg_length") return 0.005;
    return parameter == "g" ? 0.001 : -1.0;
  }

  template <class C>
  X flow(C c, const X& x, const U& u) const noexcept {
    const Legs legs = standing(c);
    const Pose p = pose(c, x);
    // On the legs' own angles the torque along `hip` is one of opposite signs.
    const S torque = sign(c) * motor_constant * u[0];
    const V2 a = legs.mass_inverse(p.q) * (legs.torques(p.q, p.v, g, S(0.0)) + V2{torque, -torque});
    return {x[2], x[3], sign(c) * (a[0] - a[1]), -a[0]};
  }
  // The swing foot comes down ahead. Before the standing leg has passed the vertical, and while the foot rises, it may
  // pass through the ground: the legs of the machine are shorter while they swing.
  template <class E>
  S guard(E, const X& x, const U&) const noexcept {
    const Pose p = pose(typename E::from{}, x);
    const S foot = cos(p.q[0]) - cos(p.q[1]);                      // its height over the leg's length
    const S rising = sin(p.q[1]) * p.v[1] - sin(p.q[0]) * p.v[0];  // times 1 s; only its sign matters
    const S leaning = -p.q[0];
    const S back = leaning > rising ? leaning : rising;
    return foot > back ? foot : back;
  }
  // Plastic: the swing foot stops and becomes the pivot.
  template <class E>
  X reset(E, const X& x, const U&) const noexcept {
    const Pose p = pose(typename E::from{}, x);
    const S px = leg_length * (cos(p.q[0]) * p.v[0] - cos(p.q[1]) * p.v[1]);
    const S py = leg_length * (sin(p.q[1]) * p.v[1] - sin(p.q[0]) * p.v[0]);
    const V2 v = inertial(typename E::to{}).stopped(V2{p.q[1], p.q[0]}, V2{p.v[1], p.v[0]}, px, py);
    return {x[0], -p.q[1], sign(typename E::to{}) * (v[0] - v[1]), -v[0]};
  }
  template <class C>
  V2 output(C, const X& x, const U&) const noexcept {
    return {x[0], x[1]};
  }

  // Torques at the joints [N m].
  template <class C>
  Motion<S, 4> port(compass_gait_robot::Hip, C c, const X& x) const noexcept {
    return {x[0], x[2], torque(c, x, V2{sign(c), -sign(c)})};
  }
  template <class C>
  Motion<S, 4> port(compass_gait_robot::Ankle, C c, const X& x) const noexcept {
    return {x[1], x[3], torque(c, x, V2{S(-1.0), S(0.0)})};
  }

  // [J], counted from the stance foot: constant along the flow without torque.
  template <class C>
  S energy(C c, const X& x) const noexcept {
    const Pose p = pose(c, x);
    return standing(c).energy(p.q, p.v, g, S(0.0));
  }

  Start<Outer, S> start() const noexcept { return {X{0.35, 0.17, -0.2, -0.9}}; }

 private:
  using Legs = Linkage<2, S>;
  // Angles from the vertical, positive leaning forward, of the standing leg and the swinging one.
  struct Pose {
    V2 q, v;
  };
  static constexpr double sign(Outer) noexcept { return -1.0; }
  static constexpr double sign(Inner) noexcept { return 1.0; }
  template <class C>
  static Pose pose(C c, const X& x) noexcept {
    return {{-x[1], -x[1] - sign(c) * x[0]}, {-x[3], -x[3] - sign(c) * x[2]}};
  }
  Legs legs(const S& com_standing, const S& inertia_standing, const S& com_swinging, const S& inertia_swinging,
            const S& at_hip) const noexcept {
    Legs r;
    r.add(leg_mass, V2{leg_length - com_standing, S(0.0)});
    r.add(at_hip, V2{leg_length, S(0.0)});
    r.add(leg_mass, V2{leg_length, -com_swinging});
    r.A(0, 0) += inertia_standing - leg_mass * com_standing * com_standing;
    r.A(1, 1) += inertia_swinging - leg_mass * com_swinging * com_swinging;
    return r;
  }
  Legs inertial(Outer) const noexcept { return legs(com_outer, inertia_outer, com_inner, inertia_inner, hip_mass); }
  Legs inertial(Inner) const noexcept { return legs(com_inner, inertia_inner, com_outer, inertia_outer, hip_mass); }
  // With the weight that the boom leaves.
  template <class C>
  Legs standing(C c) const noexcept {
    Legs r = inertial(c);
    r.B[0] += (hip_gravity_mass - hip_mass) * leg_length;
    return r;
  }
  template <class C>
  X torque(C c, const X& x, const V2& joint) const noexcept {
    const V2 a = inertial(c).mass_inverse(pose(c, x).q) * joint;
    return {S(0.0), S(0.0), sign(c) * (a[0] - a[1]), -a[0]};
  }
};
static_assert(check<CompassGaitRobot<>>());

}  // namespace saltus
