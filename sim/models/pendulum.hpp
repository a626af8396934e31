// A pendulum turned by a motor at its joint: one chart, no events. The angle is 0 hanging down and counts turns.
#pragma once

#include "core/hybrid/model.hpp"

namespace saltus {

namespace pendulum {
struct Swing : Chart<2> {};  // (angle [rad], rate [rad/s])
struct Joint {
  static constexpr bool rotary = true;
  static constexpr bool turns = true;
};
}  // namespace pendulum

template <class S = double>
struct Pendulum {
  using Swing = pendulum::Swing;
  using Charts = List<Swing>;
  using Edges = List<>;
  using Ports = List<pendulum::Joint>;
  using X = Vec<2, S>;
  using U = Vec<1, S>;
  static constexpr std::string_view name = "pendulum";
  static constexpr std::array inputs{Quantity{"tau", "N m"}};
  static constexpr std::array outputs{Quantity{"angle", "rad"}, Quantity{"rate", "rad/s"}};

  S inertia = 0.1495;   // [kg m^2] about the joint, of all that turns unless the motor's rotor is given below
  S mgl = 2.98;         // [N m]    weight times the distance of the centre of mass
  S gear = 1.0;         // [-]      turns of the motor for one of the joint
  S rotor_inertia = 0;  // [kg m^2] of the motor, before the gear
  S torque_gain = 1.0;  // [-]      torque at the joint over the torque recorded

  static constexpr auto parameters() {
    return std::array{Parameter{"inertia", "kg m^2", &Pendulum::inertia}, Parameter{"mgl", "N m", &Pendulum::mgl},
                      Parameter{"gear", "-", &Pendulum::gear},
                      Parameter{"rotor_inertia", "kg m^2", &Pendulum::rotor_inertia},
                      Parameter{"torque_gain", "-", &Pendulum::torque_gain}};
  }
  // Standard deviation of a parameter where nobody says, as a share of its value; below zero: the usual. A torque told
  // from a motor's current is known as well as the motor's constant and the losses of its gear, to a tenth; inertia and
  // weight, of which such a torque cannot tell a common factor, are known better.
  static constexpr double uncertainty(std::string_view parameter) {
    if (parameter == "torque_gain") return 0.1;
    return parameter == "gear" ? 0.0 : -1.0;
  }

  X flow(Swing, const X& x, const U& u) const noexcept {
    return {x[1], (torque_gain * u[0] - mgl * sin(x[0])) / moved()};
  }
  Vec<2, S> output(Swing, const X& x, const U&) const noexcept { return x; }
  Motion<S, 2> port(pendulum::Joint, Swing, const X& x) const noexcept { return {x[0], x[1], {0.0, 1.0 / moved()}}; }

  S moved() const noexcept { return inertia + gear * gear * rotor_inertia; }  // [kg m^2]
  // [J], counted from the joint: constant along the flow without torque.
  S energy(Swing, const X& x) const noexcept { return 0.5 * moved() * x[1] * x[1] - mgl * cos(x[0]); }

  Start<Swing, S> start() const noexcept { return {X{0.0, 0.0}}; }
};
static_assert(check<Pendulum<>>());

}  // namespace saltus
