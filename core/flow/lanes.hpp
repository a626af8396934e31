// Runs of one model side by side, a tick of all of them for little more than the price of one.
//
// A tick is the tick of `step`: the same operations in the same order, and where `step` branches, both ways and a
// choice lane by lane. A lane for which that is not enough (a guard that is nearly grazed or not armed, two guards in
// one step, anything that is not finite, whatever has a status) is left where it was and taken by `step` itself. So
// every run has the bits, the status and the ledger that `step` gives it.
#pragma once

#include <array>
#include <utility>

#include "../lanes.hpp"
#include "advance.hpp"

namespace saltus {

// A model says `static constexpr bool branchless = true;` when it never decides anything by comparing values: it may
// then be written over Lanes. One that says so and branches does not compile there.
template <class M>
concept Branchless = requires {
  requires M::branchless;
};

// A model whose lanes have the parameters of W models.
template <int W, class M>
Rebind<M, Lanes<W>> in_lanes(const std::array<M, static_cast<std::size_t>(W)>& models) noexcept {
  auto r = lift<Lanes<W>>(models[0]);
  for (int lane = 0; lane < W; ++lane) {
    std::array<double, static_cast<std::size_t>(parameter_count<M>)> values{};
    std::size_t i = 0;
    visit_parameters(models[static_cast<std::size_t>(lane)], [&](auto, auto, const double& v) { values[i++] = v; });
    i = 0;
    visit_parameters(r, [&](auto, auto, Lanes<W>& v) { v.set(lane, values[i++]); });
  }
  return r;
}

namespace flow {
// f(0), f(1) ... f(N - 1), each inlined: a vector of many lanes is best not copied, nor indexed at run time.
template <int N, class F>
[[gnu::always_inline]] inline void each(const F& f) noexcept {
  [&]<int... I>(std::integer_sequence<int, I...>) { (f(std::integral_constant<int, I>{}), ...); }
  (std::make_integer_sequence<int, N>{});
}

// As Step in crossing.hpp, and the rk4 and the Hermite of rk4.hpp.
template <int N, int W, class F>
struct LaneStep {
  using S = Lanes<W>;
  using X = Vec<N, S>;
  const F& f;
  S h;            // [s]
  double moment;  // [s]
  X x0, f0, x1, f1, end;

  // From the first N of the coordinates at x.
  template <class All>
  [[gnu::always_inline]] LaneStep(const F& rate, const All& x, const S& length, double whole) noexcept
      : f(rate), h(length), moment(crossing::moment * whole), x0(first(x)), f0(f(x0)), x1(stepped(h)), f1(f(x1)) {
    each<N>([&](auto i) { end[i] = x1[i]; });
  }

  template <class All>
  [[gnu::always_inline]] static X first(const All& x) noexcept {
    X r;
    each<N>([&](auto i) { r[i] = x[i]; });
    return r;
  }
  [[gnu::always_inline]] X reintegrated(const S& s) const noexcept { return stepped(S(s * h)); }
  [[gnu::always_inline]] X stepped(const S& by) const noexcept {
    const S half = by * 0.5, sixth = by / 6.0;
    X x;
    each<N>([&](auto i) { x[i] = x0[i] + f0[i] * half; });
    const X k2 = f(x);
    each<N>([&](auto i) { x[i] = x0[i] + k2[i] * half; });
    const X k3 = f(x);
    each<N>([&](auto i) { x[i] = x0[i] + k3[i] * by; });
    const X k4 = f(x);
    each<N>([&](auto i) { x[i] = x0[i] + (f0[i] + (k2[i] + k3[i]) * 2.0 + k4[i]) * sixth; });
    return x;
  }
  [[gnu::always_inline]] X curve(const S& s) const noexcept {
    const S r = 1.0 - s;
    const S b0 = r * r * (1.0 + 2.0 * s);
    const S b1 = s * s * (1.0 + 2.0 * r);
    const S d0 = h * s * r * r;
    const S d1 = h * s * s * r;
    X x;
    each<N>([&](auto i) { x[i] = b0 * x0[i] + b1 * x1[i] + d0 * f0[i] - d1 * f1[i]; });
    return x;
  }
};

// As Ends and Dip there.
template <int W>
struct LaneEnds {
  using S = Lanes<W>;
  S g0, d0, g1, d1;

