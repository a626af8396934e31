// Exact derivatives through a tick: the variational equation along the flow, and the saltation matrix across an event,
//   Xi = D_x R + (f+ - D_x R f-) D_x h / (D_x h f-),
// the same for inputs and parameters. Both come from running the model on dual numbers over the very steps that were
// taken: every event shifts the time of its leg by dt* = -Dh / (D_x h f-), so that x- gains f- dt* and x+ loses f+ dt*.
#pragma once

#include "advance.hpp"

namespace saltus {

// The model over Dual<K>, parameter i being the variable number `first + i`.
template <int K, class M>
Rebind<M, Dual<K>> lift_parameters(const M& m, int first) noexcept {
  auto r = lift<Dual<K>>(m);
  int i = first;
  visit_parameters(r, [&](auto, auto, Dual<K>& v) { v.gradient[static_cast<std::size_t>(i++)] = 1.0; });
  return r;
}

template <int N, int K>
Vec<N, Dual<K>> constants(const Vec<N>& x) noexcept {
  Vec<N, Dual<K>> r;
  for (int i = 0; i < N; ++i) r[i] = Dual<K>(x[i]);
  return r;
}
// x with coordinate i as the variable number `first + i`.
template <int N, int K>
Vec<N, Dual<K>> variables(const Vec<N>& x, int first) noexcept {
  Vec<N, Dual<K>> r;
  for (int i = 0; i < N; ++i) r[i] = Dual<K>::variable(x[i], first + i);
  return r;
}

// Rate of change of a surface along the flow, D_x h f [1/s]. `h(lifted model, x, u)` is evaluated once on Dual<1>.
template <class M, class C, class H>
double rate_along_flow(const M& m, C c, const Vec<C::dim>& x, const Input<M>& u, const H& h) noexcept {
  const auto lifted = lift<Dual<1>>(m);
  const Vec<C::dim> f = m.flow(c, x, u);
  Vec<C::dim, Dual<1>> moving = constants<C::dim, 1>(x);
  for (int i = 0; i < C::dim; ++i) moving[i].gradient[0] = f[i];
  return h(lifted, moving, constants<input_count<M>, 1>(u)).gradient[0];
}

// Adds the motion of `x` along `f` during the time shift that keeps `h` at zero: dt = -Dh / rate, first order.
// Returns the shift's derivatives, for what follows.
template <int N, int K>
Dual<K> shift_to_surface(Vec<N, Dual<K>>& x, const Vec<N, Dual<K>>& f, const Dual<K>& h, double rate) noexcept {
  Dual<K> shift;
  for (int k = 0; k < K; ++k) {
    const auto i = static_cast<std::size_t>(k);
    shift.gradient[i] = -h.gradient[i] / rate;
    for (int j = 0; j < N; ++j) x[j].gradient[i] += f[j].value * shift.gradient[i];
  }
  return shift;
}

// Runs the lifted model over the steps of a passage that `m` has already made from `p`'s values. Calls
// on_event(E{}, before, after) with the lifted states at every event. K derivatives ride along.
template <int K, class Method = Rk4, class M, class OnEvent>
void retrace(const M& m, const Rebind<M, Dual<K>>& lifted, Point<Rebind<M, Dual<K>>>& p,
             const Input<Rebind<M, Dual<K>>>& u, const Passage& r, OnEvent&& on_event) noexcept {
  using D = Dual<K>;
  const Input<M> u0 = value_of(u);
  const auto leg = [&](double h) {
    visit_chart(p, [&](auto c) {
      constexpr int n = decltype(c)::dim;
      const auto f = [&](const Vec<n, D>& x) noexcept -> Vec<n, D> { return lifted.flow(c, x, u); };
      const Vec<n, D> x = p.in(c);
      p.set(c, Method::template step<n, D>(f, x, f(x), h));
    });
  };
  double done = 0.0;
  for (int i = 0; i < r.events; ++i) {
    const Event& event = r.event[static_cast<std::size_t>(i)];
    leg(event.at - done);
    done = event.at;
    visit_at(typename M::Edges{}, event.edge, [&](auto e) {
      using E = decltype(e);
      using From = typename E::from;
      using To = typename E::to;
      Vec<From::dim, D> x = p.in(From{});
      const double rate =
          rate_along_flow(m, From{}, value_of(x), u0,
                          [&](const auto& lm, const auto& lx, const auto& lu) { return lm.guard(e, lx, lu); });
      const Vec<From::dim, D> f = lifted.flow(From{}, x, u);
      const D shift = shift_to_surface<From::dim, K>(x, f, lifted.guard(e, x, u), rate);
      Vec<To::dim, D> after = lifted.reset(e, x, u);
      on_event(e, x, after);
      const Vec<To::dim, D> f_after = lifted.flow(To{}, after, u);
      for (int j = 0; j < To::dim; ++j) {
        for (std::size_t k = 0; k < static_cast<std::size_t>(K); ++k) {
          after[j].gradient[k] -= f_after[j].value * shift.gradient[k];
        }
      }
      p.set(To{}, after);
    });
  }
  leg(r.elapsed - done);
}

// Saltation matrix of an edge at a state on its guard: how a small step in the state before appears after the event.
template <class E>
struct Saltation {
  Mat<E::to::dim, E::from::dim> state;  // (n_to x n_from)
  double rate;                          // D_x h f-: the transversality; derivatives are meaningless when it vanishes
};

template <class M, class E>
Saltation<E> saltation(const M& m, E edge, const Vec<E::from::dim>& x, const Input<M>& u) noexcept {
  using From = typename E::from;
  using To = typename E::to;
  constexpr int n = From::dim;
  using D = Dual<n>;
  const auto lifted = lift<D>(m);
  const auto lu = constants<input_count<M>, n>(u);
  Vec<n, D> lx = variables<n, n>(x, 0);
  Saltation<E> r;
  r.rate = rate_along_flow(m, From{}, x, u,
                           [&](const auto& mm, const auto& xx, const auto& uu) { return mm.guard(edge, xx, uu); });
  const D shift = shift_to_surface<n, n>(lx, lifted.flow(From{}, lx, lu), lifted.guard(edge, lx, lu), r.rate);
  const Vec<To::dim, D> after = lifted.reset(edge, lx, lu);
  const Vec<To::dim> f_after = m.flow(To{}, value_of(after), u);
  r.state = gradient_of(after);
  for (int k = 0; k < n; ++k) r.state.col(k) -= f_after * shift.gradient[static_cast<std::size_t>(k)];
  return r;
}

// Derivatives of the state at the end of an interval. Entries beyond the dimension of the charts are zero.
template <class M>
struct Jacobian {
  Mat<max_dim<M>, max_dim<M>> state = Mat<max_dim<M>, max_dim<M>>::Zero();                       // (n_to x n_from)
  Mat<max_dim<M>, input_count<M>> input = Mat<max_dim<M>, input_count<M>>::Zero();               // (n_to x nu)
  Mat<max_dim<M>, parameter_count<M>> parameters = Mat<max_dim<M>, parameter_count<M>>::Zero();  // (n_to x np)
};

// `advance`, and its derivatives with respect to the state at the start, the held input and every parameter.
// Trust them only when the status is ok: a grazing event makes them as ill-conditioned as its time. `out` is left as it
// was when the status is not usable.
template <class Method = Rk4, class M>
Passage linearise(const M& m, Point<M>& p, const Input<M>& u, double h, Jacobian<M>& out) noexcept {
  constexpr int n = max_dim<M>;
  constexpr int nu = input_count<M>;
  constexpr int np = parameter_count<M>;
  constexpr int K = n + nu + np;
  const auto lifted = lift_parameters<K>(m, n + nu);
  Point<Rebind<M, Dual<K>>> moving;
  moving.chart = p.chart;
  const int dim = dim_of(p);
  for (int i = 0; i < n; ++i) moving.x[i] = i < dim ? Dual<K>::variable(p.x[i], i) : Dual<K>(0.0);
  const auto lu = variables<nu, K>(u, n);
  const Passage r = advance<Method>(m, p, u, h);
  if (!usable(r.status)) return r;
  retrace<K, Method>(m, lifted, moving, lu, r, [](auto...) {});
  const Mat<n, K> g = gradient_of(moving.x);
  out.state = g.template leftCols<n>();
  out.input = g.template middleCols<nu>(n);
  out.parameters = g.template rightCols<np>();
  return r;
}

}  // namespace saltus
