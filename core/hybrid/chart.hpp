// The words a hybrid model is written in: charts, edges, clocks, ports, and lists of them.
// A chart is a piece of state space with a dimension of its own; an edge leads from one chart to another
// (Ankarali & Cowan 2014, sec. II; Wendel & Ames 2010, def. 1).
#pragma once

#include <string_view>
#include <type_traits>

#include "../scalar.hpp"

namespace saltus {

// struct Flight : Chart<5> {};
template <int N>
struct Chart {
  static_assert(N >= 1, "a chart has at least one coordinate");
  static constexpr int dim = N;
};

// struct Flight : Chart<5>, Clock<2> {};  coordinate 2 is an angle that turns at a constant rate, the same in every
// chart. The loop sets it from the integer tick instead of integrating it; everything must be 2 pi-periodic in it.
template <int Index>
struct Clock {
  static constexpr int clock = Index;
};

// struct Touchdown : Edge<Flight, Stance> {};
template <class From, class To>
struct Edge {
  using from = From;
  using to = To;
};

template <class... Ts>
struct List {
  static constexpr int size = static_cast<int>(sizeof...(Ts));
};

// A quantity of a table, a record or a command line.
struct Quantity {
  std::string_view name;
  std::string_view unit;  // SI; "-" when dimensionless
};

// A port is a place where an unmodelled force could act: a displacement [m or rad], its rate, and the change of the
// state's rate per unit of force there.
template <class S, int N>
struct Motion {
  S displacement;
  S rate;
  Vec<N, S> per_force;
};

// Where a model starts its search for an orbit: coordinates in chart C.
template <class C, class S>
struct Start {
  using chart = C;
  Vec<C::dim, S> x;
};

template <class C>
concept HasClock = requires {
  C::clock;
};

// Index of the clock coordinate, -1 where the chart has none.
template <class C>
constexpr int clock_of() noexcept {
  if constexpr (HasClock<C>) {
    return C::clock;
  } else {
    return -1;
  }
}

template <class T, class... Ts>
constexpr int index_of(List<Ts...>) noexcept {
  int i = 0;
  int found = -1;
  ((found = (found < 0 && std::is_same_v<T, Ts>) ? i : found, ++i), ...);
  return found;
}

// Calls f(T{}) for the T at position `index`; nothing when there is none.
template <class F, class... Ts>
constexpr void visit_at(List<Ts...>, int index, F&& f) {
  int i = 0;
  ((i++ == index ? static_cast<void>(f(Ts{})) : static_cast<void>(0)), ...);
}

template <class F, class... Ts>
constexpr void visit_each(List<Ts...>, F&& f) {
  (f(Ts{}), ...);
}

// "Flight" for saltus::hopper::Flight: the name of a chart, an edge or a port is the name of its type.
template <class T>
constexpr std::string_view type_name() noexcept {
  std::string_view s = __PRETTY_FUNCTION__;
  const auto at = s.find("T = ");
  s.remove_prefix(at + 4);
  s = s.substr(0, s.find_first_of(";]"));
  const auto colon = s.find_last_of(':');
  return colon == std::string_view::npos ? s : s.substr(colon + 1);
}

}  // namespace saltus