  S c2() const noexcept { return 3.0 * (g1 - g0) - 2.0 * d0 - d1; }
  S c3() const noexcept { return d0 + d1 - 2.0 * (g1 - g0); }
  // Where there may be a dip, for less than it takes to find it: only a sum that is positive has a positive root.
  Mask<W> may_dip() const noexcept {
    const S a = c2(), b = c3(), none(0.0);
    return ((a > none) & (d0 < none)) | (~(a > none) & (b > none) & (-a < 3.5 * b));
  }
  struct Dip {
    Mask<W> there;
    S s, reach;
  };
  Dip dip() const noexcept {
    const S a = c2(), b = c3(), none(0.0), disc = a * a - 3.0 * b * d0;
    const S root = sqrt(max(disc, none));
    const S s = select(a > none, -d0 / (a + root), (root - a) / (3.0 * b));
    const S reach = select(root < 0.75 * abs(b), root / (3.0 * abs(b)), S(0.25));
    return {(disc > none) & ((a > none) | (b != none)) & (s > none) & (s < S(1.0)), s, reach};
  }
};
template <int N, int W, class F, class G>
LaneEnds<W> ends(const LaneStep<N, W, F>& step, const G& guard) noexcept {
  constexpr double sliver = crossing::sliver, per_sliver = 1.0 / sliver;  // a power of two: no rounding
  using S = Lanes<W>;
  const S g0 = guard(step.x0), g1 = guard(step.end);
  return {g0, (guard(step.curve(S(sliver))) - g0) * per_sliver, g1,
          (g1 - guard(step.curve(S(1.0 - sliver)))) * per_sliver};
}

// Lanes in which the guard is plainly positive all along the step: `locate` would find nothing to say.
template <int N, int W, class F, class G>
Mask<W> plainly_inside(const LaneStep<N, W, F>& step, const G& guard) noexcept {
  using S = Lanes<W>;
  const LaneEnds<W> e = ends(step, guard);
  const S sum = abs(e.g0) + abs(e.g1) + abs(e.d0) + abs(e.d1);  // no less than the scale; finite if they are
  Mask<W> inside = (e.g0 > S(0.0)) & (e.g1 > crossing::doubtful_dip * sum) & finite(sum);
  if (const Mask<W> may = e.may_dip(); any(may)) inside = inside & ~(may & e.dip().there);
  return inside;
}

// As `locate`, for the lanes asked about.
template <int N, int W>
struct LaneCrossing {
  unsigned crossed = 0, doubtful = 0;  // lanes; in the others there is nothing
  Lanes<W> s;
  Vec<N, Lanes<W>> x;
};
template <int N, int W, class F, class G>
SALTUS_LANE_KERNEL [[gnu::noinline]] LaneCrossing<N, W> locate(const LaneStep<N, W, F>& step, const G& guard,
                                                               unsigned asked) noexcept {
  using S = Lanes<W>;
  constexpr double sliver = crossing::sliver;
  const S zero(0.0), one(1.0);
  const auto on_curve = [&](const S& s) -> S { return guard(step.curve(s)); };
  const auto slope_at = [&](const S& s) -> S {
    const S before = max(zero, s - sliver), after = min(one, s + sliver);
    return (on_curve(after) - on_curve(before)) / (after - before);
  };
  LaneCrossing<N, W> found;
  const LaneEnds<W> e = ends(step, guard);
  const S scale = max(max(abs(e.g0), abs(e.g1)), max(abs(e.d0), abs(e.d1)));
  Mask<W> doubt = ~finite(abs(e.g0) + abs(e.g1) + abs(e.d0) + abs(e.d1));
  S lo = zero;
  if (const Mask<W> behind = ~(e.g0 > zero); (behind.bits() & asked) != 0) {
    const S later = step.moment / step.h;
    doubt = doubt | (behind & ~((later < one) & (on_curve(later) > zero)));
    lo = select(behind, later, zero);
  }
  const auto dip = e.dip();
  if (const Mask<W> dips = dip.there & (dip.s > lo); (dips.bits() & asked) != 0) {
    S left = max(lo, dip.s - dip.reach), right = min(one, dip.s + dip.reach);
    for (int i = 0; i < crossing::halvings / 2; ++i) {
      const S mid = 0.5 * (left + right);
      const Mask<W> rises = slope_at(mid) > zero;
      right = select(rises, mid, right);
      left = select(rises, left, mid);
    }
    doubt = doubt | (dips & ~(on_curve(0.5 * (left + right)) > crossing::near * scale));
  }
  const Mask<W> ends_inside = e.g1 > zero;
  doubt = doubt | (ends_inside & (e.g1 < crossing::doubtful_dip * scale) & (abs(e.d1) < crossing::tangential * scale));
  found.doubtful = asked & doubt.bits();
  const unsigned falls = asked & ~found.doubtful & ~ends_inside.bits();
  if (falls == 0) return found;

  S hi = one, inner = lo, s = hi;
  for (int i = 0; i < crossing::halvings; ++i) {
    const S mid = 0.5 * (inner + s);
    const Mask<W> before = on_curve(mid) > zero;
    inner = select(before, mid, inner);
    s = select(before, s, mid);
  }
  S slope = slope_at(s), aim = crossing::hair;
  s = min(s, hi - 2.0 * aim);
  found.x = step.end;
  const Mask<W> falling = Mask<W>::of(falls);
  Mask<W> seeking = falling;
  for (int i = 0; i < crossing::polishes; ++i) {
    seeking = seeking & (hi - lo > S(4.0 * crossing::hair));
    if (!any(seeking)) break;
    s = select((s > lo) & (s < hi), s, 0.5 * (lo + hi));
    const Vec<N, S> trial = step.reintegrated(s);
    const S g = guard(trial);
    const Mask<W> before = g > zero, inside = seeking & before, beyond = seeking & ~before;
    lo = select(inside, s, lo);
    aim = select(inside, aim * 2.0, aim);
    hi = select(beyond, s, hi);
    found.x = select(beyond, trial, found.x);
    if (i == 0) {
      const S mend = g * (2.0 / s - 2.0 / (1.0 - s));
      slope = select(abs(mend) < -0.5 * slope, slope + mend, slope);
    }
    doubt = doubt | (seeking & ~(slope < zero));  // to be halved, which is rare
    const S correction = -g / slope, off = abs(correction);
    seeking = seeking & (slope < zero) & ~((g <= zero) & (off < S(crossing::close)));
    s += correction + aim + min(0x1p-25 * off, S(0.5 * crossing::close));
  }
  doubt = doubt | (seeking & (hi - lo > S(4.0 * crossing::hair)));
  doubt = doubt | (slope_at(hi) > -crossing::tangential * scale) | ~(guard(found.x) <= zero);
  found.s = hi;
  found.doubtful |= falls & doubt.bits();
  found.crossed = falls & ~found.doubtful;
  return found;
}
}  // namespace flow

// W runs of a model. It is one object of a few kilobytes that never allocates.
template <Branchless M, int W>
class LaneRuns {
  static_assert(W >= 1 && W <= 32);
  static constexpr std::size_t at(int i) noexcept { return static_cast<std::size_t>(i); }

