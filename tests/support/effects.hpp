// Small effects for tests, one for each way an effect may act.
#pragma once

#include "core/hybrid/with.hpp"
#include "sim/models/hopper.hpp"

namespace saltus::worlds {

// A linear damper at a port.
template <class Port, class S = double>
struct Damper {
  S c = 0.3;  // [N s/m]
  static constexpr auto parameters() { return std::array{Parameter{"c", "N s/m", &Damper::c}}; }
  S force(Port, const S&, const S& rate) const noexcept { return -c * rate; }
};

// A spring at a port that stiffens with displacement.
template <class Port, class S = double>
struct Cubic {
  S k3 = 2.0;  // [N/m^3]
  static constexpr auto parameters() { return std::array{Parameter{"k3", "N/m^3", &Cubic::k3}}; }
  S force(Port, const S& displacement, const S&) const noexcept {
    return -k3 * displacement * displacement * displacement;
  }
};

// A force at a port that turns with the clock.
template <class Port, class S = double>
struct Shaker {
  S f = 0.5;  // [N]
  static constexpr auto parameters() { return std::array{Parameter{"f", "N", &Shaker::f}}; }
  S force(Port, const S&, const S&, const S& clock) const noexcept { return f * sin(clock); }
};

// A wind on the hopper's upper mass, in flight only: an effect on one chart's rate.
template <class S = double>
struct Wind {
  S w = 0.4;  // [m/s^2]
  static constexpr auto parameters() { return std::array{Parameter{"w", "m/s^2", &Wind::w}}; }
  Vec<5, S> flow(hopper::Flight, const Vec<5, S>& x, const Vec<1, S>& u) const noexcept {
    return {0.0, w * (1.0 + 0.1 * x[1] + u[0]), 0.0, 0.0, 0.0};
  }
};

// The ground of the hopper lies deeper than declared, where the foot meets and leaves it.
template <class S = double>
struct DeepGround {
  S depth = 0.02;  // [m]
  static constexpr auto parameters() { return std::array{Parameter{"depth", "m", &DeepGround::depth}}; }
  S guard(hopper::Touchdown, const Vec<5, S>&, const Vec<1, S>&) const noexcept { return depth; }
  Vec<5, S> reset(hopper::Liftoff, const Vec<3, S>&, const Vec<5, S>& after, const Vec<1, S>&) const noexcept {
    return {after[0], after[1], after[2], after[3] - depth, after[4]};
  }
};

// Part of the hopper's speed is lost at touchdown.
template <class S = double>
struct LossyTouchdown {
  S loss = 0.05;  // [-]
  static constexpr auto parameters() { return std::array{Parameter{"loss", "-", &LossyTouchdown::loss}}; }
  Vec<3, S> reset(hopper::Touchdown, const Vec<5, S>& before, const Vec<3, S>& after, const Vec<1, S>&) const noexcept {
    return {after[0], after[1] - loss * before[1], after[2]};
  }
};

// Touchdown brings the hopper's body to the speed that its weight would give it in a tenth of a second: an effect that
// asks the model.
template <class S = double>
struct Arrest {
  S share = 1.0;  // [-]
  static constexpr auto parameters() { return std::array{Parameter{"share", "-", &Arrest::share}}; }
  Vec<3, S> reset(const Hopper<S>& m, hopper::Touchdown, const Vec<5, S>&, const Vec<3, S>& after,
                  const Vec<1, S>&) const noexcept {
    return {after[0], -0.1 * share * m.g, after[2]};
  }
};

// The actuator gives more than it is told.
template <class S = double>
struct InputGain {
  S gain = 1.1;  // [-]
  static constexpr auto parameters() { return std::array{Parameter{"gain", "-", &InputGain::gain}}; }
  Vec<1, S> input(const Vec<1, S>& u) const noexcept { return Vec<1, S>(gain * u[0]); }
};

// The first sensor of two is off by a factor and an offset.
template <class S = double>
struct SensorError {
  S gain = 1.2;    // [-]
  S offset = 0.1;  // [m]
  static constexpr auto parameters() {
    return std::array{Parameter{"gain", "-", &SensorError::gain}, Parameter{"offset", "m", &SensorError::offset}};
  }
  Vec<2, S> output(const Vec<2, S>& y) const noexcept { return {gain * y[0] + offset, y[1]}; }
};

}  // namespace saltus::worlds
