// Finds limit cycles, stable or not: Newton's method on all guards of a cycle at once (multiple shooting), from a cycle
// that was run once or from that of nearby parameters. Every way to fail has a name.
#pragma once

#include <Eigen/LU>

#include <limits>

#include "return_map.hpp"

namespace saltus {

enum class SearchOutcome : unsigned char {
  found,
  no_convergence,  // Newton's method stands still above the tolerance
  other_event,     // an event came in another order than expected
  no_event,        // nothing happened for eight periods
  fell,            // the model says that it is no longer upright
  trouble,         // the flow reported `status`
  no_cycle,        // the events do not repeat
  too_many,        // the first one comes again, but not as often as asked for within max_cycle_events
  collapsed,       // they repeat within a few steps of the integrator: at rest, or chattering
};

// How a search ended. Where a leg went wrong: the edges, as positions in M::Edges, that it came from, should have ended
// on, and did; -1 for a section or a start.
struct Search {
  SearchOutcome outcome = SearchOutcome::no_cycle;
  Status status = Status::ok;
  int after = -1, expected = -1, met = -1;
  int behind = -1;     // edge whose guard the leg began behind, or on, and did not get away from (Status::escaped)
  int iterations = 0;  // of Newton's method
  double residual = std::numeric_limits<double>::infinity();  // largest mismatch of a state at a guard
  double dt = 0.0;                                            // [s] step of the integrator
};

namespace orbit {
// Mismatch at a guard, relative to 1 + the size of the state, that is left where rounding lets Newton's method go no
// further.
inline constexpr double mismatch = 1e-10;

// Evaluates map j from its x: the reset, its derivative, and the leg.
template <class M, int N, class Watch>
void evaluate_map(const M& m, double dt, double longest, const Watch& watch, EdgeMap<N>& map) noexcept {
  const Input<M> u = Input<M>::Zero();
  Point<M> after = point_in<M>(map.chart, map.x);
  map.reset.setZero();
  for (int i = 0; i < map.dim; ++i) map.reset(i, i) = 1.0;
  visit_at(typename M::Edges{}, map.edge, [&](auto e) {
    using E = decltype(e);
    constexpr int n = E::from::dim;
    constexpr int to = E::to::dim;
    using D = Dual<n>;
    using LM = Rebind<M, D>;
    const Vec<n> x = map.x.template head<n>();
    after.set(typename E::to{}, m.reset(e, x, u));
    const Vec<to, D> y = lift<D>(m).reset(e, variables<n, n>(x, 0), Input<LM>::Constant(D(0.0)));
    map.reset.setZero();
    map.reset.template topLeftCorner<to, n>() = gradient_of(y);
  });
  map.leg = follow_leg<N>(m, after, dt, longest, true, watch);
}

// Moves every state onto its guard, along the guard's gradient: a guess, or a step of Newton's method, lies beside it,
// and a reset from there could end outside the next chart.
template <class M, int N>
void onto_guards(const M& m, Cycle<N>& cycle) noexcept {
  for (int j = 0; j < cycle.count; ++j) {
    EdgeMap<N>& map = cycle[j];
    visit_at(typename M::Edges{}, map.edge, [&](auto e) {
      constexpr int n = decltype(e)::from::dim;
      using D = Dual<n>;
      using LM = Rebind<M, D>;
      const LM lifted = lift<D>(m);
      for (int i = 0; i < 4; ++i) {
        const Vec<n> x = map.x.template head<n>();
        const D h = lifted.guard(e, variables<n, n>(x, 0), Input<LM>::Constant(D(0.0)));
        double steepness = 0.0;
        for (const double slope : h.gradient) steepness += slope * slope;
        if (!(steepness > 0.0)) return;
        for (int k = 0; k < n; ++k) map.x[k] -= h.gradient[static_cast<std::size_t>(k)] * (h.value / steepness);
      }
    });
  }
}

// The edge that explains why a leg escaped: one whose guard is negative where it begins, else one that it began on.
template <class M, int N>
int behind_guard(const M& m, const Leg<N>& leg) noexcept {
  constexpr double rounding = 1e-12;  // relative to 1 + the size of the state
  const Point<M> p = point_in<M>(leg.chart, leg.x0);
  const double on = rounding * (1.0 + leg.x0.template lpNorm<Eigen::Infinity>());
  double lowest = on;
  int edge = -1;
  int index = 0;
  visit_each(typename M::Edges{}, [&](auto e) {
    using C = typename decltype(e)::from;
    if (index_of<C>(typename M::Charts{}) == leg.chart) {
      const double h = m.guard(e, p.in(C{}), Input<M>::Zero());
      if (h < lowest && (edge < 0 || h < -on)) {
        lowest = h;
        edge = index;
      }
    }
    ++index;
  });
  return edge;
}

// True when a leg from edge `after` ended on edge `expected`; else says in `search` what happened instead.
template <class M, int N>
bool expected_end(const M& m, const Leg<N>& leg, int after, int expected, Search& search) noexcept {
  using End = typename Leg<N>::End;
  search.after = after;
  search.expected = expected;
  search.met = leg.end == End::edge ? leg.edge : -1;
  search.status = leg.status;
  if (leg.fell) {
    search.outcome = SearchOutcome::fell;
  } else if (!usable(leg.status)) {
    search.outcome = SearchOutcome::trouble;
    if (leg.status == Status::escaped) search.behind = behind_guard(m, leg);
  } else if (leg.end == End::time) {
    search.outcome = SearchOutcome::no_event;
  } else if (leg.end == End::edge ? leg.edge != expected : expected >= 0) {
    search.outcome = SearchOutcome::other_event;
  } else {
    return true;
  }
  return false;
}

// Evaluates all maps of a cycle from their x. False when one of them ends otherwise than the next begins.
template <class M, int N, class Watch>
bool evaluate(const M& m, double dt, double longest, const Watch& watch, Cycle<N>& cycle, Search& search) noexcept {
  double worst = 0.0;
  for (int j = 0; j < cycle.count; ++j) {
    EdgeMap<N>& map = cycle[j];
    evaluate_map(m, dt, longest, watch, map);
    const EdgeMap<N>& next = cycle[j + 1];
    if (!expected_end(m, map.leg, map.edge, next.edge, search)) return false;
    const Vec<N> gap = state_difference<M>(map.leg.chart, map.leg.x1, next.x);
    worst =
        std::fmax(worst, gap.template lpNorm<Eigen::Infinity>() / (1.0 + next.x.template lpNorm<Eigen::Infinity>()));
    if (!std::isfinite(worst)) {
      search.outcome = SearchOutcome::trouble;
      search.status = Status::diverged;
      return false;
    }
  }
  search.residual = worst;
  return true;
}
}  // namespace orbit

// Newton's method on a cycle whose edges, and states x on their guards, are a guess. The step of the integrator is
// dt [s]; a leg may take `longest` [s]. On SearchOutcome::found the maps of `cycle` are those of the limit cycle.
template <class M, int N, class Watch = Unwatched>
Search shoot(const M& m, double dt, double longest, Cycle<N>& cycle, const Watch& watch = {}) noexcept {
  constexpr int max_iterations = 40;
  constexpr double tolerance = 2e-14;  // relative to 1 + the size of a state: what rounding leaves of a cycle
  constexpr double fewest = 8.0;       // steps that make a cycle
  Search search;
  search.dt = dt;
  orbit::onto_guards(m, cycle);
  if (cycle.count < 1 || !orbit::evaluate(m, dt, longest, watch, cycle, search)) return search;
  for (search.iterations = 0; search.iterations < max_iterations; ++search.iterations) {
    if (search.residual <= tolerance) break;
    // Carry the mismatches round the cycle, close it, and distribute.
    std::array<Vec<N>, max_cycle_maps> gap;
    Vec<N> carried = Vec<N>::Zero();
    Mat<N, N> round = Mat<N, N>::Identity();
    for (int j = 0; j < cycle.count; ++j) {
      Vec<N>& g = gap[static_cast<std::size_t>(j)];
      g = state_difference<M>(cycle[j].leg.chart, cycle[j].leg.x1, cycle[j + 1].x);
      const Mat<N, N> derivative = cycle[j].derivative();
      carried = (derivative * carried + g).eval();
      round = (derivative * round).eval();
    }
    const Mat<N, N> defect = Mat<N, N>::Identity() - round;
    Vec<N> step = Eigen::PartialPivLU<Mat<N, N>>(defect).solve(carried);
    if (!step.allFinite()) break;  // a multiplier is 1: there is no step to take
    std::array<Vec<N>, max_cycle_maps> steps;
    for (int j = 0; j < cycle.count; ++j) {
      steps[static_cast<std::size_t>(j)] = step;
      step = (cycle[j].derivative() * step + gap[static_cast<std::size_t>(j)]).eval();
    }
    Cycle<N> trial;
    Search tried;
    bool better = false;
    for (double share = 1.0; share > 0.01 && !better; share *= 0.5) {
      trial = cycle;
      for (int j = 0; j < cycle.count; ++j) trial[j].x += share * steps[static_cast<std::size_t>(j)];
      orbit::onto_guards(m, trial);
      tried = search;
      better = orbit::evaluate(m, dt, longest, watch, trial, tried) && tried.residual < search.residual;
    }
    if (!better) {
      if (search.residual <= orbit::mismatch) break;
      const int iterations = search.iterations;
      if (tried.outcome != SearchOutcome::no_cycle) search = tried;  // what stopped the smallest step
      if (search.outcome == SearchOutcome::no_cycle) search.outcome = SearchOutcome::no_convergence;
      search.iterations = iterations;
      return search;
    }
    search = tried;
    cycle = trial;
  }
  search.outcome = search.residual <= orbit::mismatch ? SearchOutcome::found : SearchOutcome::no_convergence;
  if (search.outcome == SearchOutcome::found && !(cycle.period() > fewest * dt))
    search.outcome = SearchOutcome::collapsed;
  if (search.outcome == SearchOutcome::found) {
    search.status = Status::ok;
    for (int j = 0; j < cycle.count; ++j) search.status = worse(search.status, cycle[j].leg.status);
  }
  return search;
}

// Runs from `start` through `skip` events and then until the edge met next has been met `returns` times more: a first
// guess of a cycle, its edges and states. `longest` [s] is the patience between two events.
template <class M, int N, class Watch = Unwatched>
Search first_cycle(const M& m, const Point<M>& start, double dt, double longest, int skip, int returns, Cycle<N>& cycle,
                   const Watch& watch = {}) noexcept {
  using End = typename Leg<N>::End;
  Search search;
  search.dt = dt;
  cycle.count = 0;
  Point<M> p = start;
  int again = 0;
  int after = -1;
  for (;;) {
    const Leg<N> leg = follow_leg<N>(m, p, dt, longest, false, watch);
    const int edge = leg.end == End::edge ? leg.edge : -1;
    if (!orbit::expected_end(m, leg, after, edge, search)) return search;
    if (skip <= 0 && cycle.count > 0) {
      cycle[cycle.count - 1].leg = leg;
      if (cycle[0].edge == edge && ++again == returns) {
        search.outcome = SearchOutcome::found;
        return search;
      }
    }
    if (skip <= 0) {
      if (cycle.count == max_cycle_events) {
        if (again > 0) search.outcome = SearchOutcome::too_many;
        return search;
      }
      EdgeMap<N>& map = cycle.map[static_cast<std::size_t>(cycle.count++)];
      map.edge = edge;
      map.chart = leg.chart;
      map.dim = leg.dim;
      map.x = leg.x1;
    }
    --skip;
    after = edge;
    p = point_in<M>(leg.chart, leg.x1);
    visit_at(typename M::Edges{}, edge, [&](auto e) {
      using E = decltype(e);
      p.set(typename E::to{}, m.reset(e, p.in(typename E::from{}), Input<M>::Zero()));
    });
  }
}

// True when the cycle is a shorter one, run through several times.
template <class M, int N>
bool is_repeated(const Cycle<N>& cycle) noexcept {
  for (int part = 1; part < cycle.count; ++part) {
    if (cycle.count % part != 0) continue;
    bool same = true;
    for (int j = 0; j < cycle.count && same; ++j) {
      const EdgeMap<N>& a = cycle[j];
      const EdgeMap<N>& b = cycle[j + part];
      same = a.edge == b.edge && state_difference<M>(a.chart, a.x, b.x).norm() < 1e-7 * (1.0 + a.x.norm());
    }
    if (same) return true;
  }
  return false;
}

namespace orbit {
// [s] The step that goes `ticks` times from one passage of a cycle's first edge to the next.
template <int N>
double step_of(const Cycle<N>& cycle, std::int64_t ticks) noexcept {
  int passages = 0;
  for (int j = 0; j < cycle.count; ++j) passages += cycle[j].edge == cycle[0].edge ? 1 : 0;
  return cycle.period() / passages / static_cast<double>(ticks);
}
}  // namespace orbit

// The limit cycle that `start` leads to: runs once round and applies `shoot`; where that fails, lets 40 and then 400
// events pass first, which finds what is stable. `returns` > 1 looks for cycles that close only after so many passages
// of their first edge; `ticks` steps of the integrator go from one passage to the next.
template <class M, int N>
Search find_cycle(const M& m, const Point<M>& start, std::int64_t ticks, Cycle<N>& cycle, int returns = 1) noexcept {
  Search best;
  Cycle<N> trial;
  bool ran = true;  // `best` tells of Newton's method, not of the machine
  for (const int skip : {0, 40, 400}) {
    // Two rounds: the first one only measures the period.
    const Timebase base = timebase_of(m, ticks);
    double dt = base.dt();
    double longest = 16.0 * base.period;
    Search search;
    for (int round = 0; round < 2; ++round) {
      search = first_cycle(m, start, dt, longest, skip, returns, trial);
      if (search.outcome != SearchOutcome::found) break;
      dt = orbit::step_of(trial, ticks);
      longest = 8.0 * trial.period();
    }
    const bool runs = search.outcome == SearchOutcome::found;
    if (runs) search = shoot(m, dt, longest, trial);
    const bool found = search.outcome == SearchOutcome::found;
    const bool lost = best.outcome != SearchOutcome::found;
    // Of two failures, what the machine does says more than what Newton's method does.
    if (skip == 0 || (found && (lost || !is_repeated<M>(trial))) || (lost && ran && !runs)) {
      best = search;
      cycle = trial;
      ran = runs;
    }
    if (found && !is_repeated<M>(trial)) break;
  }
  return best;
}

// Follows the limit cycle of `from` to the parameters of `to`, in steps that shrink where Newton's method fails; the
// order of events stays. `reached` is the share of the way that was covered; at 1 the search is that of `to`. Otherwise
// `cycle` is the last one found and the search says what stopped it.
template <class M, int N>
Search follow_cycle(const M& from, const M& to, std::int64_t ticks, Cycle<N>& cycle, double& reached) noexcept {
  constexpr double smallest = 0x1p-10;
  std::array<double, static_cast<std::size_t>(parameter_count<M>)> begin{};
  std::array<double, static_cast<std::size_t>(parameter_count<M>)> finish{};
  std::size_t i = 0;
  visit_parameters(from, [&](auto, auto, double v) { begin[i++] = v; });
  i = 0;
  visit_parameters(to, [&](auto, auto, double v) { finish[i++] = v; });
  const auto between = [&](double s) {
    M m = to;
    std::size_t k = 0;
    visit_parameters(m, [&](auto, auto, double& v) {
      v = s < 1.0 ? begin[k] + s * (finish[k] - begin[k]) : finish[k];
      ++k;
    });
    return m;
  };
  reached = 0.0;
  double stride = 0.125;
  Search search;
  Cycle<N> before = cycle;  // the cycle found before the last one, for the secant
  double before_at = 0.0;
  while (reached < 1.0) {
    const double s = std::fmin(1.0, reached + stride);
    Cycle<N> trial = cycle;
    if (reached > 0.0) {
      const double ahead = (s - reached) / (reached - before_at);
      for (int j = 0; j < cycle.count; ++j) {
        trial[j].x += ahead * state_difference<M>(cycle[j].chart, cycle[j].x, before[j].x);
      }
    }
    const Search tried = shoot(between(s), orbit::step_of(cycle, ticks), 8.0 * cycle.period(), trial);
    if (tried.outcome == SearchOutcome::found) {
      before = cycle;
      before_at = reached;
      cycle = trial;
      reached = s;
      search = tried;
      stride = std::fmin(0.25, 2.0 * stride);
    } else {
      search = tried;
      stride *= 0.5;
      if (stride < smallest) return search;
    }
  }
  // Once more with the steps that the new period asks for.
  return shoot(to, orbit::step_of(cycle, ticks), 8.0 * cycle.period(), cycle);
}

}  // namespace saltus
