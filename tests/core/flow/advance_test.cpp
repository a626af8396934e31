#include "core/flow/advance.hpp"

#include <cmath>
#include <limits>
#include <random>

#include "core/flow/rk8.hpp"
#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;
using namespace saltus::worlds;

namespace {

constexpr double nan_ = std::numeric_limits<double>::quiet_NaN();
const Vec<1> still(0.0);

Point<Ball<>> ball_at(double y, double v) { return at<Ball<>>(ball::Air{}, Vec<2>(y, v)); }

// x' = 1 up to x = 1; not finite beyond `flow`, `guard`, or after the reset when `reset` is negative.
struct Faults : Chart<1> {};
struct Reach : Edge<Faults, Faults> {};
template <class S = double>
struct Faulty {
  using Charts = List<Faults>;
  using Edges = List<Reach>;
  static constexpr std::string_view name = "faulty";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"x", "-"}};
  S flow_ = 9.0, guard_ = 9.0, reset_ = 9.0;
  static constexpr auto parameters() {
    return std::array{Parameter{"flow", "-", &Faulty::flow_}, Parameter{"guard", "-", &Faulty::guard_},
                      Parameter{"reset", "-", &Faulty::reset_}};
  }
  Vec<1, S> flow(Faults, const Vec<1, S>& x, const Vec<0, S>&) const noexcept {
    return Vec<1, S>(1.0 + 0.0 * sqrt(flow_ - x[0]));
  }
  S guard(Reach, const Vec<1, S>& x, const Vec<0, S>&) const noexcept { return 1.0 - x[0] + 0.0 * sqrt(guard_ - x[0]); }
  Vec<1, S> reset(Reach, const Vec<1, S>&, const Vec<0, S>&) const noexcept { return Vec<1, S>(0.0 * sqrt(reset_)); }
  Vec<1, S> output(Faults, const Vec<1, S>& x, const Vec<0, S>&) const noexcept { return x; }
  Start<Faults, S> start() const noexcept { return {Vec<1, S>(S(0.0))}; }
};
static_assert(check<Faulty<>>());

// A parabola over a floor, y'' = 1, and a way out of it at time `ceiling`.
struct Hole : Chart<3> {};  // (y, y', t)
struct Out : Chart<1> {};
struct Bottom : Edge<Hole, Hole> {};
struct Exit : Edge<Hole, Out> {};
template <class S = double>
struct Pit {
  using U = Vec<0, S>;
  using Charts = List<Hole, Out>;
  using Edges = List<Bottom, Exit>;
  static constexpr std::string_view name = "pit";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array<Quantity, 0> outputs{};
  S ceiling = 9.0;  // [s]
  static constexpr auto parameters() { return std::array{Parameter{"ceiling", "s", &Pit::ceiling}}; }
  Vec<3, S> flow(Hole, const Vec<3, S>& x, const U&) const noexcept { return {x[1], 1.0, 1.0}; }
  Vec<1, S> flow(Out, const Vec<1, S>&, const U&) const noexcept { return Vec<1, S>(S(0.0)); }
  S guard(Bottom, const Vec<3, S>& x, const U&) const noexcept { return x[0]; }
  S guard(Exit, const Vec<3, S>& x, const U&) const noexcept { return ceiling - x[2]; }
  Vec<3, S> reset(Bottom, const Vec<3, S>& x, const U&) const noexcept { return {x[0], -x[1], x[2]}; }
  Vec<1, S> reset(Exit, const Vec<3, S>& x, const U&) const noexcept { return Vec<1, S>(x[0]); }
  template <class C>
  Vec<0, S> output(C, const Vec<C::dim, S>&, const U&) const noexcept {
    return {};
  }
  Start<Hole, S> start() const noexcept { return {Vec<3, S>{1.0, 0.0, 0.0}}; }
};
static_assert(check<Pit<>>());

