// With<Model, Effects...>: a model with effects added, again a model. An effect is a class template over the scalar
// with `parameters()` like a model's, and any of
//   S      force (Port, const S& displacement, const S& rate) const     a force [N or N m] at a port of the model;
//   S      force (Port, const S& displacement, const S& rate, const S& clock) const   in charts with a clock [rad]
//   Vec<n> flow  (C, const Vec<n, S>& x, const Vec<nu, S>& u) const     added to the rate of chart C
//   S      guard (E, const Vec<n, S>& x, const Vec<nu, S>& u) const     added to the guard of edge E
//   Vec<n'> reset(E, const Vec<n, S>& before, const Vec<n', S>& after, const Vec<nu, S>& u) const    replaces the state
//                                                                        after edge E
//                                                                        or (model, E, before, after, u)
//   Vec<nu> input (const Vec<nu, S>& u) const                            replaces the input
//   Vec<ny> output(const Vec<ny, S>& y) const                            replaces the output
// An effect acts where its overloads fit; one that acts nowhere does not compile. An effect whose parameters are all
// zero leaves the model as it is: rest_idle() then skips it, so that a model may carry every candidate at no cost.
// A force that jumps where its port's rate changes sign (dry friction) says so by `static constexpr bool kinked = true`.
#pragma once

#include <cstdint>
#include <string_view>
#include <tuple>
#include <type_traits>

#include "model.hpp"

namespace saltus {

template <class M>
struct PortsOf {
  using type = List<>;
};
template <class M>
requires requires { typename M::Ports; }
struct PortsOf<M> {
  using type = typename M::Ports;
};

// Zero, and of zero derivative: what multiplies it is not there.
template <class S>
constexpr bool vanishes(const S& x) noexcept {
  if constexpr (requires { x.gradient; }) {
    for (const double g : x.gradient) {
      if (g != 0.0) return false;
    }
    return x.value == 0.0;
  } else {
    return x == S(0);
  }
}

template <class M, class... Effects>
struct With {
  static_assert(sizeof...(Effects) <= 64);
  using S = ScalarOf<M>;
  using Scalar = S;
  template <class T>
  using rebind = With<Rebind<M, T>, Rebind<Effects, T>...>;
  using Charts = typename M::Charts;
  using Edges = typename M::Edges;
  using Ports = typename PortsOf<M>::type;
  using U = Input<M>;
  static constexpr auto inputs = M::inputs;
  static constexpr auto outputs = M::outputs;
  static constexpr std::string_view name = M::name;
  static constexpr std::uint64_t every_effect =  // a bit each
      sizeof...(Effects) == 0 ? 0 : ~std::uint64_t{0} >> (64 - sizeof...(Effects));
  static constexpr std::uint64_t kinked_effects = [] {
    std::uint64_t bits = 0, bit = 1;
    ((bits |= requires { Effects::kinked; } ? bit : 0, bit <<= 1), ...);
    return bits;
  }();
  static constexpr int parameter_count = saltus::parameter_count<M> + (0 + ... + saltus::parameter_count<Effects>);

  M model{};
  std::tuple<Effects...> effects{};
  std::uint64_t resting = 0;  // effects that are skipped, bit i for the i-th; lift() wakes them all

  With() = default;
  explicit With(const M& m, const Effects&... e) noexcept : model(m), effects(e...) {}

  template <class C>
  Vec<C::dim, S> flow(C c, const Vec<C::dim, S>& x, const U& u_given) const noexcept {
    const U u = input(u_given);
    Vec<C::dim, S> f = model.flow(c, x, u);
    each_effect([&](const auto& e) {
      each_port([&](auto p) {
        if constexpr (forced<decltype(e), decltype(p), C>()) {
          const Motion<S, C::dim> at = model.port(p, c, x);
          const S force = force_of(e, p, c, at, x);
          for (int i = 0; i < C::dim; ++i) f[i] += at.per_force[i] * force;
        }
      });
      if constexpr (requires { e.flow(c, x, u); }) f += e.flow(c, x, u);
    });
    return f;
  }

