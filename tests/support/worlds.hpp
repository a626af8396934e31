// Small models whose answers are known in closed form. Each is written once over its scalar, like any model.
#pragma once

#include "core/hybrid/model.hpp"

namespace saltus::worlds {

// A ball over a floor under gravity and a held force: y'' = u - g, and v -> -e v at the floor. A negative g makes a
// parabola that dips to the floor and rises again.
namespace ball {
struct Air : Chart<2> {};  // (y [m], v [m/s])
struct Impact : Edge<Air, Air> {};
}  // namespace ball
template <class S = double>
struct Ball {
  using Charts = List<ball::Air>;
  using Edges = List<ball::Impact>;
  static constexpr std::string_view name = "ball";
  static constexpr std::array inputs{Quantity{"u", "m/s^2"}};
  static constexpr std::array outputs{Quantity{"y", "m"}};

  S g = 9.81;  // [m/s^2]
  S e = 0.8;   // [-] restitution

  static constexpr auto parameters() {
    return std::array{Parameter{"g", "m/s^2", &Ball::g}, Parameter{"e", "-", &Ball::e}};
  }
  Vec<2, S> flow(ball::Air, const Vec<2, S>& x, const Vec<1, S>& u) const noexcept { return {x[1], u[0] - g}; }
  S guard(ball::Impact, const Vec<2, S>& x, const Vec<1, S>&) const noexcept { return x[0]; }
  Vec<2, S> reset(ball::Impact, const Vec<2, S>& x, const Vec<1, S>&) const noexcept { return {x[0], -e * x[1]}; }
  Vec<1, S> output(ball::Air, const Vec<2, S>& x, const Vec<1, S>&) const noexcept { return Vec<1, S>(x[0]); }
  Start<ball::Air, S> start() const noexcept { return {Vec<2, S>{1.0, 0.0}}; }
};

// A mass on a spring that hits a wall left of its rest: x'' = -w^2 x + u, v -> -e v at x = -d.
namespace wall {
struct Free : Chart<2> {};  // (x [m], v [m/s])
struct Hit : Edge<Free, Free> {};
}  // namespace wall
template <class S = double>
struct Wall {
  using Charts = List<wall::Free>;
  using Edges = List<wall::Hit>;
  static constexpr std::string_view name = "wall";
  static constexpr std::array inputs{Quantity{"u", "m/s^2"}};
  static constexpr std::array outputs{Quantity{"x", "m"}, Quantity{"v", "m/s"}};

  S w = 3.0;  // [rad/s]
  S d = 0.5;  // [m]
  S e = 0.9;  // [-]

  static constexpr auto parameters() {
    return std::array{Parameter{"w", "rad/s", &Wall::w}, Parameter{"d", "m", &Wall::d}, Parameter{"e", "-", &Wall::e}};
  }
  Vec<2, S> flow(wall::Free, const Vec<2, S>& x, const Vec<1, S>& u) const noexcept {
    return {x[1], u[0] - w * w * x[0]};
  }
  S guard(wall::Hit, const Vec<2, S>& x, const Vec<1, S>&) const noexcept { return x[0] + d; }
  Vec<2, S> reset(wall::Hit, const Vec<2, S>& x, const Vec<1, S>&) const noexcept { return {x[0], -e * x[1]}; }
  Vec<2, S> output(wall::Free, const Vec<2, S>& x, const Vec<1, S>&) const noexcept { return x; }
  Start<wall::Free, S> start() const noexcept { return {Vec<2, S>{1.0, 0.0}}; }
};

// A pendulum with drag that hits a stop: no closed form, nonlinear, with friction. Angle from the hanging position.
namespace pendulum {
struct Swing : Chart<2> {};  // (angle [rad], rate [rad/s])
struct Stop : Edge<Swing, Swing> {};
}  // namespace pendulum
template <class S = double>
struct Pendulum {
  using Charts = List<pendulum::Swing>;
  using Edges = List<pendulum::Stop>;
  static constexpr std::string_view name = "pendulum";
  static constexpr std::array inputs{Quantity{"torque", "1/s^2"}};
  static constexpr std::array outputs{Quantity{"angle", "rad"}};

  S w2 = 9.81;   // [1/s^2]
  S c = 0.2;     // [1/s]
  S stop = 0.3;  // [rad]
  S e = 0.8;     // [-]

