// A sound model of two charts; each file beside this one leaves out or damages one thing, named by a macro.
#pragma once

#include "core/hybrid/with.hpp"

namespace small {

using namespace saltus;

struct High : Chart<2>, Clock<1> {};
#ifdef CHART_WITHOUT_CLOCK
struct Low : Chart<1> {};
#else
struct Low : Chart<1>, Clock<0> {};
#endif
struct Elsewhere : Chart<3>, Clock<0> {};
struct Down : Edge<High, Low> {};
#ifdef EDGE_TO_NOWHERE
struct Up : Edge<Low, Elsewhere> {};
#else
struct Up : Edge<Low, High> {};
#endif
struct Handle {};
struct Wheel {};

template <class S = double>
struct Model {
#ifndef NO_CHARTS
  using Charts = List<High, Low>;
#endif
  using Edges = List<Down, Up>;
  using Ports = List<Handle>;
  static constexpr std::string_view name = "small";
#ifndef NO_INPUTS
  static constexpr std::array inputs{Quantity{"u", "N"}};
#endif
  static constexpr std::array outputs{Quantity{"y", "m"}, Quantity{"z", "m"}};
  S k = 1.0;
#ifndef NO_PARAMETERS
  static constexpr auto parameters() { return std::array{Parameter{"k", "-", &Model::k}}; }
#endif

  using U = Vec<1, S>;
  Vec<2, S> flow(High, const Vec<2, S>& x, const U& u) const { return {u[0] - k * x[0], 1.0}; }
#ifdef FLOW_OF_WRONG_SIZE
  Vec<2, S> flow(Low, const Vec<1, S>&, const U&) const { return {1.0, 1.0}; }
#elif !defined(NO_FLOW)
  Vec<1, S> flow(Low, const Vec<1, S>&, const U&) const { return Vec<1, S>(S(1.0)); }
#endif
  S guard(Down, const Vec<2, S>& x, const U&) const { return x[0]; }
#ifndef NO_GUARD
  S guard(Up, const Vec<1, S>& x, const U&) const { return sin(x[0]); }
#endif
  Vec<1, S> reset(Down, const Vec<2, S>& x, const U&) const { return Vec<1, S>(x[1]); }
#ifdef RESET_OF_WRONG_SIZE
  Vec<1, S> reset(Up, const Vec<1, S>& x, const U&) const { return x; }
#elif !defined(NO_RESET)
  Vec<2, S> reset(Up, const Vec<1, S>& x, const U&) const { return {1.0, x[0]}; }
#endif
  Vec<2, S> output(High, const Vec<2, S>& x, const U&) const { return x; }
#ifdef OUTPUT_OF_WRONG_SIZE
  Vec<1, S> output(Low, const Vec<1, S>& x, const U&) const { return x; }
#elif !defined(NO_OUTPUT)
  Vec<2, S> output(Low, const Vec<1, S>& x, const U&) const { return {0.0, x[0]}; }
#endif
  Motion<S, 2> port(Handle, High, const Vec<2, S>& x) const { return {x[0], x[1], {1.0, 0.0}}; }
  Start<High, S> start() const { return {Vec<2, S>{1.0, 0.0}}; }
};

// A force at a port.
template <class Port, class S = double>
struct Push {
  S f = 1.0;
  static constexpr auto parameters() { return std::array{Parameter{"f", "N", &Push::f}}; }
  S force(Port, const S&, const S&) const { return f; }
};

}  // namespace small

static_assert(saltus::check<small::Model<>>());
#ifndef NO_MODEL_WITH_EFFECTS
static_assert(saltus::check<saltus::With<small::Model<>, small::Push<small::Handle>>>());
#endif