 public:
  using S = Lanes<W>;
  using Models = std::array<M, at(W)>;
  using U = Vec<input_count<M>, S>;
  using Y = Vec<output_count<M>, S>;

  explicit LaneRuns(const Models& models) noexcept : models_(models), model_(in_lanes<W, M>(models)) {
    for (int lane = 0; lane < W; ++lane) put(lane, Run<M>{});
  }

  void set(int lane, const Run<M>& run) noexcept {
    write_down();
    put(lane, run);
  }
  Run<M> run(int lane) const noexcept {
    Run<M> r = run_[at(lane)];
    add_plain(r);
    if (const int chart = chart_of(in_, lane); chart >= 0) r.at.chart = chart;
    for (int i = 0; i < max_dim<M>; ++i) r.at.x[i] = x_[i][lane];
    return r;
  }
  // Of the last tick: that of a run, and whether all are ok.
  Status status(int lane) const noexcept { return ok_ ? Status::ok : status_[at(lane)]; }
  bool ok() const noexcept { return ok_; }

  // As `step`, for every run.
  void step(const U& u, const Timebase& base) noexcept {
    Tick t{u, base.dt(), base.sets_clock, S(0.0), S(0.0), in_, {}, apart_, false};
    if (base.sets_clock) {
      t.clock = base.phase(run_[0].tick + plain_ + 1);
      for (int lane = 1; lane < W && !level_; ++lane) {
        t.clock.set(lane, base.phase(run_[at(lane)].tick + plain_ + 1));
      }
    }
    bool plain = false;
    int c = 0;
    visit_each(typename M::Charts{}, [&](auto chart) {
      if (in_[at(c++)] == every) plain = leg(chart, t);
    });
    ok_ = true;
    if (plain) {
      ++plain_;
    } else {
      finish(t, base);
    }
  }

  Y output(const U& u) const noexcept {
    Y y;
    bool whole = false;
    int c = 0;
    visit_each(typename M::Charts{}, [&](auto chart) {
      if (in_[at(c++)] != every) return;
      Vec<decltype(chart)::dim, S> x;
      for (int i = 0; i < x.size(); ++i) x[i] = x_[i];
      y = model_.output(chart, x, u);
      whole = true;
    });
    for (int lane = 0; lane < W && !whole; ++lane) {
      const Output<M> one = output_at(models_[at(lane)], run(lane).at, of_lane(u, lane));
      for (int i = 0; i < output_count<M>; ++i) y[i].set(lane, one[i]);
    }
    return y;
  }