  template <class E>
  S guard(E edge, const Vec<E::from::dim, S>& x, const U& u_given) const noexcept {
    const U u = input(u_given);
    S g = model.guard(edge, x, u);
    each_effect([&](const auto& e) {
      each_port([&](auto p) {
        // A force that passes through a guard (a leg force in a ground reaction) says so by reaction(port, edge).
        if constexpr (forced<decltype(e), decltype(p), typename E::from>() && reacts<decltype(p), E>()) {
          const Motion<S, E::from::dim> at = model.port(p, typename E::from{}, x);
          g += reaction(p, edge) * force_of(e, p, typename E::from{}, at, x);
        }
      });
      if constexpr (requires { e.guard(edge, x, u); }) g += e.guard(edge, x, u);
    });
    return g;
  }

  template <class E>
  Vec<E::to::dim, S> reset(E edge, const Vec<E::from::dim, S>& x, const U& u_given) const noexcept {
    const U u = input(u_given);
    Vec<E::to::dim, S> after = model.reset(edge, x, u);
    each_effect([&](const auto& e) {
      if constexpr (requires { e.reset(edge, x, after, u); }) after = e.reset(edge, x, after, u);
      if constexpr (requires { e.reset(model, edge, x, after, u); }) after = e.reset(model, edge, x, after, u);
    });
    return after;
  }

  template <class C>
  Output<M> output(C c, const Vec<C::dim, S>& x, const U& u_given) const noexcept {
    Output<M> y = model.output(c, x, input(u_given));
    each_effect([&](const auto& e) {
      if constexpr (requires { e.output(y); }) y = e.output(y);
    });
    return y;
  }

  // Skips, from now on, the effects whose parameters vanish. Call again when a parameter has changed.
  void rest_idle() noexcept {
    resting = 0;
    std::uint64_t bit = 1;
    each_effect([&](const auto& e) {
      bool idle = saltus::parameter_count<std::remove_cvref_t<decltype(e)>> > 0;  // one without any always acts
      saltus::visit_parameters(e, [&](auto, auto, const S& v) { idle = idle && vanishes(v); });
      if (idle) resting |= bit;
      bit <<= 1;
    }, 0);
  }

  // Whether a kinked effect acts anywhere.
  bool kinked() const noexcept { return (kinked_effects & ~resting) != 0; }

  // Calls f(rate) for the port rate of every kinked effect that acts in chart C: the flow jumps where it changes sign.
  template <class C, class F>
  void visit_kinks(C c, const Vec<C::dim, S>& x, F&& f) const noexcept {
    if (!kinked()) return;
    each_effect([&](const auto& e) {
      if constexpr (requires { std::remove_cvref_t<decltype(e)>::kinked; }) {
        each_port([&](auto p) {
          if constexpr (forced<decltype(e), decltype(p), C>()) f(model.port(p, c, x).rate);
        });
      }
    });
  }

  // Calls f(rate, here, most) for every kinked effect that acts in chart C: the rate of its port, and how fast the
  // effect brings that to rest, there and at the kink [1/s]. A step longer than a few of these times overshoots.
  template <class C, class F>
  void visit_stiffness(C c, const Vec<C::dim, S>& x, F&& f) const noexcept {
    if (!kinked()) return;
    each_effect([&](const auto& e) {
      if constexpr (requires { std::remove_cvref_t<decltype(e)>::kinked; }) {
        each_port([&](auto p) {
          if constexpr (forced<decltype(e), decltype(p), C>()) {
            const Motion<S, C::dim> at = model.port(p, c, x);
            const S per_force = model.port(p, c, x + at.per_force).rate - at.rate;
            constexpr double small = 1e-4;  // [m/s or rad/s]
            const auto slope = [&](const S& rate) {
              Motion<S, C::dim> below = at, above = at;
              below.rate = rate - small;
              above.rate = rate + small;
              return per_force * (force_of(e, p, c, below, x) - force_of(e, p, c, above, x)) / (2.0 * small);
            };
            f(at.rate, slope(at.rate), slope(S(0.0)));
          }
        });
      }
    });
  }

  // The model's own ports pass through, so that effects can be added to what already has some.
  template <class P, class C>
  requires requires(const M& m, P p, C c, const Vec<C::dim, S>& x) { m.port(p, c, x); }
  Motion<S, C::dim> port(P p, C c, const Vec<C::dim, S>& x) const noexcept { return model.port(p, c, x); }
  template <class P, class E>
  requires requires(const M& m, P p, E e) { m.reaction(p, e); }
  S reaction(P p, E e) const noexcept { return model.reaction(p, e); }

