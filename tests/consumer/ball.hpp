#include <saltus/core/hybrid/with.hpp>

namespace ball {
using namespace saltus;

struct Flight : Chart<3>, Clock<2> {};   // (y [m], v [m/s], clock [rad])
struct Impact : Edge<Flight, Flight> {};
struct Body {};                          // a port: the ball against the world

// A ball bouncing on a vibrating table.
template <class S = double>
struct Juggler {
  using Charts = List<Flight>;
  using Edges = List<Impact>;
  using Ports = List<Body>;
  using X = Vec<3, S>;
  using U = Vec<1, S>;
  static constexpr std::string_view name = "juggler";
  static constexpr std::array inputs{Quantity{"u", "N"}};
  static constexpr std::array outputs{Quantity{"y", "m"}, Quantity{"v", "m/s"}};

  S m = 0.5;                             // [kg]
  S g = 9.81;                            // [m/s^2]
  S A = 0.112;                           // [m]     amplitude of the table
  S e = 0.8;                             // [-]     restitution
  S omega = 2.0 * std::numbers::pi;      // [rad/s] of the table
  static constexpr auto parameters() {
    return std::array{Parameter{"m", "kg", &Juggler::m}, Parameter{"g", "m/s^2", &Juggler::g}, Parameter{"A", "m", &Juggler::A},
                      Parameter{"e", "-", &Juggler::e}, Parameter{"omega", "rad/s", &Juggler::omega}};
  }

  X flow(Flight, const X& x, const U& u) const noexcept { return {x[1], u[0] / m - g, omega}; }
  S guard(Impact, const X& x, const U&) const noexcept { return x[0] - A * sin(x[2]); }
  X reset(Impact, const X& x, const U&) const noexcept {
    const S table = A * omega * cos(x[2]);
    return {x[0], table + e * (table - x[1]), x[2]};
  }
  Vec<2, S> output(Flight, const X& x, const U&) const noexcept { return {x[0], x[1]}; }
  Motion<S, 3> port(Body, Flight, const X& x) const noexcept { return {x[0], x[1], {0.0, 1.0 / m, 0.0}}; }
  Start<Flight, S> start() const noexcept { return {X{0.55, -3.8, 0.0}}; }
};
static_assert(check<Juggler<>>());

// An effect the model lacks: air drag on the ball.
template <class S = double>
struct AirDrag {
  S c = 0.003;                           // [N s^2/m^2]
  static constexpr auto parameters() { return std::array{Parameter{"c", "N s^2/m^2", &AirDrag::c}}; }
  S force(Body, const S&, const S& v) const noexcept { return -c * abs(v) * v; }
};
}  // namespace ball