  static constexpr auto parameters() {
    return std::array{Parameter{"w2", "1/s^2", &Pendulum::w2}, Parameter{"c", "1/s", &Pendulum::c},
                      Parameter{"stop", "rad", &Pendulum::stop}, Parameter{"e", "-", &Pendulum::e}};
  }
  Vec<2, S> flow(pendulum::Swing, const Vec<2, S>& x, const Vec<1, S>& u) const noexcept {
    return {x[1], u[0] - w2 * sin(x[0]) - c * x[1] * sqrt(1.0 + x[1] * x[1])};
  }
  // Nonlinear on purpose: the stop is met where sin(angle) = -sin(stop).
  S guard(pendulum::Stop, const Vec<2, S>& x, const Vec<1, S>&) const noexcept { return sin(x[0]) + sin(stop); }
  Vec<2, S> reset(pendulum::Stop, const Vec<2, S>& x, const Vec<1, S>&) const noexcept { return {x[0], -e * x[1]}; }
  Vec<1, S> output(pendulum::Swing, const Vec<2, S>& x, const Vec<1, S>&) const noexcept { return Vec<1, S>(x[0]); }
  Start<pendulum::Swing, S> start() const noexcept { return {Vec<2, S>{1.0, 0.0}}; }
};

// Two edges leave one chart: a point that moves at unit speeds towards x = a (declared first) and y = b.
// No inputs.
namespace fork {
struct Plain : Chart<2> {};  // (x [m], y [m])
struct Right : Chart<1> {};  // (y)
struct Up : Chart<1> {};     // (x)
struct ToRight : Edge<Plain, Right> {};
struct ToUp : Edge<Plain, Up> {};
}  // namespace fork
template <class S = double>
struct Fork {
  using Charts = List<fork::Plain, fork::Right, fork::Up>;
  using Edges = List<fork::ToRight, fork::ToUp>;
  static constexpr std::string_view name = "fork";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"s", "m"}};

  S a = 1.0;  // [m]
  S b = 1.0;  // [m]

  static constexpr auto parameters() {
    return std::array{Parameter{"a", "m", &Fork::a}, Parameter{"b", "m", &Fork::b}};
  }
  Vec<2, S> flow(fork::Plain, const Vec<2, S>&, const Vec<0, S>&) const noexcept { return {1.0, 1.0}; }
  template <class C>
  Vec<1, S> flow(C, const Vec<1, S>&, const Vec<0, S>&) const noexcept {
    return Vec<1, S>(S(1.0));
  }
  S guard(fork::ToRight, const Vec<2, S>& x, const Vec<0, S>&) const noexcept { return a - x[0]; }
  S guard(fork::ToUp, const Vec<2, S>& x, const Vec<0, S>&) const noexcept { return b - x[1]; }
  Vec<1, S> reset(fork::ToRight, const Vec<2, S>& x, const Vec<0, S>&) const noexcept { return Vec<1, S>(x[1]); }
  Vec<1, S> reset(fork::ToUp, const Vec<2, S>& x, const Vec<0, S>&) const noexcept { return Vec<1, S>(x[0]); }
  template <class C>
  Vec<1, S> output(C, const Vec<C::dim, S>& x, const Vec<0, S>&) const noexcept {
    return Vec<1, S>(x[0]);
  }
  Start<fork::Plain, S> start() const noexcept { return {Vec<2, S>{0.0, 0.0}}; }
};

// A ball in the box [0, 1] x [0, 1], no gravity, elastic: four edges from one chart to itself. No inputs, no
// parameters.
namespace box {
struct Inside : Chart<4> {};  // (x, y [m], vx, vy [m/s])
struct Left : Edge<Inside, Inside> {};
struct Right : Edge<Inside, Inside> {};
struct Floor : Edge<Inside, Inside> {};
struct Ceiling : Edge<Inside, Inside> {};
}  // namespace box
template <class S = double>
struct Box {
  using X = Vec<4, S>;
  using U = Vec<0, S>;
  using Charts = List<box::Inside>;
  using Edges = List<box::Left, box::Right, box::Floor, box::Ceiling>;
  static constexpr std::string_view name = "box";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"x", "m"}, Quantity{"y", "m"}};

  static constexpr auto parameters() { return std::array<Parameter<Box, S>, 0>{}; }
  X flow(box::Inside, const X& x, const U&) const noexcept { return {x[2], x[3], 0.0, 0.0}; }
  S guard(box::Left, const X& x, const U&) const noexcept { return x[0]; }
  S guard(box::Right, const X& x, const U&) const noexcept { return 1.0 - x[0]; }
  S guard(box::Floor, const X& x, const U&) const noexcept { return x[1]; }
  S guard(box::Ceiling, const X& x, const U&) const noexcept { return 1.0 - x[1]; }
  X reset(box::Left, const X& x, const U&) const noexcept { return {x[0], x[1], -x[2], x[3]}; }
  X reset(box::Right, const X& x, const U&) const noexcept { return {x[0], x[1], -x[2], x[3]}; }
  X reset(box::Floor, const X& x, const U&) const noexcept { return {x[0], x[1], x[2], -x[3]}; }
  X reset(box::Ceiling, const X& x, const U&) const noexcept { return {x[0], x[1], x[2], -x[3]}; }
  Vec<2, S> output(box::Inside, const X& x, const U&) const noexcept { return {x[0], x[1]}; }
  Start<box::Inside, S> start() const noexcept { return {X{0.3, 0.4, 0.7, -0.6}}; }
};

