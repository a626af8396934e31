// Vertical hopper: two masses on a spring, driven by a clock. Ankarali & Cowan 2014, Fig. 2; the parameters are not
// printed there and come from the authors' public code of 2013. `b` is drag of the lower mass against the world.
#pragma once

#include "core/hybrid/model.hpp"

namespace saltus {

namespace hopper {
struct Flight : Chart<5>, Clock<2> {};  // (y_M [m], v_M [m/s], clock [rad], y_m [m], v_m [m/s])
struct Stance : Chart<3>, Clock<2> {};  // (y_M [m], v_M [m/s], clock [rad])
struct Touchdown : Edge<Flight, Stance> {};
struct Liftoff : Edge<Stance, Flight> {};
struct Body {};  // y_M against the world
struct Leg {
  static constexpr bool internal = true;  // y_M - y_m, from the rest length
};
struct Foot {};  // y_m against the world
}  // namespace hopper

template <class S = double>
struct Hopper {
  using Flight = hopper::Flight;
  using Stance = hopper::Stance;
  using Charts = List<Flight, Stance>;
  using Edges = List<hopper::Touchdown, hopper::Liftoff>;
  using Ports = List<hopper::Body, hopper::Leg, hopper::Foot>;
  using U = Vec<1, S>;
  static constexpr std::string_view name = "hopper";
  static constexpr bool branchless = true;
  static constexpr std::array inputs{Quantity{"u", "N"}};
  static constexpr std::array outputs{Quantity{"y_M", "m"}, Quantity{"v_M", "m/s"}};

  S m = 1.0;                         // [kg]    lower mass
  S M = 2.0;                         // [kg]    upper mass
  S k = 10.0;                        // [N/m]   leg spring
  S b = 5.0;                         // [N s/m] drag of the lower mass in flight
  S l0 = 2.0;                        // [m]     rest length
  S a = 20.0;                        // [N]     amplitude of the leg's drive
  S omega = 2.0 * std::numbers::pi;  // [rad/s] clock rate
  S g = 2.0;                         // [m/s^2]

  static constexpr auto parameters() {
    return std::array{Parameter{"m", "kg", &Hopper::m},
                      Parameter{"M", "kg", &Hopper::M},
                      Parameter{"k", "N/m", &Hopper::k},
                      Parameter{"b", "N s/m", &Hopper::b},
                      Parameter{"l0", "m", &Hopper::l0},
                      Parameter{"a", "N", &Hopper::a},
                      Parameter{"omega", "rad/s", &Hopper::omega},
                      Parameter{"g", "m/s^2", &Hopper::g}};
  }

  Vec<5, S> flow(Flight, const Vec<5, S>& x, const U& u) const noexcept {
    const S leg = k * (l0 - (x[0] - x[3])) + a * sin(x[2]);
    return {x[1], (leg + u[0]) / M - g, omega, x[4], -(leg + b * x[4]) / m - g};
  }
  Vec<3, S> flow(Stance, const Vec<3, S>& x, const U& u) const noexcept {
    return {x[1], (k * (l0 - x[0]) + a * sin(x[2]) + u[0]) / M - g, omega};
  }
  S guard(hopper::Touchdown, const Vec<5, S>& x, const U&) const noexcept { return x[3]; }
  S guard(hopper::Liftoff, const Vec<3, S>& x, const U&) const noexcept {
    return k * (l0 - x[0]) + a * sin(x[2]) + m * g;
  }
  Vec<3, S> reset(hopper::Touchdown, const Vec<5, S>& x, const U&) const noexcept { return {x[0], x[1], x[2]}; }
  Vec<5, S> reset(hopper::Liftoff, const Vec<3, S>& x, const U&) const noexcept { return {x[0], x[1], x[2], 0.0, 0.0}; }
  template <class C>
  Vec<2, S> output(C, const Vec<C::dim, S>& x, const U&) const noexcept {
    return {x[0], x[1]};
  }

  Motion<S, 5> port(hopper::Body, Flight, const Vec<5, S>& x) const noexcept {
    return {x[0], x[1], {0.0, 1.0 / M, 0.0, 0.0, 0.0}};
  }
  Motion<S, 3> port(hopper::Body, Stance, const Vec<3, S>& x) const noexcept {
    return {x[0], x[1], {0.0, 1.0 / M, 0.0}};
  }
  Motion<S, 5> port(hopper::Leg, Flight, const Vec<5, S>& x) const noexcept {
    return {x[0] - x[3] - l0, x[1] - x[4], {0.0, 1.0 / M, 0.0, 0.0, -1.0 / m}};
  }
  Motion<S, 3> port(hopper::Leg, Stance, const Vec<3, S>& x) const noexcept {
    return {x[0] - l0, x[1], {0.0, 1.0 / M, 0.0}};
  }
  Motion<S, 5> port(hopper::Foot, Flight, const Vec<5, S>& x) const noexcept {
    return {x[3], x[4], {0.0, 0.0, 0.0, 0.0, 1.0 / m}};
  }
  S reaction(hopper::Leg, hopper::Liftoff) const noexcept { return 1.0; }  // a leg force is part of the ground force

  Start<Flight, S> start() const { return {Vec<5, S>{1.9, -1.9, 0.0, 0.7, 1.1}}; }
};
static_assert(check<Hopper<>>());

}  // namespace saltus
