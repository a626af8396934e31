// What a hybrid model is: the concept HybridModel, check<M>() that names what a model lacks, its parameters, and
// lift<T>(m), the same model over another scalar.
//
// A model is a class template over its scalar S. It has
//   using Charts = List<...>; using Edges = List<...>;
//   static constexpr std::array inputs / outputs of Quantity (std::array<Quantity, 0> when there are none)
//   static constexpr std::string_view name
//   static constexpr auto parameters()                             std::array of Parameter{name, unit, &Model::member}
//   Vec<n, S>    flow  (C, const Vec<n, S>& x, const Vec<nu, S>& u) const    one a chart: the rate of the state [.../s]
//   S            guard (E, const Vec<n, S>& x, const Vec<nu, S>& u) const    one an edge: positive inside the chart
//   Vec<n', S>   reset (E, const Vec<n, S>& x, const Vec<nu, S>& u) const    one an edge: the state in the next chart
//   Vec<ny, S>   output(C, const Vec<n, S>& x, const Vec<nu, S>& u) const    one a chart
//   Start<C, S>  start() const                                     a state from which the orbit is sought
//   static constexpr bool branchless = true     where it may be said: nothing is decided by comparing values
//   (flow/lanes.hpp)
// Every data member is a parameter: lift copies parameters and nothing else.
#pragma once

#include <algorithm>
#include <array>
#include <concepts>
#include <string_view>
#include <type_traits>

#include "chart.hpp"