 private:
  static constexpr unsigned every = ~0u >> (32 - W);
  using X = Vec<max_dim<M>, S>;
  using InCharts = std::array<unsigned, at(M::Charts::size)>;  // lanes in each chart

  // A tick under way.
  struct Tick {
    const U& u;
    double h;  // [s]
    bool sets_clock;
    S clock;    // [rad] at the end
    S elapsed;  // [s]
    InCharts at, ended;
    unsigned redo;  // lanes that `step` has to take
    bool parted;    // lanes have gone ways of their own; before_ has where they were
  };
  static Input<M> of_lane(const U& u, int lane) noexcept {
    Input<M> r;
    for (int i = 0; i < input_count<M>; ++i) r[i] = u[i][lane];
    return r;
  }
  static int chart_of(const InCharts& in, int lane) noexcept {
    for (int c = 0; c < M::Charts::size; ++c) {
      if ((in[at(c)] >> lane & 1) != 0) return c;
    }
    return -1;
  }

  // Ticks of which no lane had anything to tell are only counted, until there is more to write down.
  void add_plain(Run<M>& r) const noexcept {
    if (plain_ == 0) return;
    r.tick += plain_;
    r.ledger.count[0] += plain_;
    r.ledger.last_tick[0] = r.tick - 1;
  }
  void write_down() noexcept {
    for (Run<M>& r : run_) add_plain(r);
    plain_ = 0;
  }
  void put(int lane, const Run<M>& run) noexcept {
    const unsigned bit = 1u << lane;
    run_[at(lane)] = run;
    for (unsigned& lanes : in_) lanes &= ~bit;
    apart_ &= ~bit;
    const bool on_grid = run.into == 0.0 && run.at.chart >= 0 && run.at.chart < M::Charts::size;
    (on_grid ? in_[at(run.at.chart)] : apart_) |= bit;
    for (int i = 0; i < max_dim<M>; ++i) x_[i].set(lane, run.at.x[i]);
    level_ = true;
    for (const Run<M>& other : run_) level_ = level_ && other.tick == run.tick;
  }

  // Takes the lanes in a chart through a step, to its end or to their first event. True when that is all lanes, and
  // they come to the end.
  template <class C>
  SALTUS_LANE_KERNEL bool leg(C c, Tick& t) noexcept {
    constexpr int n = C::dim;
    constexpr std::size_t here = at(index_of<C>(typename M::Charts{}));
    const auto f = [&](const Vec<n, S>& x) noexcept -> Vec<n, S> { return model_.flow(c, x, t.u); };
    flow::LaneStep<n, W, decltype(f)> step(f, x_, t.h - t.elapsed, t.h);
    S sum(0.0);
    flow::each<n>([&](auto i) { sum += step.x1[i] + step.f1[i]; });  // not finite when anything is not
    if constexpr (HasClock<C>) {
      if (t.sets_clock) step.end[clock_of<C>()] = t.clock;
    }
    Mask<W> inside = finite(sum);
    if constexpr (M::Edges::size > 0) {
      visit_each(typename M::Edges{}, [&](auto e) {
        if constexpr (std::is_same_v<typename decltype(e)::from, C>) {
          const auto guard = [&](const Vec<n, S>& x) -> S { return model_.guard(e, x, t.u); };
          inside = inside & flow::plainly_inside(step, guard);
        }
      });
    }
    if (t.at[here] == every && !t.parted && all(inside)) {
      flow::each<n>([&](auto i) { x_[i] = step.end[i]; });
      return true;
    }
    part(c, step, inside.bits(), finite(sum).bits(), t);
    return false;
  }

  // The rest of a leg, when not all lanes go the same way: most are `inside` all along the step.
  template <class C, class F>
  [[gnu::noinline]] void part([[maybe_unused]] C c, const flow::LaneStep<C::dim, W, F>& step, unsigned inside,
                              unsigned sound, Tick& t) noexcept {
    constexpr std::size_t here = at(index_of<C>(typename M::Charts{}));
    if (!t.parted) before_ = x_;
    t.parted = true;
    const unsigned lanes = std::exchange(t.at[here], 0u);
    unsigned ended = lanes & inside;
    t.redo |= lanes & ~sound;
    if constexpr (M::Edges::size > 0) {
      if (const unsigned asked = lanes & ~inside & sound; asked != 0) ended |= cross(c, step, asked, t);
    }
    move<C::dim>(ended, step.end);
    t.ended[here] |= ended;
  }
  template <int N>
  void move(unsigned lanes, const Vec<N, S>& x) noexcept {
    const Mask<W> these = Mask<W>::of(lanes);
    for (int i = 0; i < max_dim<M>; ++i) x_[i] = select(these, i < N ? x[std::min(i, N - 1)] : S(0.0), x_[i]);
  }