// Counts the evaluations of the flow.
template <class S = double>
struct Counted : Pendulum<S> {
  static inline long calls = 0;
  Vec<2, S> flow(pendulum::Swing swing, const Vec<2, S>& x, const Vec<1, S>& u) const noexcept {
    ++calls;
    return Pendulum<S>::flow(swing, x, u);
  }
};

// State of the spring and wall after T seconds from (1, 0), in closed form.
Vec<2> wall_exactly(const Wall<>& m, double T) {
  double amplitude = 1.0;
  double angle = 0.0;  // x = amplitude cos(angle), angle' = w
  double t = 0.0;
  for (;;) {
    const double hit = std::acos(-m.d / amplitude);  // in (pi/2, pi)
    const double wait = (hit - angle) / m.w;
    if (t + wait > T) break;
    t += wait;
    const double v = m.e * amplitude * m.w * std::sin(hit);  // outgoing
    amplitude = std::hypot(m.d, v / m.w);
    angle = -std::acos(-m.d / amplitude);
  }
  angle += m.w * (T - t);
  return {amplitude * std::cos(angle), -amplitude * m.w * std::sin(angle)};
}

// Where the point lies after n equal intervals that make up T seconds.
template <class M>
Vec<max_dim<M>> after(const M& m, double T, int n) {
  Point<M> p = start_of(m);
  for (int i = 0; i < n; ++i) {
    if (advance(m, p, Input<M>(Input<M>::Zero()), T / n).status != Status::ok) return Vec<max_dim<M>>::Constant(nan_);
  }
  return p.x;
}

// Slope of log error over log step, by least squares over many steps, so that the phase of the events averages out.
template <class M>
double order(const M& m, double T, const Vec<max_dim<M>>& truth) {
  double sx = 0.0, sy = 0.0, sxx = 0.0, sxy = 0.0;
  int count = 0;
  for (double n = 60.0; n < 1000.0; n *= 1.11, ++count) {
    const double x = std::log(1.0 / std::floor(n));
    const double y = std::log((after(m, T, static_cast<int>(n)) - truth).norm());
    sx += x;
    sy += y;
    sxx += x * x;
    sxy += x * y;
  }
  return (count * sxy - sx * sy) / (count * sxx - sx * sx);
}

}  // namespace

TEMPLATE_TEST_CASE("advance: the impacts of a bouncing ball come at their times", "", Rk4, Rk8) {
  for (const double h : {1.0 / 3.0, 1.0 / 16.0, 1.0 / 64.0, 1.0 / 500.0}) {
    if (h > 0.1 && !TestType::long_steps) continue;
    const Ball<> m;
    Point<Ball<>> p = start_of(m);
    double expected = std::sqrt(2.0 / m.g);
    double v = m.g * expected;
    int impacts = 0;
    double worst_t = 0.0;
    double worst_v = 0.0;
    double lowest = 0.0;
    Status status = Status::ok;
    for (int tick = 0; tick * h < 3.0; ++tick) {
      const Passage r = advance<TestType>(m, p, still, h);
      status = worse(status, r.status);
      lowest = std::fmin(lowest, p.x[0]);
      for (int k = 0; k < r.events; ++k) {
        worst_t = std::fmax(worst_t, std::abs(tick * h + r.event[static_cast<std::size_t>(k)].at - expected));
        v *= m.e;
        expected += 2.0 * v / m.g;
        ++impacts;
      }
      const double now = (expected - (tick + 1) * h) * m.g - v;  // velocity at the end of the tick
      if (impacts > 0) worst_v = std::fmax(worst_v, std::abs(p.x[1] - now));
    }
    CHECK(status == Status::ok);
    CHECK(impacts == 6);
    CHECK(worst_t < 1e-12);
    CHECK(worst_v < 1e-11);
    CHECK(lowest > -1e-13);
  }
}

