// The hopper with ground and foot that may be other than declared: compliant (a spring and damper under the foot, so that
// the foot moves while it stands) or elastic (the foot leaves with a part of its impact speed). Both zero: the hopper.
#pragma once

#include "../models/hopper.hpp"
#include "candidates.hpp"

namespace saltus {

namespace hopper {
struct Contact : Chart<5>, Clock<2> {};  // Flight's coordinates, the foot in the ground
struct Strike : Edge<Flight, Contact> {};
struct Release : Edge<Contact, Flight> {};
struct Bounce : Edge<Flight, Flight> {};
}  // namespace hopper

template <class S = double>
struct HopperOnGround {
  using Flight = hopper::Flight;
  using Stance = hopper::Stance;
  using Contact = hopper::Contact;
  using Charts = List<Flight, Stance, Contact>;
  using Edges = List<hopper::Touchdown, hopper::Liftoff, hopper::Strike, hopper::Release, hopper::Bounce>;
  using Ports = typename Hopper<S>::Ports;
  using U = Vec<1, S>;
  static constexpr std::string_view name = Hopper<S>::name;
  static constexpr auto inputs = Hopper<S>::inputs;
  static constexpr auto outputs = Hopper<S>::outputs;
  static constexpr double damping_ratio = 3.0;  // [-] of the ground with the foot's mass
  static constexpr double still = 1e-3;         // [m/s] slower than this the foot does not bounce

  Hopper<S> h{};
  S compliance{};   // [m/N] 1 / stiffness of the ground
  S restitution{};  // [-]   of the foot

  static constexpr int structural_parameters = 2;
  static constexpr int parameter_count = saltus::parameter_count<Hopper<S>> + structural_parameters;
  template <class F>
  constexpr void visit_parameters(F&& f) {
    saltus::visit_parameters(h, f);
    f("compliant_ground", "m/N", compliance);
    f("restitution", "1", restitution);
  }
  template <class F>
  constexpr void visit_parameters(F&& f) const {
    saltus::visit_parameters(h, f);
    f("compliant_ground", "m/N", compliance);
    f("restitution", "1", restitution);
  }
  // Sizes at which to ask what the parameters that change the charts would do; 0 for the others.
  static constexpr double structural(std::string_view parameter) {
    return parameter == "compliant_ground" ? 3e-4 : parameter == "restitution" ? 0.2 : 0.0;
  }

  bool soft() const noexcept { return value_of(compliance) > 0.0; }
  bool bounces(const Vec<5, S>& x) const noexcept { return value_of(restitution) * std::abs(value_of(x[4])) > still; }
  S stiffness() const noexcept { return 1.0 / compliance; }                              // [N/m]
  S damping() const noexcept { return 2.0 * damping_ratio * sqrt(stiffness() * h.m); }   // [N s/m]
  S ground(const Vec<5, S>& x) const noexcept { return -stiffness() * x[3] - damping() * x[4]; }  // [N] on the foot
  // [s] The foot in the ground is stiff.
  double longest_step(Contact) const noexcept {
    const double fast = std::sqrt(value_of(stiffness()) / value_of(h.m)) * (damping_ratio + std::sqrt(damping_ratio * damping_ratio - 1.0));
    return 0.8 / fast;
  }

  Vec<5, S> flow(Flight c, const Vec<5, S>& x, const U& u) const noexcept { return h.flow(c, x, u); }
  Vec<3, S> flow(Stance c, const Vec<3, S>& x, const U& u) const noexcept { return h.flow(c, x, u); }
  Vec<5, S> flow(Contact, const Vec<5, S>& x, const U& u) const noexcept {
    Vec<5, S> f = h.flow(Flight{}, x, u);
    f[4] += (ground(x) + h.b * x[4]) / h.m;  // the foot's drag acts in the air alone
    return f;
  }
  S guard(hopper::Touchdown, const Vec<5, S>& x, const U&) const noexcept { return soft() || bounces(x) ? S(1.0) : x[3]; }
  // A foot that rises out of the ground does not strike it.
  S guard(hopper::Strike, const Vec<5, S>& x, const U&) const noexcept { return soft() && value_of(x[4]) < 0.0 ? x[3] : S(1.0); }
  S guard(hopper::Bounce, const Vec<5, S>& x, const U&) const noexcept { return !soft() && bounces(x) ? x[3] : S(1.0); }
  S guard(hopper::Liftoff e, const Vec<3, S>& x, const U& u) const noexcept { return h.guard(e, x, u); }
  S guard(hopper::Release, const Vec<5, S>& x, const U&) const noexcept { return ground(x); }
  Vec<3, S> reset(hopper::Touchdown e, const Vec<5, S>& x, const U& u) const noexcept { return h.reset(e, x, u); }
  Vec<5, S> reset(hopper::Liftoff e, const Vec<3, S>& x, const U& u) const noexcept { return h.reset(e, x, u); }
  Vec<5, S> reset(hopper::Strike, const Vec<5, S>& x, const U&) const noexcept { return x; }
  Vec<5, S> reset(hopper::Release, const Vec<5, S>& x, const U&) const noexcept { return x; }
  Vec<5, S> reset(hopper::Bounce, const Vec<5, S>& x, const U&) const noexcept {
    return {x[0], x[1], x[2], x[3], -restitution * x[4]};
  }
  template <class C>
  Vec<2, S> output(C, const Vec<C::dim, S>& x, const U&) const noexcept {
    return {x[0], x[1]};
  }

  template <class P>
  Motion<S, 5> port(P p, Flight c, const Vec<5, S>& x) const noexcept {
    return h.port(p, c, x);
  }
  template <class P>
  Motion<S, 5> port(P p, Contact, const Vec<5, S>& x) const noexcept {
    return h.port(p, Flight{}, x);
  }
  template <class P>
  requires(!std::is_same_v<P, hopper::Foot>) Motion<S, 3> port(P p, Stance c, const Vec<3, S>& x) const noexcept {
    return h.port(p, c, x);
  }
  S reaction(hopper::Leg p, hopper::Liftoff e) const noexcept { return h.reaction(p, e); }

  auto start() const { return h.start(); }
};
static_assert(check<HopperOnGround<>>());

namespace effects {
// The ground at height h: nothing but the origin of all heights moves.
template <class S = double>
struct GroundHeight {
  static constexpr std::string_view law = "ground_height";
  S h = 0.0;  // [m]
  static constexpr auto parameters() { return std::array{Parameter{"h", "m", &GroundHeight::h}}; }
  Vec<2, S> output(const Vec<2, S>& y) const noexcept { return {y[0] + h, y[1]}; }
};
}  // namespace effects

template <class S>
struct OwnEffects<HopperOnGround<S>> {
  using type = List<effects::GroundHeight<S>>;
};

}  // namespace saltus