// A sawtooth: x' = rate + u_1, and at x = level + u_0 it falls back to share * u_0. Guard and reset see the input.
namespace sawtooth {
struct Ramp : Chart<1> {};  // (x)
struct Fall : Edge<Ramp, Ramp> {};
}  // namespace sawtooth
template <class S = double>
struct Sawtooth {
  using Charts = List<sawtooth::Ramp>;
  using Edges = List<sawtooth::Fall>;
  static constexpr std::string_view name = "sawtooth";
  static constexpr std::array inputs{Quantity{"u_0", "-"}, Quantity{"u_1", "1/s"}};
  static constexpr std::array outputs{Quantity{"x", "-"}};

  S rate = 1.0;   // [1/s]
  S level = 1.0;  // [-]
  S share = 0.5;  // [-]

  static constexpr auto parameters() {
    return std::array{Parameter{"rate", "1/s", &Sawtooth::rate}, Parameter{"level", "-", &Sawtooth::level},
                      Parameter{"share", "-", &Sawtooth::share}};
  }
  Vec<1, S> flow(sawtooth::Ramp, const Vec<1, S>&, const Vec<2, S>& u) const noexcept { return Vec<1, S>(rate + u[1]); }
  S guard(sawtooth::Fall, const Vec<1, S>& x, const Vec<2, S>& u) const noexcept { return level + u[0] - x[0]; }
  Vec<1, S> reset(sawtooth::Fall, const Vec<1, S>&, const Vec<2, S>& u) const noexcept {
    return Vec<1, S>(share * u[0]);
  }
  Vec<1, S> output(sawtooth::Ramp, const Vec<1, S>& x, const Vec<2, S>& u) const noexcept {
    return Vec<1, S>(x[0] + u[0]);
  }
  Start<sawtooth::Ramp, S> start() const noexcept { return {Vec<1, S>(S(0.0))}; }
};

// A relaxation oscillator: one coordinate that charges towards 1 until `high` and discharges towards 0 until `low`.
namespace relaxation {
struct Charge : Chart<1> {};
struct Discharge : Chart<1> {};
struct Full : Edge<Charge, Discharge> {};
struct Empty : Edge<Discharge, Charge> {};
}  // namespace relaxation
template <class S = double>
struct Relaxation {
  using Charts = List<relaxation::Charge, relaxation::Discharge>;
  using Edges = List<relaxation::Full, relaxation::Empty>;
  static constexpr std::string_view name = "relaxation";
  static constexpr std::array inputs{Quantity{"u", "1/s"}};
  static constexpr std::array outputs{Quantity{"x", "-"}};

  S tau = 0.25;  // [s]
  S low = 0.3;   // [-]
  S high = 0.8;  // [-]

  static constexpr auto parameters() {
    return std::array{Parameter{"tau", "s", &Relaxation::tau}, Parameter{"low", "-", &Relaxation::low},
                      Parameter{"high", "-", &Relaxation::high}};
  }
  Vec<1, S> flow(relaxation::Charge, const Vec<1, S>& x, const Vec<1, S>& u) const noexcept {
    return Vec<1, S>((1.0 - x[0]) / tau + u[0]);
  }
  Vec<1, S> flow(relaxation::Discharge, const Vec<1, S>& x, const Vec<1, S>& u) const noexcept {
    return Vec<1, S>(-x[0] / tau + u[0]);
  }
  S guard(relaxation::Full, const Vec<1, S>& x, const Vec<1, S>&) const noexcept { return high - x[0]; }
  S guard(relaxation::Empty, const Vec<1, S>& x, const Vec<1, S>&) const noexcept { return x[0] - low; }
  template <class E>
  Vec<1, S> reset(E, const Vec<1, S>& x, const Vec<1, S>&) const noexcept {
    return x;
  }
  template <class C>
  Vec<1, S> output(C, const Vec<1, S>& x, const Vec<1, S>&) const noexcept {
    return x;
  }
  Start<relaxation::Charge, S> start() const noexcept { return {Vec<1, S>(S(0.5))}; }
};