TEST_CASE("advance: order four through events") {
  SECTION("spring and wall, closed form") {
    const Wall<> m;
    const double T = 4.0;  // three impacts
    const double slope = order(m, T, wall_exactly(m, T));
    CHECK(slope > 3.7);
    CHECK(slope < 4.3);
  }
  SECTION("pendulum and stop, against a far finer solution") {
    const Pendulum<> m;
    const double slope = order(m, 3.0, after(m, 3.0, 30000));
    CHECK(slope > 3.7);
    CHECK(slope < 4.3);
  }
}

TEMPLATE_TEST_CASE("advance: accumulating impacts stop at the time of Zeno, and nothing passes it", "", Rk4, Rk8) {
  for (const double e : {0.3, 0.5, 0.8, 0.9}) {
    for (const double y0 : {1.0, 0.37}) {
      Ball<> m;
      m.e = e;
      const Timebase base{1.0, 500};
      Run<Ball<>> run;
      run.at = ball_at(y0, 0.0);
      const double zeno = std::sqrt(2.0 * y0 / m.g) * (1.0 + e) / (1.0 - e);
      Status status = Status::ok;
      double lowest = 0.0;
      while (usable(status) && run.tick < 10000) {
        status = step<TestType>(m, run, still, base).status;
        lowest = std::fmin(lowest, run.at.x[0]);
      }
      CHECK(status == Status::zeno);
      CHECK(run.time(base) <= zeno);
      CHECK(run.time(base) > zeno - base.dt());
      CHECK(run.ledger[Status::zeno] == 1);
      // Whoever goes on all the same comes nearer, no further, and hears of it.
      for (int i = 0; i < 1000; ++i) {
        status = step<TestType>(m, run, still, base).status;
        lowest = std::fmin(lowest, run.at.x[0]);
      }
      CHECK_FALSE(usable(status));
      CHECK(run.time(base) <= zeno + 1e-9);
      CHECK(lowest > -1e-12);
    }
  }
}

TEMPLATE_TEST_CASE("advance: a ball at rest on the floor does not sink, and does not pass for ok", "", Rk4, Rk8) {
  const Ball<> m;
  for (const double y : {0.0, -1e-18, 1e-18, 1e-300}) {
    for (const double v : {0.0, -1e-18}) {
      Point<Ball<>> p = ball_at(y, v);
      Status status = Status::ok;
      int ticks = 0;
      for (; usable(status) && ticks < 3000; ++ticks) status = advance<TestType>(m, p, still, 1.0 / 64.0).status;
      CHECK((status == Status::escaped || status == Status::zeno));
      CHECK(p.x[0] > -1e-15);
    }
  }
  // An inelastic ball that falls onto the floor.
  Ball<> clay;
  clay.e = 0.0;
  Point<Ball<>> p = ball_at(0.1, 0.0);
  Status status = Status::ok;
  for (int i = 0; usable(status) && i < 100; ++i) status = advance<TestType>(clay, p, still, 1.0 / 64.0).status;
  CHECK((status == Status::escaped || status == Status::zeno));
  CHECK(p.x[0] > -1e-15);
}

