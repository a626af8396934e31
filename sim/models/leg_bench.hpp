// One leg of the compass-gait robot hanging from its hip on a bench, turned by the hip's motor. The angle is 0 hanging
// down; the declared values are those of the inner leg.
#pragma once

#include "core/hybrid/model.hpp"

namespace saltus {

namespace leg_bench {
struct Swing : Chart<2> {};  // (angle [rad], rate [rad/s])
struct Hip {                 // the leg against the motor's housing
  static constexpr bool internal = true;
  static constexpr bool rotary = true;
};
}  // namespace leg_bench

template <class S = double>
struct LegBench {
  using Swing = leg_bench::Swing;
  using Charts = List<Swing>;
  using Edges = List<>;
  using Ports = List<leg_bench::Hip>;
  using X = Vec<2, S>;
  using U = Vec<1, S>;
  static constexpr std::string_view name = "leg_bench";
  static constexpr std::array inputs{Quantity{"u", "V"}};
  static constexpr std::array outputs{Quantity{"angle", "rad"}};

  S inertia = 0.00432;        // [kg m^2] about the hip
  S mass = 0.7;               // [kg]
  S com = 0.0448;             // [m]      from the hip to the centre of mass
  S motor_constant = 0.0182;  // [N m/V]
  S g = 9.81;                 // [m/s^2]

  static constexpr auto parameters() {
    return std::array{Parameter{"inertia", "kg m^2", &LegBench::inertia}, Parameter{"mass", "kg", &LegBench::mass},
                      Parameter{"com", "m", &LegBench::com},
                      Parameter{"motor_constant", "N m/V", &LegBench::motor_constant},
                      Parameter{"g", "m/s^2", &LegBench::g}};
  }
  // Standard deviation of a parameter where nobody says, as a share of its value; below zero: the usual. Inertia and
  // centre of mass come from a swing test.
  static constexpr double uncertainty(std::string_view parameter) {
    if (parameter == "inertia" || parameter == "com") return 0.05;
    return parameter == "g" ? 0.001 : -1.0;
  }

  X flow(Swing, const X& x, const U& u) const noexcept {
    return {x[1], (motor_constant * u[0] - mass * g * com * sin(x[0])) / inertia};
  }
  Vec<1, S> output(Swing, const X& x, const U&) const noexcept { return Vec<1, S>(x[0]); }
  Motion<S, 2> port(leg_bench::Hip, Swing, const X& x) const noexcept { return {x[0], x[1], {0.0, 1.0 / inertia}}; }

  // [J], counted from the hip: constant along the flow without current.
  S energy(Swing, const X& x) const noexcept { return 0.5 * inertia * x[1] * x[1] - mass * g * com * cos(x[0]); }

  Start<Swing, S> start() const noexcept { return {X{0.0, 0.0}}; }
};
static_assert(check<LegBench<>>());

}  // namespace saltus