  // [s] The longest step a stiff chart allows.
  template <class C>
  requires requires(const M& m, C c) { m.longest_step(c); }
  double longest_step(C c) const noexcept { return model.longest_step(c); }

  auto start() const noexcept { return model.start(); }

  template <class F>
  void visit_parameters(F&& f) {
    saltus::visit_parameters(model, f);
    std::apply([&](auto&... e) { (saltus::visit_parameters(e, f), ...); }, effects);
  }
  template <class F>
  void visit_parameters(F&& f) const {
    saltus::visit_parameters(model, f);
    std::apply([&](const auto&... e) { (saltus::visit_parameters(e, f), ...); }, effects);
  }

 private:
  template <class F>
  void each_effect(F&& f) const {
    each_effect(f, resting);
  }
  template <class F>
  void each_effect(F&& f, std::uint64_t skipped) const {
    if (skipped == every_effect) return;
    std::apply(
        [&](const auto&... e) { ((static_cast<void>((skipped & 1) == 0 ? (f(e), 0) : 0), skipped >>= 1), ...); },
        effects);
  }
  template <class F>
  static void each_port(F&& f) {
    visit_each(Ports{}, f);
  }
  U input(const U& u_given) const noexcept {
    U u = u_given;
    each_effect([&](const auto& e) {
      if constexpr (requires { e.input(u); }) u = e.input(u);
    });
    return u;
  }

  template <class E, class P, class C>
  static S force_of(const E& e, P p, C, const Motion<S, C::dim>& at, const Vec<C::dim, S>& x) noexcept {
    if constexpr (clock_of<C>() >= 0 && requires(const S& s) { e.force(p, s, s, s); }) {
      return e.force(p, at.displacement, at.rate, x[clock_of<C>()]);
    } else {
      return e.force(p, at.displacement, at.rate);
    }
  }
  template <class E, class P, class C>
  static constexpr bool forced() noexcept {
    constexpr bool port = requires(const M& m, P p, C c, const Vec<C::dim, S>& x) { m.port(p, c, x); };
    constexpr bool plain = requires(const E& e, P p, const S& s) { e.force(p, s, s); };
    constexpr bool timed = clock_of<C>() >= 0 && requires(const E& e, P p, const S& s) { e.force(p, s, s, s); };
    return port && (plain || timed);
  }
  template <class P, class E>
  static constexpr bool reacts() noexcept {
    return requires(const M& m, P p, E e) { m.reaction(p, e); };
  }
  template <class E, class... Cs, class... Es, class... Ps>
  static constexpr bool acts(List<Cs...>, List<Es...>, List<Ps...>) noexcept {
    constexpr bool on_charts =
        ((requires(const E& e, const Vec<Cs::dim, S>& x, const U& u) { e.flow(Cs{}, x, u); }) || ...);
    constexpr bool on_edges =
        ((requires(const E& e, const Vec<Es::from::dim, S>& x, const Vec<Es::to::dim, S>& after, const U& u) {
           e.reset(Es{}, x, after, u);
         }) ||
         ... || false) ||
        ((requires(const M& m, const E& e, const Vec<Es::from::dim, S>& x, const Vec<Es::to::dim, S>& after,
                   const U& u) { e.reset(m, Es{}, x, after, u); }) ||
         ... || false) ||
        ((requires(const E& e, const Vec<Es::from::dim, S>& x, const U& u) { e.guard(Es{}, x, u); }) || ... || false);
    constexpr bool on_ports = (forced_somewhere<E, Ps, Cs...>() || ... || false);
    constexpr bool on_wires = requires(const E& e, const U& u) { e.input(u); }
    || requires(const E& e, const Output<M>& y) { e.output(y); };
    return on_charts || on_edges || on_ports || on_wires;
  }
  template <class E, class P, class... Cs>
  static constexpr bool forced_somewhere() noexcept {
    return (forced<E, P, Cs>() || ...);
  }
  template <class E>
  static constexpr bool acts_somewhere() noexcept {
    constexpr bool yes = acts<E>(Charts{}, Edges{}, Ports{});
    static_assert(yes,
                  "this effect acts nowhere on this model: no port, chart, edge, input or output fits its overloads");
    return yes;
  }
  static_assert((acts_somewhere<Effects>() && ...));
};

template <class M, class... Effects>
With(const M&, const Effects&...) -> With<M, Effects...>;

}  // namespace saltus