TEMPLATE_TEST_CASE("advance: a guard at zero at the start", "", Rk4, Rk8) {
  const Ball<> m;
  SECTION("and rising does not fire") {
    Point<Ball<>> p = ball_at(0.0, 1.0);
    const Passage r = advance<TestType>(m, p, still, 1.0 / 64.0);
    CHECK(r.status == Status::ok);
    CHECK(r.events == 0);
  }
  SECTION("and rising fires at its fall within the interval") {
    Point<Ball<>> p = ball_at(0.0, 1.0);
    const Passage r = advance<TestType>(m, p, still, 0.25);
    CHECK(r.status == Status::ok);
    CHECK(r.events == 1);
    CHECK(std::abs(r.event[0].at - 2.0 / m.g) < 1e-14);
  }
  SECTION("and falling fires at once") {
    for (const double y : {0.0, -1e-17}) {
      Point<Ball<>> p = ball_at(y, -1.0);
      const Passage r = advance<TestType>(m, p, still, 1.0 / 64.0);
      CHECK(r.status == Status::ok);
      CHECK(r.events == 1);
      CHECK(r.event[0].at == 0.0);
      CHECK(std::abs(p.x[1] - (m.e - m.g / 64.0)) < 1e-14);
    }
  }
  SECTION("and falling from rest has escaped: no impact is in sight") {
    Point<Ball<>> p = ball_at(0.0, 0.0);
    const Passage r = advance<TestType>(m, p, still, 1.0 / 64.0);
    CHECK(r.status == Status::escaped);
    CHECK(r.events == 0);
    CHECK(r.elapsed == 0.0);
    CHECK(p.x == Vec<2>(0.0, 0.0));
  }
}

TEMPLATE_TEST_CASE("advance: the interval is open at its start and closed at its end, so that an event counts once", "",
                   Rk4, Rk8) {
  // x' = 1, level 1: an event at every 64th tick, exactly.
  const Sawtooth<> m;
  const Timebase base{1.0, 64};
  Run<Sawtooth<>> run;
  run.at = start_of(m);
  for (int tick = 1; tick <= 640; ++tick) {
    const Passage r = step<TestType>(m, run, Vec<2>(0.0, 0.0), base);
    REQUIRE(r.status == Status::ok);
    REQUIRE(r.events == (tick % 64 == 0 ? 1 : 0));
    if (r.events == 1) {
      CHECK(r.event[0].at == base.dt());
      CHECK(run.at.x[0] == 0.0);
    }
  }
  CHECK(run.tick == 640);
}

TEMPLATE_TEST_CASE("advance: an impact within ulps of a tick is neither lost nor taken for an escape", "", Rk4, Rk8) {
  const Ball<> m;
  const double h = 1.0 / 64.0;
  int bad = 0;
  for (int k = 1; k <= 64; ++k) {
    for (int ulps = -40; ulps <= 40; ++ulps) {
      const double T = k * h;
      Point<Ball<>> p = ball_at(0.5 * m.g * T * T * (1.0 + ulps * 0x1p-52), 0.0);
      int events = 0;
      Status status = Status::ok;
      for (int i = 0; i < k + 2; ++i) {
        const Passage r = advance<TestType>(m, p, still, h);
        status = worse(status, r.status);
        if (i <= k) events += r.events;
      }
      // The short falls bounce again within the ticks that follow.
      if (status != Status::ok || events < 1 || (k > 8 && events != 1)) ++bad;
    }
  }
  CHECK(bad == 0);
}

TEMPLATE_TEST_CASE("advance: the earliest edge wins, and of simultaneous ones the one declared first", "", Rk4, Rk8) {
  const auto taken = [](double a, double b, double h) {
    Fork<> m;
    m.a = a;
    m.b = b;
    Point<Fork<>> p = start_of(m);
    for (int i = 0; i < 1000; ++i) {
      const Passage r = advance<TestType>(m, p, Vec<0>(), h);
      if (r.status != Status::ok) return -1;
      if (r.events > 0) return r.events == 1 ? r.event[0].edge : -1;
    }
    return -1;
  };
  constexpr int right = 0, up = 1;
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(0.1, 0.9);
  for (int i = 0; i < 300; ++i) {
    const double a = uniform(random);
    const double h = uniform(random) / 8.0;
    CHECK(taken(a, a, h) == right);
    CHECK(taken(a + 1e-9, a, h) == up);
    CHECK(taken(a - 1e-9, a, h) == right);
    CHECK(taken(a + 0.2, a, h) == up);
    CHECK(taken(a, a + 0.2, h) == right);
  }
  CHECK(taken(0.5, 0.5, 0.125) == right);  // both at the end of an interval
  CHECK(taken(0.75, 0.5, 1.0) == up);
}

