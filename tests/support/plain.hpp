// The textbook route, written plainly and apart from core/flow, for tests to compare with: one Runge-Kutta step in
// loops, and the fall of a guard found by bisection over re-integrated steps.
#pragma once

#include "core/flow/rk8.hpp"
#include "core/hybrid/point.hpp"

namespace saltus::plain {

// State after h seconds in chart C, one step of order four.
template <class M, class C>
Vec<C::dim> rk4(const M& m, C c, const Vec<C::dim>& x, const Input<M>& u, double h) {
  constexpr double nodes[] = {0.0, 0.5, 0.5, 1.0};
  constexpr double weights[] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
  Vec<C::dim> k = Vec<C::dim>::Zero();
  Vec<C::dim> sum = Vec<C::dim>::Zero();
  for (int stage = 0; stage < 4; ++stage) {
    Vec<C::dim> y;
    for (int i = 0; i < C::dim; ++i) y[i] = x[i] + h * nodes[stage] * k[i];
    k = m.flow(c, y, u);
    for (int i = 0; i < C::dim; ++i) sum[i] += weights[stage] * k[i];
  }
  Vec<C::dim> y;
  for (int i = 0; i < C::dim; ++i) y[i] = x[i] + h * sum[i];
  return y;
}

// The same by Rk8's tableau.
template <class M, class C>
Vec<C::dim> rk8(const M& m, C c, const Vec<C::dim>& x, const Input<M>& u, double h) {
  std::array<Vec<C::dim>, Rk8::stages + 1> k;
  Vec<C::dim> y = x;
  for (std::size_t stage = 0; stage < Rk8::stages; ++stage) {
    k[stage] = m.flow(c, y, u);
    y = x;
    std::array<double, Rk8::stages> a = Rk8::tableau[stage];
    for (std::size_t j = 1; j <= stage; ++j) a[0] -= a[j];
    for (std::size_t j = 0; j <= stage; ++j) {
      for (int i = 0; i < C::dim; ++i) y[i] += h * a[j] * k[j][i];
    }
  }
  return y;
}
template <class Method, class M, class C>
Vec<C::dim> step(const M& m, C c, const Vec<C::dim>& x, const Input<M>& u, double h) {
  return std::is_same_v<Method, Rk8> ? rk8(m, c, x, u, h) : rk4(m, c, x, u, h);
}

// Fraction of a step of h seconds at which the guard of E is no longer positive; positive at the start, not at the end.
template <class Method, class M, class E>
double fall(const M& m, E e, const Vec<E::from::dim>& x, const Input<M>& u, double h) {
  double inside = 0.0;
  double outside = 1.0;
  for (int i = 0; i < 60; ++i) {
    const double mid = 0.5 * (inside + outside);
    (m.guard(e, step<Method>(m, typename E::from{}, x, u, mid * h), u) > 0.0 ? inside : outside) = mid;
  }
  return outside;
}

}  // namespace saltus::plain