namespace saltus {

// A named data member of a model or an effect.
template <class M, class S>
struct Parameter {
  std::string_view name;
  std::string_view unit;
  S M::*member;
};
template <class M, class S>
Parameter(std::string_view, std::string_view, S M::*) -> Parameter<M, S>;

// The same template over another scalar: Hopper<double> -> Hopper<Dual<6>>. The scalar is the last argument.
// A template of another shape says how by itself: template <class T> using rebind, using Scalar.
template <class M>
concept RebindsItself = requires {
  typename M::template rebind<double>;
};
template <class M, class T>
struct Rebound;
template <template <class> class M, class S, class T>
requires(!RebindsItself<M<S>>) struct Rebound<M<S>, T> {
  using type = M<T>;
  using scalar = S;
};
template <template <class, class> class M, class P, class S, class T>
requires(!RebindsItself<M<P, S>>) struct Rebound<M<P, S>, T> {
  using type = M<P, T>;
  using scalar = S;
};
template <RebindsItself M, class T>
struct Rebound<M, T> {
  using type = typename M::template rebind<T>;
  using scalar = typename M::Scalar;
};
template <class M, class T>
using Rebind = typename Rebound<M, T>::type;
template <class M>
using ScalarOf = typename Rebound<M, double>::scalar;

template <class M>
inline constexpr int input_count = static_cast<int>(M::inputs.size());
template <class M>
inline constexpr int output_count = static_cast<int>(M::outputs.size());

template <class... Cs>
constexpr int largest_dim(List<Cs...>) noexcept {
  return std::max({Cs::dim...});
}
// The largest dimension of a model's charts.
template <class M>
inline constexpr int max_dim = largest_dim(typename M::Charts{});

template <class M>
using Input = Vec<input_count<M>, ScalarOf<M>>;
template <class M>
using Output = Vec<output_count<M>, ScalarOf<M>>;

// True when the model's charts carry a clock.
template <class... Cs>
constexpr bool any_clock(List<Cs...>) noexcept {
  return (HasClock<Cs> || ...);
}
template <class M>
inline constexpr bool clocked = any_clock(typename M::Charts{});

// Calls f(name, unit, value&) for every parameter, in declared order. Composite models visit their parts.
template <class M, class F>
constexpr void visit_parameters(M& m, F&& f) {
  if constexpr (requires { m.visit_parameters(f); }) {
    m.visit_parameters(f);
  } else {
    for (const auto& p : std::remove_const_t<M>::parameters()) f(p.name, p.unit, m.*(p.member));
  }
}

template <class M>
constexpr int count_parameters() noexcept {
  if constexpr (requires { M::parameter_count; }) {
    return M::parameter_count;
  } else {
    return static_cast<int>(M::parameters().size());
  }
}
template <class M>
inline constexpr int parameter_count = count_parameters<M>();

// The model with every parameter turned into a constant of scalar T.
template <class T, class M>
Rebind<M, T> lift(const M& m) noexcept {
  std::array<double, static_cast<std::size_t>(parameter_count<M>)> values{};
  std::size_t i = 0;
  visit_parameters(m, [&](auto, auto, const auto& v) { values[i++] = value_of(v); });
  Rebind<M, T> r;
  i = 0;
  visit_parameters(r, [&](auto, auto, T& v) { v = T(values[i++]); });
  return r;
}

namespace lacks {
// Of that very type: Eigen would convert a vector of another size, and complain much later.
template <class T, class X>
concept Exactly = std::same_as<std::remove_cvref_t<T>, X>;

// One static_assert a requirement, so that the compiler's message names the chart or the edge.
template <class M, class C>
constexpr bool chart() noexcept {
  using S = ScalarOf<M>;
  using X = Vec<C::dim, S>;
  constexpr bool flow = requires(const M& m, const X& x, const Input<M>& u) {
    { m.flow(C{}, x, u) } -> Exactly<X>;
  };
  static_assert(flow, "this chart has no Vec<dim, S> flow(chart, x, u) const");
  constexpr bool output = requires(const M& m, const X& x, const Input<M>& u) {
    { m.output(C{}, x, u) } -> Exactly<Output<M>>;
  };
  static_assert(output, "this chart has no Vec<outputs, S> output(chart, x, u) const");
  constexpr bool clock = !clocked<M> || (HasClock<C> && clock_of<C>() < C::dim);
  static_assert(clock, "one chart has a clock, so every chart must have one, inside its dimension");
  return flow && output && clock;
}
template <class M, class E>
constexpr bool edge() noexcept {
  using S = ScalarOf<M>;
  constexpr bool from = index_of<typename E::from>(typename M::Charts{}) >= 0;
  static_assert(from, "this edge leaves a chart that is not in Charts");
  constexpr bool to = index_of<typename E::to>(typename M::Charts{}) >= 0;
  static_assert(to, "this edge leads to a chart that is not in Charts");
  using X = Vec<E::from::dim, S>;
  constexpr bool guard = requires(const M& m, const X& x, const Input<M>& u) {
    { m.guard(E{}, x, u) } -> std::convertible_to<S>;
  };
  static_assert(guard, "this edge has no S guard(edge, x, u) const, positive inside the chart it leaves");
  constexpr bool reset = requires(const M& m, const X& x, const Input<M>& u) {
    { m.reset(E{}, x, u) } -> Exactly<Vec<E::to::dim, S>>;
  };
  static_assert(reset, "this edge has no Vec<dim of the next chart, S> reset(edge, x, u) const");
  return from && to && guard && reset;
}
template <class M, class... Cs>
constexpr bool charts(List<Cs...>) noexcept {
  return (chart<M, Cs>() && ...);
}
template <class M, class... Es>
constexpr bool edges(List<Es...>) noexcept {
  return (edge<M, Es>() && ...);
}
}  // namespace lacks

// static_assert(check<Hopper<>>()): true, or a compile error that names the chart or edge and what it lacks.
template <class M>
constexpr bool check() noexcept {
  static_assert(
      requires { typename M::Charts; }, "the model names no Charts = List<...>");
  static_assert(
      requires { typename M::Edges; }, "the model names no Edges = List<...>");
  static_assert(
      requires { M::inputs.size(); }, "the model has no static constexpr std::array inputs of Quantity");
  static_assert(
      requires { M::outputs.size(); }, "the model has no static constexpr std::array outputs of Quantity");
  static_assert(
      requires { M::parameters(); } || requires { M::parameter_count; },
      "the model has no static constexpr auto parameters()");
  static_assert(
      requires(const M& m) { m.start(); }, "the model has no Start<Chart, S> start() const");
  return lacks::charts<M>(typename M::Charts{}) && lacks::edges<M>(typename M::Edges{});
}

template <class M>
concept HybridModel = requires(const M& m) {
  typename M::Charts;
  typename M::Edges;
  typename ScalarOf<M>;
  M::inputs.size();
  M::outputs.size();
  m.start();
};

}  // namespace saltus