TEMPLATE_TEST_CASE("advance: a ball in a box goes where unfolding says, through its corners too", "", Rk4, Rk8) {
  const auto unfold = [](double s) {  // the triangle wave of period 2
    s = std::abs(std::remainder(s, 2.0));
    return s;
  };
  const auto check = [&](const Vec<4>& x0, double h, int ticks) {
    const Box<> m;
    Point<Box<>> p = at<Box<>>(box::Inside{}, x0);
    int bad = 0;
    double worst = 0.0;
    int events = 0;
    for (int i = 1; i <= ticks; ++i) {
      const Passage r = advance<TestType>(m, p, Vec<0>(), h);
      bad += r.status != Status::ok;
      events += r.events;
      worst = std::fmax(worst, std::abs(p.x[0] - unfold(x0[0] + i * h * x0[2])));
      worst = std::fmax(worst, std::abs(p.x[1] - unfold(x0[1] + i * h * x0[3])));
    }
    CHECK(bad == 0);
    CHECK(worst < 1e-10);
    return events;
  };
  CHECK(check({0.3, 0.4, 0.7, -0.6}, 1.0 / 64.0, 6400) == 130);
  CHECK(check({0.3, 0.4, 5.7, -3.1}, 0.5, 200) > 800);
  for (const double v : {0.7, 0.31, 0.113, 1.0}) {
    CHECK(check({0.5, 0.5, v, v}, 1.0 / 64.0, 6400) % 2 == 0);     // along the diagonal: two edges in every corner
    CHECK(check({0.25, 0.75, v, -v}, 1.0 / 50.0, 5000) % 2 == 0);  // along the other
  }
}

TEMPLATE_TEST_CASE("advance: eight crossings in an interval are fine, a ninth is reported", "", Rk4, Rk8) {
  const auto run = [](double level) {
    Sawtooth<> m;
    m.level = level;
    Point<Sawtooth<>> p = start_of(m);
    return advance<TestType>(m, p, Vec<2>(0.0, 0.0), 1.0);
  };
  const Passage eight = run(0.12);
  CHECK(eight.status == Status::ok);
  CHECK(eight.events == 8);
  CHECK(eight.elapsed == 1.0);
  for (int i = 0; i < 8; ++i) CHECK(std::abs(eight.event[static_cast<std::size_t>(i)].at - 0.12 * (i + 1)) < 1e-14);
  const Passage last_at_end = run(0.125 - 1e-13);
  CHECK(last_at_end.status == Status::ok);
  CHECK(last_at_end.events == 8);
  const Passage nine = run(0.11);
  CHECK(nine.status == Status::zeno);
  CHECK(nine.events == 8);
  CHECK(std::abs(nine.elapsed - 0.88) < 1e-14);
}

TEMPLATE_TEST_CASE("advance: events that a clock sets on ticks are taken there, once a half turn", "", Rk4, Rk8) {
  for (int k = 0; k < 80; ++k) {
    Metronome<> m;
    m.shift = k < 64 ? 2.0 * std::numbers::pi * k / 64.0 : 0.037 * k;
    const Timebase base = timebase_of(m, 64);
    CHECK(base.sets_clock);
    Run<Metronome<>> run;
    run.tick = k < 64 ? k : 32;
    run.at = at<Metronome<>>(metronome::Tick{}, Vec<2>(1.0, base.phase(run.tick)));
    if (k >= 64 && std::sin(run.at.x[1] - m.shift) <= 0.0) run.at.chart = 1;
    int events = 0;
    Status status = Status::ok;
    bool clock_is_set = true;
    for (int i = 0; i < 6400; ++i) {
      const Passage r = step<TestType>(m, run, still, base);
      status = worse(status, r.status);
      events += r.events;
      clock_is_set = clock_is_set && run.at.x[1] == base.phase(run.tick);
    }
    CHECK(status == Status::ok);
    CHECK(std::abs(events - 200) <= 1);
    CHECK(clock_is_set);
  }
  // Where the run ends on the turn-on, the state is that of the closed form.
  const Metronome<> m;
  const Timebase base = timebase_of(m, 256);
  Run<Metronome<>> run;
  run.at = at<Metronome<>>(metronome::Tick{}, Vec<2>(1.0, 0.0));
  for (int i = 0; i < 256 * 50; ++i) step<TestType>(m, run, still, base);
  const double half = std::exp(-0.5 * m.k);
  const double kk = m.keep * m.keep;
  const double turned_on = kk * half * (m.drive / m.k) * (1.0 - half) / (1.0 - kk * half * half);
  CHECK(run.at.chart == 0);
  CHECK(std::abs(run.at.x[0] - turned_on) < 1e-11);
}

