// A ball that bounces on a table which moves up and down: s(t) = A sin(clock). The impact time depends on the state, so
// that a saltation matrix, not the clock alone, makes the return map.
#pragma once

#include <numbers>

#include "core/hybrid/model.hpp"

namespace saltus {

namespace bouncing_ball {
struct Flight : Chart<3>, Clock<2> {};  // (y [m], v [m/s], clock [rad])
struct Impact : Edge<Flight, Flight> {};
struct Body {};  // the ball against the world
}  // namespace bouncing_ball

template <class S = double>
struct BouncingBall {
  using Flight = bouncing_ball::Flight;
  using Impact = bouncing_ball::Impact;
  using Charts = List<Flight>;
  using Edges = List<Impact>;
  using Ports = List<bouncing_ball::Body>;
  using X = Vec<3, S>;
  using U = Vec<1, S>;
  static constexpr std::string_view name = "bouncing_ball";
  static constexpr std::array inputs{Quantity{"u", "N"}};
  static constexpr std::array outputs{Quantity{"y", "m"}, Quantity{"v", "m/s"}};

  S m = 0.5;                         // [kg]
  S g = 9.81;                        // [m/s^2]
  S A = 0.112;                       // [m]     amplitude of the table
  S e = 0.8;                         // [-]     restitution
  S omega = 2.0 * std::numbers::pi;  // [rad/s] clock rate

  static constexpr auto parameters() {
    return std::array{Parameter{"m", "kg", &BouncingBall::m}, Parameter{"g", "m/s^2", &BouncingBall::g},
                      Parameter{"A", "m", &BouncingBall::A}, Parameter{"e", "-", &BouncingBall::e},
                      Parameter{"omega", "rad/s", &BouncingBall::omega}};
  }

  X flow(Flight, const X& x, const U& u) const noexcept { return {x[1], u[0] / m - g, omega}; }
  S guard(Impact, const X& x, const U&) const noexcept { return x[0] - A * sin(x[2]); }
  X reset(Impact, const X& x, const U&) const noexcept {
    const S table = A * omega * cos(x[2]);  // [m/s]
    return {x[0], table + e * (table - x[1]), x[2]};
  }
  Vec<2, S> output(Flight, const X& x, const U&) const noexcept { return {x[0], x[1]}; }
  Motion<S, 3> port(bouncing_ball::Body, Flight, const X& x) const noexcept {
    return {x[0], x[1], {0.0, 1.0 / m, 0.0}};
  }

  Start<Flight, S> start() const noexcept { return {X{0.55, -3.84, 0.0}}; }
};
static_assert(check<BouncingBall<>>());

}  // namespace saltus
