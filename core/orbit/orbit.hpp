// The limit cycle: where it meets each section of a family, its period, its events; by simulation and by Newton's
// method on the return map, which also finds unstable orbits. And the linear periodic system around it.
#pragma once

#include <Eigen/LU>

#include <cmath>
#include <limits>
#include <numbers>

#include "ldtp.hpp"
#include "section_map.hpp"

namespace saltus {

inline constexpr int max_orbit_events = 32;

template <class M>
struct OrbitEvent {
  int edge = 0;    // position in M::Edges
  double t = 0.0;  // [s] after section 0
  Point<M> before{}, after{};
};

template <class M, int N>
struct Orbit {
  Status status = Status::failed;
  double period = 0.0;              // [s]
  std::array<Point<M>, N> point{};  // on section n
  std::array<double, N> time{};     // [s] of section n after section 0
  std::array<Output<M>, N> output{};
  int events = 0;
  std::array<OrbitEvent<M>, max_orbit_events> event{};
  int iterations = 0;     // of Newton's method
  double residual = 0.0;  // largest |P(x) - x| over the section coordinates, at the end
};

template <class M, int N>
using LdtpOf = Ldtp<section_dim<M>, input_count<M>, output_count<M>, N>;

// Runs the model for `turns` turns without input, and on to section 0 of the family. A family on the grid has that at
// the whole turns.
template <class M, class Family>
Status settle(const M& m, const Timebase& base, const Family& family, std::int64_t turns, Run<M>& run) noexcept {
  const Input<M> u = Input<M>::Zero();
  while (run.tick < turns * base.per_turn || (Family::on_grid && (run.tick % base.per_turn != 0 || run.into > 0.0))) {
    if (const Status s = step(m, run, u, base).status; !usable(s)) return s;
  }
  if constexpr (!Family::on_grid) {
    const SectionWatch<Family> watch{family, 0};
    for (std::int64_t i = 0; i < 4 * base.per_turn; ++i) {
      const Passage r = step(m, run, u, base, watch);
      if (!usable(r.status)) return r.status;
      if (r.met) return Status::ok;
    }
    return Status::failed;
  }
  return Status::ok;
}

namespace orbit {
constexpr double turn = 2.0 * std::numbers::pi;  // [rad]

// The point with its clock in [0, 2 pi).
template <class M>
Point<M> within_turn(const Point<M>& p) noexcept {
  Point<M> r = p;
  if constexpr (clocked<M>) {
    double& angle = r.x[clock_index(r)];
    angle -= turn * std::floor(angle / turn);
  }
  return r;
}

// A run from p whose ticks agree with the clock of p, so that a turn of the clock is a turn of the time base.
template <class M>
Run<M> on_grid(const Point<M>& p, const Timebase& base) noexcept {
  Run<M> run;
  run.at = within_turn(p);
  if constexpr (clocked<M>) {
    if (base.sets_clock) {
      const double ticks = run.at.x[clock_index(run.at)] / turn * static_cast<double>(base.per_turn);
      run.tick = static_cast<std::int64_t>(ticks);
      run.into = (ticks - static_cast<double>(run.tick)) * base.dt();
    }
  }
  return run;
}

// Difference of two states; a clock is an angle.
template <class M>
Vec<max_dim<M>> difference(const Point<M>& a, const Point<M>& b) noexcept {
  Vec<max_dim<M>> d = a.x - b.x;
  if constexpr (clocked<M>) {
    double& angle = d[clock_index(a)];
    angle -= turn * std::round(angle / turn);
  }
  return d;
}

// Puts a point back on the surface of a section by moving the coordinate left out: Newton's method, one variable.
template <class M, class Family>
void onto_section(const M& m, const Family& family, int section, Point<M>& p, int out) noexcept {
  const Input<M> u = Input<M>::Zero();
  for (int i = 0; i < 4; ++i) {
    const Tangent<M> t = tangent_of(family, section, m, p, u);
    visit_chart(p, [&](auto c) { p.x[out] -= family.value(section, m, c, p.in(c), u) / t.gradient[out]; });
  }
}
}  // namespace orbit

// One cycle from section 0, input zero: fills the orbit's points, times and events; with `system`, linearises on the
// way. Statuses: ok; grazing on the way; zeno: more than max_orbit_events events; otherwise as to_next_section.
template <class M, int N, class Family>
Status trace_cycle(const M& m, const Timebase& base, const Family& family, Run<M>& run, Orbit<M, N>& orbit,
                   LdtpOf<M, N>* system) noexcept {
  const Input<M> u = Input<M>::Zero();
  const double t0 = run.time(base);
  Status worst = Status::ok;
  orbit.events = 0;
  for (int n = 0; n < N; ++n) {
    const auto i = static_cast<std::size_t>(n);
    orbit.point[i] = orbit::within_turn(run.at);
    orbit.time[i] = run.time(base) - t0;
    orbit.output[i] = output_at(m, run.at, u);
    if (system != nullptr) {
      Run<M> trial = run;
      SectionMap<M> map;
      worst = worse(worst, linearise_section(m, trial, n, u, base, family, map));
      if (!usable(worst)) return worst;
      system->dim[i] = map.cols;
      system->A[i] = map.A;
      system->B[i] = map.B;
      system->C[i] = map.C;
      system->D[i] = map.D;
    }
    std::int64_t tick = run.tick;
    double into = run.into;
    const auto note = [&](int edge, double t, const Point<M>& before, const Point<M>& after) {
      if (orbit.events == max_orbit_events) {
        worst = worse(worst, Status::zeno);
        return;
      }
      orbit.event[static_cast<std::size_t>(orbit.events++)] = {edge, t, orbit::within_turn(before),
                                                               orbit::within_turn(after)};
    };
    if constexpr (requires { typename Family::edge; }) {
      using E = typename Family::edge;
      Point<M> after;
      after.set(typename E::to{}, m.reset(E{}, run.at.in(typename E::from{}), u));
      note(index_of<E>(typename M::Edges{}), orbit.time[i], run.at, after);
    }
    const Status met = to_next_section(m, run, n, u, base, family, [&](const Point<M>& from, const Passage& r) {
      const double start = base.time(tick) + into - t0;
      if (r.events > 0) {
        Point<Rebind<M, Dual<1>>> p;
        p.chart = from.chart;
        p.x = constants<max_dim<M>, 1>(from.x);
        int k = 0;
        retrace<1>(m, lift<Dual<1>>(m), p, constants<input_count<M>, 1>(u), r,
                   [&](auto e, const auto& x, const auto& y) {
                     using E = decltype(e);
                     const Event& event = r.event[static_cast<std::size_t>(k++)];
                     note(event.edge, start + event.at, at<M>(typename E::from{}, value_of(x)),
                          at<M>(typename E::to{}, value_of(y)));
                   });
      }
      tick = run.tick;
      into = run.into;
    });
    worst = worse(worst, met);
    if (!usable(worst)) return worst;
  }
  orbit.period = run.time(base) - t0;
  return worst;
}

// The limit cycle through the N sections of a family. Settles for `turns` turns from the model's start, then polishes
// by Newton's method on the return map of section 0. status: ok; grazing: found, but an event, or a miss, is nearly
// tangential, and its derivatives are not to be trusted; failed: Newton's method does not converge, a section is never
// met, or the time base and the family do not fit; otherwise what the flow reported.
template <int N, class M, class Family>
Orbit<M, N> find_orbit(const M& m, Timebase base, const Family& family, LdtpOf<M, N>& system,
                       std::int64_t turns = 60) noexcept {
  constexpr int nx = section_dim<M>;
  constexpr int max_iterations = 30;
  constexpr double tolerance = 2e-13;  // relative to the size of the state: what rounding leaves of a cycle
  Orbit<M, N> orbit;
  if (family.count() != N || base.per_turn < 1 || (Family::on_grid && base.per_turn % N != 0)) return orbit;
  if constexpr (!Family::on_grid) base.sets_clock = false;  // between located sections it is a coordinate like others
  Run<M> run = orbit::on_grid(start_of(m), base);
  orbit.status = settle(m, base, family, turns, run);
  if (orbit.status != Status::ok) return orbit;
  if constexpr (!Family::on_grid) run.at = orbit::within_turn(run.at);

  double last = std::numeric_limits<double>::infinity();
  for (orbit.iterations = 0; orbit.iterations < max_iterations; ++orbit.iterations) {
    const Run<M> start = run;
    orbit.status = trace_cycle(m, base, family, run, orbit, &system);
    if (!usable(orbit.status)) return orbit;
    if (run.at.chart != start.at.chart) {
      orbit.status = Status::failed;
      return orbit;
    }
    const Vec<max_dim<M>> step = orbit::difference(run.at, start.at);
    const Tangent<M> t = tangent_of(family, 0, m, start.at, Input<M>::Zero());
    Vec<nx> residual = Vec<nx>::Zero();
    for (int i = 0; i < t.dim; ++i) residual[i] = step[t.coordinate(i)];
    orbit.residual = residual.template lpNorm<Eigen::Infinity>();
    const double size = 1.0 + start.at.x.template lpNorm<Eigen::Infinity>();
    // Converged, or as far as rounding lets it go.
    if (orbit.residual <= tolerance * size || (orbit.residual <= 1e-10 * size && orbit.residual >= 0.5 * last)) {
      return orbit;
    }
    last = orbit.residual;
    const Mat<nx, nx> defect = Mat<nx, nx>::Identity() - system.monodromy(0);
    const Vec<nx> correction = Eigen::PartialPivLU<Mat<nx, nx>>(defect).solve(residual);
    run = start;
    for (int i = 0; i < t.dim; ++i) run.at.x[t.coordinate(i)] += correction[i];
    if constexpr (!Family::on_grid) orbit::onto_section(m, family, 0, run.at, t.out);
  }
  orbit.status = Status::failed;
  return orbit;
}

}  // namespace saltus
