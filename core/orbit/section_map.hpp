// From one Poincaré section to the next under a held input, and the derivatives A[n], B[n], C[n], D[n] of that map
// (Ankarali & Cowan 2014, eqs. 3-6). Section coordinates are the chart's coordinates with one left out: the clock for
// clock phases, else the one the surface depends on most. A[n] is not square where the dimension changes.
#pragma once

#include <algorithm>

#include "../flow/linearise.hpp"
#include "section.hpp"

namespace saltus {

template <class M>
inline constexpr int section_dim = std::max(max_dim<M> - 1, 1);  // room for the largest section; never none

// The tangent space of a section at a point: gradient of the surface, and the coordinate left out.
template <class M>
struct Tangent {
  int dim = 0;   // of the section: dim(chart) - 1
  int out = -1;  // the chart coordinate left out
  Vec<max_dim<M>> gradient = Vec<max_dim<M>>::Zero();

  // Chart coordinate of section coordinate i.
  int coordinate(int i) const noexcept { return i < out ? i : i + 1; }
};

template <class M, class Family>
Tangent<M> tangent_of(const Family& family, int section, const M& m, const Point<M>& p, const Input<M>& u) noexcept {
  Tangent<M> t;
  visit_chart(p, [&](auto c) {
    constexpr int n = decltype(c)::dim;
    const auto h =
        family.value(section, lift<Dual<n>>(m), c, variables<n, n>(p.in(c), 0), constants<input_count<M>, n>(u));
    t.dim = n - 1;
    for (int i = 0; i < n; ++i) {
      t.gradient[i] = h.gradient[static_cast<std::size_t>(i)];
      if (t.out < 0 || std::abs(t.gradient[i]) > std::abs(t.gradient[t.out])) t.out = i;
    }
  });
  return t;
}

// Moves run from section `index` to the next one of the family, input held. Statuses: ok; grazing on the way; failed:
// not met within `turns` turns; otherwise the trouble that the flow reported.
template <class Method = Rk4, class M, class Family, class OnPassage>
Status to_next_section(const M& m, Run<M>& run, int index, const Input<M>& u, const Timebase& base,
                       const Family& family, OnPassage&& on_passage, int turns = 4) noexcept {
  if constexpr (requires { typename Family::edge; }) {
    using E = typename Family::edge;
    run.at.set(typename E::to{}, m.reset(E{}, run.at.in(typename E::from{}), u));
  }
  Status worst = Status::ok;
  if constexpr (Family::on_grid) {
    for (std::int64_t i = 0; i < base.per_turn / family.count(); ++i) {
      const Point<M> from = run.at;
      const Passage r = step<Method>(m, run, u, base);
      worst = worse(worst, r.status);
      if (!usable(worst)) return worst;
      on_passage(from, r);
    }
    return worst;
  } else {
    const SectionWatch<Family> watch{family, (index + 1) % family.count()};
    for (std::int64_t i = 0; i < base.per_turn * turns; ++i) {
      const Point<M> from = run.at;
      const Passage r = step<Method>(m, run, u, base, watch);
      worst = worse(worst, r.status);
      if (!usable(worst)) return worst;
      if (r.jumped) return Status::failed;
      on_passage(from, r);
      if (r.met) return worst;
    }
    return Status::failed;
  }
}

// x_{n+1} = A x_n + B u_n, y_n = C x_n + D u_n, in section coordinates; entries beyond the dimensions are zero.
template <class M>
struct SectionMap {
  static constexpr int nx = section_dim<M>, nu = input_count<M>, ny = output_count<M>;
  int cols = 0, rows = 0;               // dimensions of this section and of the next
  Mat<nx, nx> A = Mat<nx, nx>::Zero();  // (rows x cols)
  Mat<nx, nu> B = Mat<nx, nu>::Zero();  // (rows x nu)
  Mat<ny, nx> C = Mat<ny, nx>::Zero();  // (ny x cols)
  Mat<ny, nu> D = Mat<ny, nu>::Zero();  // (ny x nu)
};

// `to_next_section`, and its derivatives in the section coordinates of both ends; to be trusted when the status is ok.
template <class Method = Rk4, class M, class Family>
Status linearise_section(const M& m, Run<M>& run, int index, const Input<M>& u, const Timebase& base,
                         const Family& family, SectionMap<M>& out) noexcept {
  constexpr int n = max_dim<M>;
  constexpr int nx = section_dim<M>;
  constexpr int nu = input_count<M>;
  constexpr int K = nx + nu;
  using D = Dual<K>;
  using LM = Rebind<M, D>;
  const LM lifted = lift<D>(m);
  const Tangent<M> start = tangent_of(family, index, m, run.at, u);
  out = SectionMap<M>{};
  out.cols = start.dim;

  // Start: a step in a section coordinate drags the coordinate left out along, so as to stay in the surface.
  Point<LM> moving;
  moving.chart = run.at.chart;
  moving.x = constants<n, K>(run.at.x);
  for (int i = 0; i < start.dim; ++i) {
    const int j = start.coordinate(i);
    const auto k = static_cast<std::size_t>(i);
    moving.x[j].gradient[k] = 1.0;
    moving.x[start.out].gradient[k] = -start.gradient[j] / start.gradient[start.out];
  }
  const Vec<nu, D> lu = variables<nu, K>(u, nx);
  const Mat<output_count<M>, K> dy = gradient_of(output_at(lifted, moving, lu));
  out.C = dy.template leftCols<nx>();
  out.D = dy.template rightCols<nu>();

  if constexpr (requires { typename Family::edge; }) {
    using E = typename Family::edge;
    moving.set(typename E::to{}, lifted.reset(E{}, moving.in(typename E::from{}), lu));
  }
  const Status status =
      to_next_section<Method>(m, run, index, u, base, family, [&](const Point<M>& from, const Passage& r) {
        for (int i = 0; i < n; ++i) moving.x[i].value = from.x[i];  // the very steps that were taken
        retrace<K, Method>(m, lifted, moving, lu, r, [](auto...) {});
      });
  if (!usable(status)) return status;

  const int next = (index + 1) % family.count();
  visit_chart(run.at, [&](auto c) {
    constexpr int d = decltype(c)::dim;
    Vec<d, D> x = moving.in(c);
    for (int i = 0; i < d; ++i) x[i].value = run.at.x[i];
    const D h = family.value(next, lifted, c, x, lu);
    const double rate = rate_along_flow(m, c, run.at.in(c), u, [&](const auto& lm, const auto& lx, const auto& llu) {
      return family.value(next, lm, c, lx, llu);
    });
    shift_to_surface<d, K>(x, Vec<d, D>(lifted.flow(c, x, lu)), h, rate);
    const Tangent<M> end = tangent_of(family, next, m, run.at, u);
    out.rows = end.dim;
    for (int i = 0; i < end.dim; ++i) {
      const auto& g = x[end.coordinate(i)].gradient;
      for (int k = 0; k < nx; ++k) out.A(i, k) = g[static_cast<std::size_t>(k)];
      for (int k = 0; k < nu; ++k) out.B(i, k) = g[static_cast<std::size_t>(nx + k)];
    }
  });
  return status;
}

}  // namespace saltus
