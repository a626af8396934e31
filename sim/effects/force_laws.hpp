// Force laws, each for any port of any model: one coefficient, zero = not there. A law of one's own is a struct like
// these, over a port and a scalar, with `law`, `parameters()` and `force`; OwnEffects (candidates.hpp) makes it a
// candidate. `physical` is the sign a coefficient must have: +1 for what dissipates, 0 for either.
//
// A port says what it is: `internal` (between two parts of the machine, its displacement counted from rest),
// `rotary` (an angle: rad and N m in the place of m and N; with `turns`, one that goes round and round). With neither
// it is a displacement against the world.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

#include "core/hybrid/with.hpp"

namespace saltus {

template <class P>
concept Internal = P::internal;
template <class P>
concept Rotary = P::rotary;

template <class P>
concept Turning = P::turns;

namespace effects {

// Dry friction changes sign within this rate [m/s or rad/s]; a step as far as any measurement sees.
inline constexpr double sticking_rate = 1e-3;

// -c v. A damper between two parts, drag against the world.
template <class P, class S = double>
struct Viscous {
  static constexpr std::string_view law = Internal<P> ? "viscous_damper" : "viscous_drag";
  static constexpr int physical = 1;
  S c = 0.0;  // [N s/m]
  static constexpr auto parameters() {
    return std::array{Parameter{"c", Rotary<P> ? "N m s/rad" : "N s/m", &Viscous::c}};
  }
  S force(P, const S&, const S& rate) const noexcept { return -c * rate; }
};

// -c |v| v
template <class P, class S = double>
struct Quadratic {
  static constexpr std::string_view law = "quadratic_drag";
  static constexpr int physical = 1;
  S c = 0.0;  // [N s^2/m^2]
  static constexpr auto parameters() {
    return std::array{Parameter{"c", Rotary<P> ? "N m s^2/rad^2" : "N s^2/m^2", &Quadratic::c}};
  }
  S force(P, const S&, const S& rate) const noexcept { return -c * abs(rate) * rate; }
};

// -F sign v
template <class P, class S = double>
struct Coulomb {
  static constexpr std::string_view law = "coulomb_friction";
  static constexpr int physical = 1;
  static constexpr bool kinked = true;
  S F = 0.0;  // [N]
  static constexpr auto parameters() { return std::array{Parameter{"F", Rotary<P> ? "N m" : "N", &Coulomb::F}}; }
  S force(P, const S&, const S& rate) const noexcept { return -F * tanh(rate / sticking_rate); }
};

// -F for v > 0, none for v < 0.
template <class P, class S = double>
struct AsymmetricCoulomb {
  static constexpr std::string_view law = "asymmetric_coulomb";
  static constexpr int physical = 0;
  static constexpr int physical_sum = 1;  // with the friction that it refines
  static constexpr bool kinked = true;
  static constexpr bool refines = true;  // of Coulomb: considered only where the data can tell the two apart
  S F = 0.0;                             // [N]
  static constexpr auto parameters() {
    return std::array{Parameter{"F", Rotary<P> ? "N m" : "N", &AsymmetricCoulomb::F}};
  }
  S force(P, const S&, const S& rate) const noexcept { return -F * 0.5 * (1.0 + tanh(rate / sticking_rate)); }
};

// -F exp(-|v| / scale) sign v: what dry friction has more at rest than in motion.
template <class P, class S = double>
struct Stribeck {
  static constexpr std::string_view law = "stribeck";
  static constexpr int physical = 1;
  static constexpr bool kinked = true;
  static constexpr bool refines = true;  // of Coulomb: considered only where the data can tell the two apart
  static constexpr double scale = 0.5;   // [m/s or rad/s]
  S F = 0.0;                             // [N]
  static constexpr auto parameters() { return std::array{Parameter{"F", Rotary<P> ? "N m" : "N", &Stribeck::F}}; }
  S force(P, const S&, const S& rate) const noexcept {
    return -F * exp(abs(rate) * (-1.0 / scale)) * tanh(rate / sticking_rate);
  }
};

// -k3 d^3, d from rest.
template <class P, class S = double>
struct Cubic {
  static constexpr std::string_view law = "cubic_stiffness";
  static constexpr int physical = 0;
  S k3 = 0.0;  // [N/m^3]
  static constexpr auto parameters() {
    return std::array{Parameter{"k3", Rotary<P> ? "N m/rad^3" : "N/m^3", &Cubic::k3}};
  }
  S force(P, const S& displacement, const S&) const noexcept {
    return -k3 * displacement * displacement * displacement;
  }
};

template <class P, class S = double>
struct ConstantForce {
  static constexpr std::string_view law = "constant_force";
  static constexpr int physical = 0;
  S F = 0.0;  // [N]
  static constexpr auto parameters() { return std::array{Parameter{"F", Rotary<P> ? "N m" : "N", &ConstantForce::F}}; }
  S force(P, const S&, const S&) const noexcept { return F; }
};

// C cos(clock) + D sin(clock): one that repeats with the cycle. It moves the mean cycle and hardly the response to
// stimuli, where almost any law could be mistaken for it; so it is asked last, when no law explains a record.
template <class P, class S = double>
struct PeriodicForce {
  static constexpr std::string_view law = "periodic_force";
  static constexpr bool last_resort = true;
  S C = 0.0;  // [N] along the cosine of the clock's angle
  S D = 0.0;  // [N] along its sine
  static constexpr auto parameters() {
    return std::array{Parameter{"C", Rotary<P> ? "N m" : "N", &PeriodicForce::C},
                      Parameter{"D", Rotary<P> ? "N m" : "N", &PeriodicForce::D}};
  }
  S force(P, const S&, const S&, const S& clock) const noexcept { return C * cos(clock) + D * sin(clock); }
};

// Any force over the turn of the clock, linear between `knots` equidistant phases. Not a cause but a picture: it shows
// where in the stride a force is missing, and `profile` keeps it out of the list of causes.
template <class P, class S = double>
struct ForceProfile {
  static constexpr std::string_view law = "force_profile";
  static constexpr bool profile = true;
  static constexpr int knots = 16;
  std::array<S, knots> F{};  // [N] at clock angle 2 pi i / knots
  static constexpr int parameter_count = knots;
  template <class V>
  constexpr void visit_parameters(V&& f) {
    for (S& v : F) f("F", Rotary<P> ? "N m" : "N", v);
  }
  template <class V>
  constexpr void visit_parameters(V&& f) const {
    for (const S& v : F) f("F", Rotary<P> ? "N m" : "N", v);
  }
  S force(P, const S&, const S&, const S& clock) const noexcept {
    const S turns = clock * (knots / (2.0 * std::numbers::pi));
    const double whole = std::floor(value_of(turns));
    const S part = turns - whole;
    const auto i = static_cast<std::size_t>(static_cast<std::int64_t>(whole) % knots + knots) % knots;
    return F[i] * (1.0 - part) + F[(i + 1) % knots] * part;
  }
};

// A constant added to the guard of an edge: the event comes late.
template <class E, class S = double>
struct GuardOffset {
  static constexpr std::string_view law = "guard_offset";
  static constexpr int physical = 0;
  S offset = 0.0;  // [unit of the guard]
  static constexpr auto parameters() { return std::array{Parameter{"offset", "SI", &GuardOffset::offset}}; }
  template <class X, class U>
  S guard(E, const X&, const U&) const noexcept {
    return offset;
  }
};

}  // namespace effects
}  // namespace saltus
