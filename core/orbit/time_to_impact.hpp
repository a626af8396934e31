// One leg of an orbit: the flow of one chart from a state to the surface that ends it, and its derivatives
// (Wendel & Ames 2010, sec. 2): the space derivative Phi_t, the time-to-impact map tau (Lemma 2, eq. 1) and the total
// derivative of the flow to the surface (eq. 4).
//
// Two of the paper's statements do not hold. Dtau(x0) f(x0) = -1 whatever the orbit: a start moved along the flow
// arrives that much earlier. So Dtau never vanishes (Proposition 1, C2), and the total derivative has rank n - 1 for a
// closed orbit too ("only if" of Theorem 1): the trivial eigenvalue 1 of a closed orbit belongs to Phi_T alone.
#pragma once

#include <cmath>

#include "../flow/linearise.hpp"

namespace saltus {

// Vectors and matrices have room for N coordinates, at least the largest dimension of the model's charts, so that
// models may share what is built on them; entries beyond the chart's dimension are zero.
template <int N>
struct Leg {
  enum class End : unsigned char {
    edge,     // on the guard of `edge`, before its reset
    section,  // on the watched surface
    time,     // neither was met in the time given; the surface is then the plane normal to the flow
  };
  Status status = Status::ok;
  bool fell = false;  // the model says that it is no longer upright
  End end = End::time;
  int chart = 0;
  int dim = 0;
  int edge = -1;
  double duration = 0.0;              // [s] tau
  Vec<N> x0 = Vec<N>::Zero();         // start
  Vec<N> f0 = Vec<N>::Zero();         // rate there
  Vec<N> x1 = Vec<N>::Zero();         // end, on the surface
  Vec<N> f1 = Vec<N>::Zero();         // rate there
  Vec<N> dh = Vec<N>::Zero();         // gradient of the surface at the end
  double rate = 0.0;                  // L_f h at the end [1/s]
  Mat<N, N> Phi = Mat<N, N>::Zero();  // D_x phi_t at t = tau (dim x dim), nonsingular
};

// D tau(x0) as a column, eq. 1.
template <int N>
Vec<N> time_to_impact_gradient(const Leg<N>& leg) noexcept {
  return leg.Phi.transpose() * leg.dh / -leg.rate;
}

// D phi_tau(x0) = Phi + f(x1) Dtau, eq. 4: onto the tangent space of the surface, kernel spanned by f(x0).
template <int N>
Mat<N, N> total_derivative(const Leg<N>& leg) noexcept {
  return leg.Phi + leg.f1 * time_to_impact_gradient(leg).transpose();
}

// How well Phi f(x0) = f(x1), eq. 3, holds [-]: zero but for the integrator's error, which it measures.
template <int N>
double invariant_residual(const Leg<N>& leg) noexcept {
  return (leg.Phi * leg.f0 - leg.f1).norm() / leg.f1.norm();
}

// Sine of the angle between the flow and the surface at the end [-]; 0 is grazing.
template <int N>
double transversality(const Leg<N>& leg) noexcept {
  return std::abs(leg.rate) / (leg.dh.norm() * leg.f1.norm());
}

namespace orbit {
// One step of h [s] of the flow on dual numbers. Apart, so that it is compiled once for all watches.
template <class LM, class C, int n>
void variational_step(const LM& lifted, C c, Vec<n, Dual<n>>& x, double h) noexcept {
  const Input<LM> u = Input<LM>::Constant(Dual<n>(0.0));
  const auto f = [&](const Vec<n, Dual<n>>& y) noexcept -> Vec<n, Dual<n>> { return lifted.flow(c, y, u); };
  x = rk4<n, Dual<n>>(f, x, f(x), h);
}

// The surface that a leg ends on, evaluated on dual numbers.
template <class M, class C, class Watch, int N>
void end_surface(const M& m, C c, const Watch& watch, Leg<N>& leg) noexcept {
  constexpr int n = C::dim;
  using D = Dual<n>;
  const Vec<n> x = leg.x1.template head<n>();
  if (leg.end == Leg<N>::End::time) {
    leg.dh = leg.f1;
  } else {
    const auto lifted = lift<D>(m);
    const Vec<n, D> lx = variables<n, n>(x, 0);
    const Input<Rebind<M, D>> lu = Input<Rebind<M, D>>::Constant(D(0.0));
    D h;
    if (leg.end == Leg<N>::End::edge) {
      visit_at(typename M::Edges{}, leg.edge, [&](auto e) {
        if constexpr (std::is_same_v<typename decltype(e)::from, C>) h = lifted.guard(e, lx, lu);
      });
    } else if constexpr (!std::is_same_v<Watch, Unwatched>) {
      h = watch.value(lifted, c, lx, lu);
    }
    for (int i = 0; i < n; ++i) leg.dh[i] = h.gradient[static_cast<std::size_t>(i)];
  }
  leg.rate = leg.dh.dot(leg.f1);
}
}  // namespace orbit

// Follows the flow from `from`, without input, in steps of dt [s], to the first event, the watch, or for `longest` [s].
// With `derivatives` false Phi and the surface are left zero. The status is that of the flow; what stands behind an
// unusable one, or behind `fell`, means nothing. A model may have upright(C, x), positive while it has not fallen.
template <int N, class M, class Watch = Unwatched>
Leg<N> follow_leg(const M& m, const Point<M>& from, double dt, double longest, bool derivatives,
                  const Watch& watch = {}) noexcept {
  static_assert(N >= max_dim<M>);
  Leg<N> leg;
  leg.chart = from.chart;
  leg.x0.template head<max_dim<M>>() = from.x;
  const Input<M> u = Input<M>::Zero();
  visit_chart(from, [&](auto c) {
    using C = decltype(c);
    constexpr int n = C::dim;
    using D = Dual<n>;
    const Rebind<M, D> lifted = lift<D>(m);
    const auto flow = [&](const Vec<n>& y) noexcept -> Vec<n> { return m.flow(c, y, u); };
    leg.dim = n;
    leg.f0.template head<n>() = flow(from.in(c));
    Vec<n, D> moving = variables<n, n>(from.in(c), 0);
    Point<M> p = from;
    bool done = false;
    for (std::int64_t i = 0; !done; ++i) {
      const double t = static_cast<double>(i) * dt;
      double h = dt;
      if (!(t + dt < longest)) {
        h = longest - t;
        done = true;
      }
      if (!(h > 0.0)) break;
      const Vec<n> x = p.in(c);
      const Passage r = advance(m, p, u, h, watch);
      double lived = r.elapsed;
      if (r.events > 0) {
        leg.end = Leg<N>::End::edge;
        leg.edge = r.event[0].edge;
        lived = r.event[0].at;
        done = true;
        // Trouble after the event belongs to the next leg.
        if (r.status == Status::grazing) leg.status = Status::grazing;
      } else {
        leg.status = worse(leg.status, r.status);
        if (!usable(r.status)) return;
        if (r.met) {
          leg.end = Leg<N>::End::section;
          done = true;
        }
      }
      leg.duration = t + lived;
      const Vec<n> reached = r.events > 0 ? rk4<n, double>(flow, x, flow(x), lived) : Vec<n>(p.in(c));
      if (derivatives) {
        orbit::variational_step<Rebind<M, D>, C, n>(lifted, c, moving, lived);
        for (int k = 0; k < n; ++k) moving[k].value = reached[k];
      }
      leg.x1.template head<n>() = reached;
      if constexpr (requires { m.upright(c, x); }) {
        if (!(m.upright(c, reached) > 0.0)) {
          leg.fell = true;
          return;
        }
      }
    }
    leg.f1.template head<n>() = flow(leg.x1.template head<n>());
    if (derivatives) {
      leg.Phi.template topLeftCorner<n, n>() = gradient_of(moving);
      orbit::end_surface(m, c, watch, leg);
    }
  });
  return leg;
}

}  // namespace saltus
