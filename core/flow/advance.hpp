// One interval of a hybrid model's life: flow, and every event inside it. The one algorithm to get right.
//
// A guard is positive inside its chart; an edge is taken at the first t* in (t, t + h] where its guard is no longer
// positive. Armed = positive at the start, or positive a moment (h / 2^20) into the step; recomputed each time, never
// stored. A step that starts on a guard, to rounding, and leaves through it takes the edge at once: so it is with a
// state that a section or a reset left there. The earliest edge wins, ties go to the one declared first; then what is
// left of the interval goes on. At most eight crossings. A state on or behind a guard that is not armed has escaped
// when it ends the interval behind it, or began it there.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "../hybrid/point.hpp"
#include "../status.hpp"
#include "../tick.hpp"
#include "crossing.hpp"

namespace saltus {

inline constexpr int max_crossings = 8;  // in one interval; one more is Status::zeno

struct Event {
  int edge = 0;     // position in M::Edges
  double at = 0.0;  // [s] after the start of the interval
};

// What happened in an interval.
struct Passage {
  Status status = Status::ok;
  int events = 0;
  std::array<Event, max_crossings> event{};
  double elapsed = 0.0;  // [s] lived; less than asked for when the watch was met or the status is not usable
  bool met = false;      // the watch fell through zero at `elapsed`, and the point stands there
  bool jumped = false;   // a reset carried the point through the watch, which was not met
};

// A watch is a surface that stops the interval without changing the state: value(m, C, x, u), falling through zero.
// One that names an `edge` is the guard of that edge, in its chart and nowhere else: it is located once for both.
struct Unwatched {};

// The edge that T names as `edge`, or void.
template <class T>
struct EdgeNamed {
  using type = void;
};
template <class T>
requires requires { typename T::edge; }
struct EdgeNamed<T> {
  using type = typename T::edge;
};

// The grid that an interval is part of.
struct Landing {
  double whole = 0.0;  // [s] length of the grid's intervals, where this one is only the rest of one
  double clock = std::numeric_limits<double>::quiet_NaN();  // [rad] what the clock is set to at the end, if it is
};

namespace flow {
// A leg: from the point to the first event, the watch or the end of the interval. `tied`: another edge was met at the
// same instant.
template <class Method, class M, class C, class Watch>
void leg(const M& m, Point<M>& p, const Input<M>& u, double h, const Watch& watch, const Landing& landing, C c,
         bool& tied, Passage& r) noexcept {
  constexpr int n = C::dim;
  const auto f = [&](const Vec<n>& x) noexcept -> Vec<n> { return m.flow(c, x, u); };
  const double left = h - r.elapsed;
  const Vec<n> x0 = p.in(c);
  const Vec<n> f0 = f(x0);
  Vec<n> f1;
  const Vec<n> x1 = Method::template step<n, double>(f, x0, f0, left, f1);
  double blemish = 0.0;  // not a number when anything is not finite
  for (int i = 0; i < n; ++i) blemish += (x0[i] - x0[i]) + (f0[i] - f0[i]) + (x1[i] - x1[i]) + (f1[i] - f1[i]);
  if (!(blemish == 0.0)) {
    r.status = Status::diverged;
    return;
  }
  // The guards judge the very state that the next interval starts from, or a crossing could fall between the two.
  Vec<n> end = x1;
  if constexpr (HasClock<C>) {
    if (std::isfinite(landing.clock)) end[clock_of<C>()] = landing.clock;
  }
  const double moment = crossing::moment * std::fmax(h, landing.whole);
  const Step<n, decltype(f), Method> step{f, {x0, f0, x1, f1, left}, end, moment};
  using Kind = typename Crossing<n>::Kind;
  using WatchedEdge = typename EdgeNamed<Watch>::type;
  constexpr double tie = 0x1p-43;  // [-] of the step: crossings closer than this are simultaneous
  Crossing<n> first;               // or the end
  first.x = end;
  int edge = -1;
  Status status = Status::ok;
  double missed = 3.0;  // [-] of the step: where a guard nearly fell through zero
  std::uint64_t unarmed = 0;
  [[maybe_unused]] Crossing<n> at_watch;
  tied = false;

  int index = 0;
  visit_each(typename M::Edges{}, [&](auto e) {
    using E = decltype(e);
    if constexpr (std::is_same_v<typename E::from, C>) {
      const Crossing<n> found = locate<n>(step, [&](const Vec<n>& x) noexcept -> double { return m.guard(e, x, u); });
      if constexpr (std::is_same_v<WatchedEdge, E>) at_watch = found;
      if (found.kind == Kind::escaped) status = worse(status, Status::escaped);
      if (found.kind == Kind::diverged) status = worse(status, Status::diverged);
      if (found.kind == Kind::unarmed) unarmed |= std::uint64_t{1} << index;
      if (found.kind == Kind::none && found.grazing) missed = std::fmin(missed, found.s);
      if (found.kind == Kind::crossed && found.s < first.s - tie) {
        first = found;
        edge = index;
        tied = false;
      } else if (found.kind == Kind::crossed && found.s <= first.s + tie) {
        tied = true;
      }
    }
    ++index;
  });
  bool met = false;
  if constexpr (!std::is_same_v<Watch, Unwatched>) {
    if constexpr (std::is_void_v<WatchedEdge>) {
      at_watch = locate<n>(step, [&](const Vec<n>& x) noexcept -> double { return watch.value(m, c, x, u); });
    }
    const Crossing<n>& found = at_watch;
    // A section met at the same instant as an edge is met before it: the state handed out is the one on the section.
    // One that the step starts on has been met.
    if (found.kind == Kind::crossed && found.s > 0.0 && found.s <= first.s + tie) {
      first = found;
      met = true;
    }
  }
  const bool ends = !met && edge < 0;
  if (unarmed != 0) {
    index = 0;
    visit_each(typename M::Edges{}, [&](auto e) {
      if constexpr (std::is_same_v<typename decltype(e)::from, C>) {
        if ((unarmed >> index & 1) != 0 && m.guard(e, first.x, u) < 0.0) status = worse(status, Status::escaped);
      }
      ++index;
    });
  }

  if (!usable(status)) {
    r.status = worse(r.status, status);
    return;
  }
  if (missed <= first.s) r.status = worse(r.status, Status::grazing);
  if (ends) {
    p.set(c, end);
    r.elapsed = h;
    return;
  }
  if (!met && r.events == max_crossings) {
    r.status = Status::zeno;
    return;
  }
  if (first.grazing) r.status = worse(r.status, Status::grazing);
  r.elapsed = first.s < 1.0 ? r.elapsed + first.s * left : h;
  if (met) {
    p.set(c, first.x);
    r.met = true;
    return;
  }
  r.event[static_cast<std::size_t>(r.events++)] = Event{edge, r.elapsed};
  visit_at(typename M::Edges{}, edge, [&](auto e) {
    using E = decltype(e);
    if constexpr (std::is_same_v<typename E::from, C>) {
      const Vec<E::to::dim> after = m.reset(e, first.x, u);
      if (!after.allFinite()) {
        r.status = Status::diverged;
        return;
      }
      p.set(typename E::to{}, after);
      if constexpr (!std::is_same_v<Watch, Unwatched>) {
        const auto to = typename E::to{};
        const Vec<E::to::dim> soon = after + m.flow(to, after, u) * moment;
        const bool was_inside = watch.value(m, c, first.x, u) > 0.0;
        r.jumped = r.jumped || (was_inside && watch.value(m, to, after, u) < 0.0 && watch.value(m, to, soon, u) < 0.0);
      }
    }
  });
}
}  // namespace flow

// Moves p through h seconds with the input held at u. Statuses: ok; grazing (an event, or a miss, was nearly
// tangential); zeno, escaped, diverged: p stands where the trouble was met, `elapsed` says when; failed: there is no
// such chart, or h is negative or not a number. `advance<Rk8>` is the same by steps of order eight.
template <class Method = Rk4, class M, class Watch = Unwatched>
Passage advance(const M& m, Point<M>& p, const Input<M>& u, double h, const Watch& watch = {},
                const Landing& landing = {}) noexcept {
  static_assert(M::Edges::size <= 64);
  Passage r;
  if (!(h >= 0.0) || p.chart < 0 || p.chart >= M::Charts::size) r.status = Status::failed;
  bool tied = false;
  while (usable(r.status) && !r.met && (r.elapsed < h || tied)) {
    visit_chart(p, [&](auto c) { flow::leg<Method>(m, p, u, h, watch, landing, c, tied, r); });
  }
  return r;
}

// A model on the integer time grid.
template <class M>
struct Run {
  Point<M> at{};
  std::int64_t tick = 0;  // [tick] the last grid point passed
  double into = 0.0;      // [s] since then
  Ledger ledger{};