TEMPLATE_TEST_CASE("advance: an input that steps through a guard between ticks is reported", "", Rk4, Rk8) {
  const Sawtooth<> m;  // level 1, guard = 1 + u_0 - x
  const auto step_to = [&](double u_0, double u_1) {
    Point<Sawtooth<>> p = at<Sawtooth<>>(sawtooth::Ramp{}, Vec<1>(0.5));
    REQUIRE(advance<TestType>(m, p, Vec<2>(0.0, -1.0), 0.1).status == Status::ok);  // stands still, inside
    return advance<TestType>(m, p, Vec<2>(u_0, u_1), 0.1);
  };
  CHECK(step_to(-0.6, 0.0).status == Status::escaped);   // and goes further out
  CHECK(step_to(-0.6, -1.0).status == Status::escaped);  // and stays
  CHECK(step_to(-0.6, -3.0).status == Status::escaped);  // and comes back within the interval
  CHECK(step_to(-0.4, -1.0).status == Status::ok);       // still inside
  const Passage taken = step_to(-0.45, 0.0);             // inside, and out within the interval
  CHECK(taken.status == Status::ok);
  CHECK(taken.events == 1);
  CHECK(std::abs(taken.event[0].at - 0.05) < 1e-14);
}

TEMPLATE_TEST_CASE("advance: who begins behind one guard has escaped, even if another edge is met", "", Rk4, Rk8) {
  Fork<> m;
  m.a = 0.4;
  m.b = 0.5;
  for (const double x : {0.4 + 1e-10, 0.41, 0.6}) {
    Point<Fork<>> p = at<Fork<>>(fork::Plain{}, Vec<2>(x, 0.49));
    const Passage r = advance<TestType>(m, p, Vec<0>(), 1.0 / 16.0);
    CHECK(r.status == Status::escaped);
    CHECK(r.events == 0);
  }
}

TEMPLATE_TEST_CASE("advance: a guard that is nearly touched is reported, unless its chart was left before", "", Rk4,
                   Rk8) {
  // A parabola whose bottom, at half of the interval, misses the floor by 1e-8 of its scale.
  const auto graze = [](double ceiling) {
    Pit<> m;
    m.ceiling = ceiling;
    Point<Pit<>> p = at<Pit<>>(Hole{}, Vec<3>(0.125 + 1e-9, -0.5, 0.0));
    return advance<TestType>(m, p, Vec<0>(), 1.0);
  };
  CHECK(graze(9.0).status == Status::grazing);
  CHECK(graze(9.0).events == 0);
  CHECK(graze(0.6).status == Status::grazing);  // out of the chart after the bottom
  CHECK(graze(0.6).events == 1);
  CHECK(graze(0.4).status == Status::ok);  // and before it
  CHECK(graze(0.4).events == 1);
}