  // Takes the lanes asked about through the guards that they meet in a step; returns those that meet none.
  template <class C, class F>
  unsigned cross(C, const flow::LaneStep<C::dim, W, F>& step, unsigned asked, Tick& t) noexcept {
    constexpr int n = C::dim;
    unsigned crossed = 0, doubtful = 0;
    std::array<unsigned, at(M::Edges::size) + 1> through{};  // lanes of each edge
    S s(1.0);
    Vec<n, S> x = step.end;
    std::size_t index = 0;
    visit_each(typename M::Edges{}, [&](auto e) {
      if constexpr (std::is_same_v<typename decltype(e)::from, C>) {
        const auto found = flow::locate(
            step, [&](const Vec<n, S>& z) -> S { return model_.guard(e, z, t.u); }, asked);
        doubtful |= found.doubtful | (crossed & found.crossed);
        crossed |= found.crossed;
        through[index] = found.crossed;
        if (found.crossed != 0) {
          const Mask<W> these = Mask<W>::of(found.crossed);
          s = select(these, found.s, s);
          x = select(these, found.x, x);
        }
      }
      ++index;
    });
    const S elapsed = t.elapsed + s * step.h;
    doubtful |= crossed & ~((s < S(1.0)) & (elapsed < S(t.h))).bits();
    index = 0;
    visit_each(typename M::Edges{}, [&](auto e) {
      using E = decltype(e);
      if constexpr (std::is_same_v<typename E::from, C>) {
        if ((through[index] & ~doubtful) != 0) {
          const Vec<E::to::dim, S> after = model_.reset(e, x, t.u);
          S sum(0.0);
          for (int i = 0; i < E::to::dim; ++i) sum += after[i];
          doubtful |= through[index] & ~finite(sum).bits();
          const unsigned go = through[index] & ~doubtful;
          move<E::to::dim>(go, after);
          t.elapsed = select(Mask<W>::of(go), elapsed, t.elapsed);
          t.at[at(index_of<typename E::to>(typename M::Charts{}))] |= go;
        }
      }
      ++index;
    });
    t.redo |= doubtful;
    return asked & ~crossed & ~doubtful;
  }

  // The rest of a tick that is not plain.
  [[gnu::noinline]] void finish(Tick& t, const Timebase& base) noexcept {
    write_down();
    if (!t.parted) before_ = x_;
    t.parted = true;
    constexpr int most = 3;  // legs of a lane; who has more goes alone
    for (int i = 0; i < most; ++i) {
      int c = 0;
      visit_each(typename M::Charts{}, [&](auto chart) {
        if (t.at[at(c++)] != 0) leg(chart, t);
      });
    }
    for (const unsigned lanes : t.at) t.redo |= lanes;
    const InCharts before = std::exchange(in_, t.ended);
    for (int lane = 0; lane < W; ++lane) {
      Run<M>& r = run_[at(lane)];
      if ((t.redo >> lane & 1) == 0) {
        status_[at(lane)] = Status::ok;
        r.ledger.note(Status::ok, r.tick++);
      }
    }
    for (int lane = 0; lane < W; ++lane) {
      if ((t.redo >> lane & 1) == 0) continue;
      Run<M> r = run_[at(lane)];
      if (const int chart = chart_of(before, lane); chart >= 0) r.at.chart = chart;
      for (int i = 0; i < max_dim<M>; ++i) r.at.x[i] = before_[i][lane];
      const Status s = saltus::step(models_[at(lane)], r, of_lane(t.u, lane), base).status;
      status_[at(lane)] = s;
      ok_ = ok_ && s == Status::ok;
      put(lane, r);
    }
  }

  Models models_;
  Rebind<M, S> model_;
  X x_ = X::Constant(S(0.0)), before_ = x_;
  std::array<Run<M>, at(W)> run_{};  // but for the points of lanes that stand on the grid
  std::int64_t plain_ = 0;           // [tick] that all runs are further
  std::array<Status, at(W)> status_{};
  InCharts in_{};
  unsigned apart_ = 0;  // lanes that do not stand on the grid, or in no chart
  bool level_ = true;   // all at the same tick
  bool ok_ = true;
};

}  // namespace saltus