  double time(const Timebase& base) const noexcept { return base.time(tick) + into; }  // [s]
};

// The time base of a model: a turn of its clock in `per_turn` ticks; for a model without a clock, of one second.
template <class M>
Timebase timebase_of(const M& m, std::int64_t per_turn) noexcept {
  Timebase base{1.0, per_turn};
  if constexpr (clocked<M>) {
    const Point<M> p = start_of(m);
    visit_chart(p, [&](auto c) {
      const double rate = m.flow(c, p.in(c), Input<M>::Zero())[clock_of<decltype(c)>()];  // [rad/s]
      base.period = 2.0 * std::numbers::pi / rate;
      base.sets_clock = true;
    });
  }
  return base;
}

// Sets the clock coordinate to the angle of a grid tick, where the time base says so: exact, integration would drift.
template <class M>
void set_clock(Point<M>& p, const Timebase& base, std::int64_t tick) noexcept {
  if constexpr (clocked<M>) {
    if (base.sets_clock) p.x[clock_index(p)] = base.phase(tick);
  }
}

// To the next grid tick, or to the watch if that comes first. Counts its status in the run's ledger.
template <class Method = Rk4, class M, class Watch = Unwatched>
Passage step(const M& m, Run<M>& run, const Input<M>& u, const Timebase& base, const Watch& watch = {}) noexcept {
  const double dt = base.dt();
  Landing landing{dt};
  if (base.sets_clock) landing.clock = base.phase(run.tick + 1);
  const Passage r = advance<Method>(m, run.at, u, dt - run.into, watch, landing);
  run.ledger.note(r.status, run.tick);
  if (r.met) {
    run.into += r.elapsed;
    if (run.into >= dt) {  // met at the very end: stand on the grid, not beyond it
      run.into = 0.0;
      ++run.tick;
    }
  } else if (usable(r.status)) {
    run.into = 0.0;
    ++run.tick;
    if constexpr (clocked<M>) {
      if (base.sets_clock) run.at.x[clock_index(run.at)] = landing.clock;
    }
  } else {
    run.into += r.elapsed;
  }
  return r;
}

}  // namespace saltus