// Two halves of a clock: x' = drive - k x + u while sin(clock - shift) > 0, x' = -k x + u in the other half, both kept
// through the edges but for a factor. Every event is set by the clock; a multiplier is keep^2 e^{-k period}.
namespace metronome {
struct Tick : Chart<2>, Clock<1> {};  // (x, clock [rad])
struct Tock : Chart<2>, Clock<1> {};
struct Off : Edge<Tick, Tock> {};
struct On : Edge<Tock, Tick> {};
}  // namespace metronome
template <class S = double>
struct Metronome {
  using X = Vec<2, S>;
  using U = Vec<1, S>;
  using Charts = List<metronome::Tick, metronome::Tock>;
  using Edges = List<metronome::Off, metronome::On>;
  static constexpr std::string_view name = "metronome";
  static constexpr std::array inputs{Quantity{"u", "1/s"}};
  static constexpr std::array outputs{Quantity{"x", "-"}};

  S k = 1.0;                         // [1/s]
  S drive = 2.0;                     // [1/s]
  S keep = 0.9;                      // [-]
  S shift = 0.0;                     // [rad]
  S omega = 2.0 * std::numbers::pi;  // [rad/s]

  static constexpr auto parameters() {
    return std::array{Parameter{"k", "1/s", &Metronome::k}, Parameter{"drive", "1/s", &Metronome::drive},
                      Parameter{"keep", "-", &Metronome::keep}, Parameter{"shift", "rad", &Metronome::shift},
                      Parameter{"omega", "rad/s", &Metronome::omega}};
  }
  X flow(metronome::Tick, const X& x, const U& u) const noexcept { return {drive - k * x[0] + u[0], omega}; }
  X flow(metronome::Tock, const X& x, const U& u) const noexcept { return {u[0] - k * x[0], omega}; }
  S guard(metronome::Off, const X& x, const U&) const noexcept { return sin(x[1] - shift); }
  S guard(metronome::On, const X& x, const U&) const noexcept { return -sin(x[1] - shift); }
  template <class E>
  X reset(E, const X& x, const U&) const noexcept {
    return {keep * x[0], x[1]};
  }
  template <class C>
  Vec<1, S> output(C, const X& x, const U&) const noexcept {
    return Vec<1, S>(x[0]);
  }
  Start<metronome::Tick, S> start() const noexcept { return {X{1.0, shift + 0.5}}; }
};

// Time itself, and a guard that is any cubic of it: (r1 - t)(r2 - t)(r3 - t) falls at r1 and r3 and rises at r2 when
// r1 < r2 < r3. Runge-Kutta and its cubic are exact here. No inputs.
namespace weave {
struct Line : Chart<1> {};  // (t [s])
struct Beyond : Chart<1> {};
struct Through : Edge<Line, Beyond> {};
}  // namespace weave
template <class S = double>
struct Weave {
  using Charts = List<weave::Line, weave::Beyond>;
  using Edges = List<weave::Through>;
  static constexpr std::string_view name = "weave";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"t", "s"}};

  S r1 = 0.2, r2 = 0.5, r3 = 0.9;  // [s]

  static constexpr auto parameters() {
    return std::array{Parameter{"r1", "s", &Weave::r1}, Parameter{"r2", "s", &Weave::r2},
                      Parameter{"r3", "s", &Weave::r3}};
  }
  template <class C>
  Vec<1, S> flow(C, const Vec<1, S>&, const Vec<0, S>&) const noexcept {
    return Vec<1, S>(S(1.0));
  }
  S guard(weave::Through, const Vec<1, S>& x, const Vec<0, S>&) const noexcept {
    return (r1 - x[0]) * (r2 - x[0]) * (r3 - x[0]);
  }
  Vec<1, S> reset(weave::Through, const Vec<1, S>& x, const Vec<0, S>&) const noexcept { return x; }
  template <class C>
  Vec<1, S> output(C, const Vec<1, S>& x, const Vec<0, S>&) const noexcept {
    return x;
  }
  Start<weave::Line, S> start() const noexcept { return {Vec<1, S>(S(0.0))}; }
};

}  // namespace saltus::worlds