TEMPLATE_TEST_CASE("advance: what is not finite is reported, and the state before it kept", "", Rk4, Rk8) {
  SECTION("flow") {
    Faulty<> m;
    m.flow_ = 0.5;
    Point<Faulty<>> p = start_of(m);
    Status status = Status::ok;
    int ticks = 0;
    for (; usable(status) && ticks < 100; ++ticks) status = advance<TestType>(m, p, Vec<0>(), 0.125).status;
    CHECK(status == Status::diverged);
    CHECK(ticks == 5);
    CHECK(p.x[0] == 0.5);
  }
  SECTION("guard") {
    Faulty<> m;
    m.guard_ = 0.5;
    Point<Faulty<>> p = start_of(m);
    Status status = Status::ok;
    for (int i = 0; usable(status) && i < 100; ++i) status = advance<TestType>(m, p, Vec<0>(), 0.125).status;
    CHECK(status == Status::diverged);
    CHECK(p.x[0] == 0.5);
  }
  SECTION("reset") {
    Faulty<> m;
    m.reset_ = -1.0;
    Point<Faulty<>> p = start_of(m);
    const Passage r = advance<TestType>(m, p, Vec<0>(), 1.5);
    CHECK(r.status == Status::diverged);
    CHECK(p.x.allFinite());
  }
  SECTION("state and input") {
    const Ball<> m;
    for (const double bad : {nan_, std::numeric_limits<double>::infinity()}) {
      Point<Ball<>> p = ball_at(bad, 0.0);
      CHECK(advance<TestType>(m, p, still, 0.01).status == Status::diverged);
      p = start_of(m);
      CHECK(advance<TestType>(m, p, Vec<1>(bad), 0.01).status == Status::diverged);
      CHECK(p.x == start_of(m).x);
    }
  }
}

TEST_CASE("advance: an impossible interval or chart is refused, an empty one is nothing") {
  const Ball<> m;
  Point<Ball<>> p = start_of(m);
  CHECK(advance(m, p, still, -0.1).status == Status::failed);
  CHECK(advance(m, p, still, nan_).status == Status::failed);
  CHECK(advance(m, p, still, 0.0).status == Status::ok);
  for (const int chart : {-1, 1, 1000}) {
    p.chart = chart;
    CHECK(advance(m, p, still, 0.1).status == Status::failed);
  }
}

TEST_CASE("advance: the cost of an interval is bounded, that of an event small") {
  Counted<> m;
  m.c = 0.0;
  m.e = 1.0;
  long& calls = Counted<>::calls;
  for (const int per_second : {64, 512}) {
    const Timebase base{1.0, per_second};
    Run<Counted<>> run;
    run.at = start_of(m);
    long events = 0;
    long extra = 0;
    while (events < 100) {
      calls = 0;
      const Passage r = step(m, run, still, base);
      REQUIRE(r.status == Status::ok);
      if (r.events == 0) REQUIRE(calls == 5);
      events += r.events;
      extra += calls - 5;
    }
    CHECK(static_cast<double>(extra) / static_cast<double>(events) <= (per_second == 512 ? 12.0 : 13.0));
  }

  // Each leg makes one step, and for its edge at most one look at a dip, the polishes and the halvings.
  constexpr long leg = 5 + 3 * (1 + crossing::polishes + crossing::halvings);
  long most = 0;
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int i = 0; i < 3000; ++i) {
    Point<Counted<>> p;
    p.x = Vec<2>(-0.3 + std::pow(10.0, -8.0 * std::abs(uniform(random))), 4.0 * std::pow(uniform(random), 3));
    calls = 0;
    advance(m, p, Vec<1>(9.0 * uniform(random)), 0.2 * std::abs(uniform(random)));
    most = std::max(most, calls);
  }
  CHECK(most <= (max_crossings + 1) * leg);
}

