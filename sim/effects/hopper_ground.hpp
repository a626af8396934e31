// The hopper with ground and foot that may be other than declared: compliant (a spring and damper under the foot, so
// that the foot moves while it stands) or elastic (the foot leaves with a part of its impact speed, hop after hop).
// Both zero: the hopper.
#pragma once

#include "../models/hopper.hpp"
#include "candidates.hpp"

namespace saltus {

namespace hopper {
struct Contact : Chart<5>, Clock<2> {};  // Flight's coordinates, the foot in the ground
struct Strike : Edge<Flight, Contact> {};
struct Release : Edge<Contact, Flight> {};
struct Hop : Chart<6>, Clock<2> {};  // Flight's after a bounce, and the speed [m/s] at which the foot left
struct Bounce : Edge<Flight, Hop> {};
struct Rebound : Edge<Hop, Hop> {};
struct Settle : Edge<Hop, Stance> {};
}  // namespace hopper

template <class S = double>
struct HopperOnGround {
  using Flight = hopper::Flight;
  using Stance = hopper::Stance;
  using Contact = hopper::Contact;
  using Hop = hopper::Hop;
  using Charts = List<Flight, Stance, Contact, Hop>;
  using Edges = List<hopper::Touchdown, hopper::Liftoff, hopper::Strike, hopper::Release, hopper::Bounce,
                     hopper::Rebound, hopper::Settle>;
  using OffsetEdges = typename Hopper<S>::Edges;
  using Ports = typename Hopper<S>::Ports;
  using U = Vec<1, S>;
  static constexpr std::string_view name = Hopper<S>::name;
  static constexpr auto inputs = Hopper<S>::inputs;
  static constexpr auto outputs = Hopper<S>::outputs;
  static constexpr double damping_ratio = 3.0;  // [-] of the ground with the foot's mass
  static constexpr double still = 2e-3;         // [m/s] a foot that left slower than this stays where it lands

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
  bool elastic() const noexcept { return value_of(restitution) > 0.0 && !soft(); }
  S stiffness() const noexcept { return 1.0 / compliance; }                                       // [N/m]
  S damping() const noexcept { return 2.0 * damping_ratio * sqrt(stiffness() * h.m); }            // [N s/m]
  S ground(const Vec<5, S>& x) const noexcept { return -stiffness() * x[3] - damping() * x[4]; }  // [N] on the foot
  // [s] The foot in the ground is stiff.
  double longest_step(Contact) const noexcept {
    const double fast = std::sqrt(value_of(stiffness()) / value_of(h.m)) *
                        (damping_ratio + std::sqrt(damping_ratio * damping_ratio - 1.0));
    return 0.8 / fast;
  }
  // [s] Where the foot bounces, small errors grow from hop to hop.
  double longest_step(Flight) const noexcept { return elastic() ? 0.01 : std::numeric_limits<double>::infinity(); }
  double longest_step(Stance) const noexcept { return longest_step(Flight{}); }
  double longest_step(Hop) const noexcept { return 0.005; }

  Vec<5, S> flow(Flight c, const Vec<5, S>& x, const U& u) const noexcept { return h.flow(c, x, u); }
  Vec<3, S> flow(Stance c, const Vec<3, S>& x, const U& u) const noexcept { return h.flow(c, x, u); }
  Vec<5, S> flow(Contact, const Vec<5, S>& x, const U& u) const noexcept {
    Vec<5, S> f = h.flow(Flight{}, x, u);
    f[4] += (ground(x) + h.b * x[4]) / h.m;  // the foot's drag acts in the air alone
    return f;
  }
  Vec<6, S> flow(Hop, const Vec<6, S>& x, const U& u) const noexcept {
    return with_memory(h.flow(Flight{}, x.template head<5>(), u), S(0.0));
  }
  S guard(hopper::Touchdown, const Vec<5, S>& x, const U&) const noexcept {
    return soft() || elastic() ? S(1.0) : x[3];
  }
  // A foot that rises out of the ground does not strike it.
  S guard(hopper::Strike, const Vec<5, S>& x, const U&) const noexcept {
    return soft() && value_of(x[4]) < 0.0 ? x[3] : S(1.0);
  }
  S guard(hopper::Bounce, const Vec<5, S>& x, const U&) const noexcept { return elastic() ? x[3] : S(1.0); }
  // The speed at which a hop began tells how it ends: a guard that asked for the speed of the moment would jump.
  S guard(hopper::Rebound, const Vec<6, S>& x, const U&) const noexcept {
    return value_of(x[5]) > still ? x[3] : S(1.0);
  }
  S guard(hopper::Settle, const Vec<6, S>& x, const U&) const noexcept {
    return value_of(x[5]) > still ? S(1.0) : x[3];
  }
  S guard(hopper::Liftoff e, const Vec<3, S>& x, const U& u) const noexcept { return h.guard(e, x, u); }
  S guard(hopper::Release, const Vec<5, S>& x, const U&) const noexcept { return ground(x); }
  Vec<3, S> reset(hopper::Touchdown e, const Vec<5, S>& x, const U& u) const noexcept { return h.reset(e, x, u); }
  Vec<5, S> reset(hopper::Liftoff e, const Vec<3, S>& x, const U& u) const noexcept { return h.reset(e, x, u); }
  Vec<5, S> reset(hopper::Strike, const Vec<5, S>& x, const U&) const noexcept { return x; }
  Vec<5, S> reset(hopper::Release, const Vec<5, S>& x, const U&) const noexcept { return x; }
  Vec<6, S> reset(hopper::Bounce, const Vec<5, S>& x, const U&) const noexcept { return thrown_back(x); }
  Vec<6, S> reset(hopper::Rebound, const Vec<6, S>& x, const U&) const noexcept {
    return thrown_back(x.template head<5>());
  }
  Vec<3, S> reset(hopper::Settle, const Vec<6, S>& x, const U& u) const noexcept {
    return h.reset(hopper::Touchdown{}, x.template head<5>(), u);
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
  Motion<S, 6> port(P p, Hop, const Vec<6, S>& x) const noexcept {
    const Motion<S, 5> f = h.port(p, Flight{}, x.template head<5>());
    return {f.displacement, f.rate, with_memory(f.per_force, S(0.0))};
  }
  template <class P>
  requires(!std::is_same_v<P, hopper::Foot>) Motion<S, 3> port(P p, Stance c, const Vec<3, S>& x)
  const noexcept { return h.port(p, c, x); }
  S reaction(hopper::Leg p, hopper::Liftoff e) const noexcept { return h.reaction(p, e); }

  auto start() const { return h.start(); }

 private:
  static Vec<6, S> with_memory(const Vec<5, S>& x, const S& memory) noexcept {
    return {x[0], x[1], x[2], x[3], x[4], memory};
  }
  Vec<6, S> thrown_back(const Vec<5, S>& x) const noexcept {
    const S speed = -restitution * x[4];
    return {x[0], x[1], x[2], x[3], speed, speed};
  }
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
