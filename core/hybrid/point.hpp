// A point of a hybrid state space: the active chart and the coordinates in it.
#pragma once

#include "model.hpp"

namespace saltus {

// `x` has room for the largest chart; only the first dim(chart) entries mean anything, the others are kept zero.
template <class M>
struct Point {
  using S = ScalarOf<M>;
  int chart = 0;                                      // position in M::Charts
  Vec<max_dim<M>, S> x = Vec<max_dim<M>, S>::Zero();  // (max_dim)

  template <class C>
  Vec<C::dim, S> in(C) const noexcept {
    return x.template head<C::dim>();
  }
  template <class C>
  void set(C, const Vec<C::dim, S>& coordinates) noexcept {
    chart = index_of<C>(typename M::Charts{});
    x.setZero();
    x.template head<C::dim>() = coordinates;
  }
};

template <class M, class C>
Point<M> at(C chart, const Vec<C::dim, ScalarOf<M>>& coordinates) noexcept {
  Point<M> p;
  p.set(chart, coordinates);
  return p;
}

template <class M>
Point<M> start_of(const M& m) noexcept {
  const auto s = m.start();
  return at<M>(typename decltype(s)::chart{}, s.x);
}

// Calls f(C{}) for the active chart.
template <class M, class F>
constexpr void visit_chart(const Point<M>& p, F&& f) {
  visit_at(typename M::Charts{}, p.chart, f);
}

template <class M>
int dim_of(const Point<M>& p) noexcept {
  int n = 0;
  visit_chart(p, [&](auto c) { n = decltype(c)::dim; });
  return n;
}

template <class M>
Output<M> output_at(const M& m, const Point<M>& p, const Input<M>& u) noexcept {
  Output<M> y = Output<M>::Zero();
  visit_chart(p, [&](auto c) { y = m.output(c, p.in(c), u); });
  return y;
}

// Index of the clock coordinate in the active chart, -1 where there is none.
template <class M>
int clock_index(const Point<M>& p) noexcept {
  int i = -1;
  visit_chart(p, [&](auto c) { i = clock_of<decltype(c)>(); });
  return i;
}

}  // namespace saltus