TEMPLATE_TEST_CASE("step: a watch stops the run on its surface, and the run goes on from there", "", Rk4, Rk8) {
  // The line x = level falls through zero where the wall's mass comes from the right.
  struct Line {
    double level;
    double value(const Wall<>&, wall::Free, const Vec<2>& x, const Vec<1>&) const noexcept { return x[0] - level; }
  };
  const Wall<> m;
  const Timebase base{1.0, 100};
  const Line line{0.25};
  Run<Wall<>> watched;
  watched.at = start_of(m);
  Passage r;
  do {
    r = step<TestType>(m, watched, still, base, line);
    REQUIRE(r.status == Status::ok);
  } while (!r.met && watched.tick < 100);
  CHECK(std::abs(watched.time(base) - std::acos(0.25) / m.w) < 1e-8);
  CHECK(watched.at.x[0] <= 0.25);
  CHECK(watched.at.x[0] > 0.25 - 1e-13);
  CHECK(watched.into > 0.0);
  CHECK(watched.into < base.dt());
  // The surface just met is not met again at once, and the tick ends where it would have.
  r = step<TestType>(m, watched, still, base, line);
  CHECK(r.status == Status::ok);
  CHECK_FALSE(r.met);
  CHECK(watched.into == 0.0);
  Run<Wall<>> plain;
  plain.at = start_of(m);
  while (plain.tick < watched.tick) step<TestType>(m, plain, still, base);
  CHECK((plain.at.x - watched.at.x).norm() < 1e-9);
  CHECK(watched.ledger[Status::ok] == watched.tick + 1);

  SECTION("met at the end of a tick, the run stands on the grid") {
    struct Level {
      double value(const Sawtooth<>&, sawtooth::Ramp, const Vec<1>& x, const Vec<2>&) const noexcept {
        return 0.5 - x[0];
      }
    };
    const Sawtooth<> saw;
    Run<Sawtooth<>> run;
    run.at = start_of(saw);
    const Timebase eighths{1.0, 8};
    int ticks = 0;
    do {
      r = step<TestType>(saw, run, Vec<2>(0.0, 0.0), eighths, Level{});
      ++ticks;
    } while (!r.met && ticks < 100);
    CHECK(ticks == 4);
    CHECK(run.tick == 4);
    CHECK(run.into == 0.0);
  }
  SECTION("met together with an edge, the state is the one before the reset, which follows at once") {
    struct AtWall {
      double value(const Wall<>& w, wall::Free, const Vec<2>& x, const Vec<1>& u) const noexcept {
        return w.guard(wall::Hit{}, x, u);
      }
    };
    Run<Wall<>> run;
    run.at = start_of(m);
    do r = step<TestType>(m, run, still, base, AtWall{});
    while (!r.met && run.tick < 1000);
    CHECK(r.met);
    CHECK(r.events == 0);
    CHECK(run.at.x[1] < 0.0);
    CHECK(std::abs(run.at.x[0] + m.d) < 1e-13);
    const double v = run.at.x[1];
    r = step<TestType>(m, run, still, base, AtWall{});
    CHECK(r.status == Status::ok);
    CHECK_FALSE(r.met);
    CHECK(r.events == 1);
    CHECK(r.event[0].at == 0.0);
    CHECK(std::abs(run.at.x[1] + m.e * v) < 0.1);
  }
}

TEST_CASE("step: nothing is allocated") {
  const std::int64_t ticks = test::counting() ? 1000000 : 20000;
  const Hopper<> m;
  const Timebase base = timebase_of(m, 512);
  Run<Hopper<>> run;
  run.at = start_of(m);
  set_clock(run.at, base, 0);
  Ball<> elastic;
  elastic.e = 1.0;
  Run<Ball<>> bouncing;
  bouncing.at = start_of(elastic);
  const test::AllocationCount allocated;
  for (std::int64_t i = 0; i < ticks; ++i) {
    step(m, run, Vec<1>(0.01), base);
    step(elastic, bouncing, still, base);
  }
  CHECK(allocated() == 0);
  CHECK(run.ledger[Status::ok] == ticks);
  CHECK(bouncing.ledger[Status::ok] == ticks);
}
