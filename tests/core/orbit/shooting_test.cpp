#include "core/orbit/shooting.hpp"

#include <cmath>
#include <numbers>

#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"
#include "tests/support/strobe.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;
using worlds::Strobe;

namespace {

constexpr std::int64_t ticks = 64;

Point<Strobe<>> from(double x) { return at<Strobe<>>(worlds::strobe::Dark{}, Vec<2>{x, 0.0}); }
double fixed_point(double a) { return 1.0 - 1.0 / a; }

// The clock at 0.3 rad.
struct Phase {
  template <class M, class C>
  ScalarOf<M> value(const M&, C, const Vec<C::dim, ScalarOf<M>>& x, const Input<M>&) const noexcept {
    return -sin(x[1] - 0.3);
  }
};

}  // namespace

TEST_CASE("fixed points are found where the map has them, stable or not") {
  for (const double a : {2.5, 3.2, 3.9}) {  // multiplier 2 - a
    Strobe<> m;
    m.a = a;
    Cycle<2> cycle;
    const Search s = find_cycle(m, from(fixed_point(a) + 0.03), ticks, cycle);
    REQUIRE(s.outcome == SearchOutcome::found);
    CHECK(s.residual < 1e-13);
    CHECK(s.iterations < 10);
    CHECK(cycle.count == 1);
    CHECK(std::abs(cycle[0].x[0] - fixed_point(a)) < 1e-13);
    CHECK(std::abs(cycle.period() - 1.0) < 1e-13);
    CHECK(std::abs(return_map(cycle, 0)(0, 0) - (2.0 - a)) < 1e-12);
  }
}

TEST_CASE("cycles that close after several passages are found too, and a shorter one in disguise is known") {
  Strobe<> m;
  m.a = 3.2;
  Cycle<2> cycle;
  const Search s = find_cycle(m, from(0.5), ticks, cycle, 2);
  REQUIRE(s.outcome == SearchOutcome::found);
  REQUIRE(cycle.count == 2);
  const double root = std::sqrt((3.2 - 3.0) * (3.2 + 1.0));  // the 2-cycle of the logistic map
  const double x1 = (3.2 + 1.0 + root) / 6.4;
  const double x2 = (3.2 + 1.0 - root) / 6.4;
  CHECK(std::abs(std::max(cycle[0].x[0], cycle[1].x[0]) - x1) < 1e-12);
  CHECK(std::abs(std::min(cycle[0].x[0], cycle[1].x[0]) - x2) < 1e-12);
  CHECK(std::abs(return_map(cycle, 0)(0, 0) - (4.0 + 2.0 * 3.2 - 3.2 * 3.2)) < 1e-11);
  CHECK_FALSE(is_repeated<Strobe<>>(cycle));
  CHECK(std::abs(s.dt - 1.0 / ticks) < 1e-12);  // steps are counted from passage to passage, not over both

  m.a = 2.5;  // there is none: the fixed point, twice
  REQUIRE(find_cycle(m, from(0.55), ticks, cycle, 2).outcome == SearchOutcome::found);
  CHECK(is_repeated<Strobe<>>(cycle));
}

TEST_CASE("from far away a stable cycle is found by letting the transient pass") {
  Strobe<> m;
  m.a = 2.9;
  Cycle<2> cycle;
  REQUIRE(find_cycle(m, from(0.02), ticks, cycle).outcome == SearchOutcome::found);
  const double x = cycle[0].x[0];
  CHECK((std::abs(x - fixed_point(2.9)) < 1e-12 || std::abs(x) < 1e-12));  // Newton may take the unstable one, x = 0
}

TEST_CASE("every way to find no cycle has its name") {
  Strobe<> m;
  Cycle<2> cycle;
  m.never = 1.0;
  CHECK(find_cycle(m, from(0.55), ticks, cycle).outcome == SearchOutcome::no_event);
  m = Strobe<>{};
  m.height = 0.59;  // the fixed point 0.6 lies above
  CHECK(find_cycle(m, from(0.55), ticks, cycle).outcome == SearchOutcome::fell);
  m = Strobe<>{};
  m = Strobe<>{};
  m.a = 1.0;
  m.c = 0.3;  // x -> x - x^2 + 0.3: fixed points +-sqrt(0.3)
  REQUIRE(find_cycle(m, from(0.5), ticks, cycle).outcome == SearchOutcome::found);
  CHECK(std::abs(cycle[0].x[0] - std::sqrt(0.3)) < 1e-12);
  m.c = -0.1;  // none
  const Search none = find_cycle(m, from(0.5), ticks, cycle);
  CHECK(none.outcome != SearchOutcome::found);
  CHECK(none.outcome != SearchOutcome::fell);
  m = Strobe<>{};
  CHECK(find_cycle(m, start_of(m), ticks, cycle, max_cycle_events + 1).outcome == SearchOutcome::too_many);
  worlds::Ball<> ball;  // bounces accumulate at rest
  Cycle<2> rest;
  CHECK(find_cycle(ball, start_of(ball), ticks, rest).outcome != SearchOutcome::found);
}

TEST_CASE("the longest cycle has room for a section") {
  const Strobe<> m;
  Cycle<2> cycle;
  const Search s = find_cycle(m, start_of(m), ticks, cycle, max_cycle_events);
  REQUIRE(s.outcome == SearchOutcome::found);
  REQUIRE(cycle.count == max_cycle_events);
  REQUIRE(cut_leg(m, s.dt, cycle, 5, 0.4));
  CHECK(cycle.count == max_cycle_events + 1);
  CHECK(cycle[6].edge == -1);
  CHECK(std::abs(cycle.period() - max_cycle_events) < 1e-11);
  CHECK_FALSE(cut_leg(m, s.dt, cycle, 8, 0.4));  // and for one only
}

TEST_CASE("a cycle of a few steps is none: it stands still, or chatters") {
  const Strobe<> m;  // one event a second
  Cycle<2> cycle;
  REQUIRE(find_cycle(m, start_of(m), ticks, cycle).outcome == SearchOutcome::found);
  CHECK(shoot(m, 1.0 / 9.0, 8.0, cycle).outcome == SearchOutcome::found);
  CHECK(shoot(m, 1.0 / 7.0, 8.0, cycle).outcome == SearchOutcome::collapsed);
}

TEST_CASE("continuation follows a cycle through its loss of stability") {
  const Strobe<> usual;
  Strobe<> far;
  far.a = 3.9;
  Cycle<2> cycle;
  REQUIRE(find_cycle(usual, start_of(usual), ticks, cycle).outcome == SearchOutcome::found);
  double reached = 0.0;
  REQUIRE(follow_cycle(usual, far, ticks, cycle, reached).outcome == SearchOutcome::found);
  CHECK(reached == 1.0);
  CHECK(std::abs(cycle[0].x[0] - fixed_point(3.9)) < 1e-12);
}

TEST_CASE("continuation says where the order of events changes, where it falls, and where the cycle ends") {
  Cycle<2> found;
  const Strobe<> usual;
  REQUIRE(find_cycle(usual, start_of(usual), ticks, found).outcome == SearchOutcome::found);
  Strobe<> limited = usual;
  limited.limit = 0.7;
  Strobe<> far = limited;
  far.a = 3.9;  // the fixed point passes 0.7 at a = 10/3
  Cycle<2> cycle = found;
  double reached = 0.0;
  Search s = follow_cycle(limited, far, ticks, cycle, reached);
  CHECK(s.outcome == SearchOutcome::other_event);
  CHECK(s.after == 0);
  CHECK(s.expected == 0);
  CHECK(s.met == 1);
  CHECK(std::abs(reached - (10.0 / 3.0 - 2.5) / 1.4) < 2e-3);
  CHECK(std::abs(cycle[0].x[0] - 0.7) < 2e-3);  // the last one found

  Strobe<> tall = usual;
  tall.height = 0.7;
  far = tall;
  far.a = 3.9;
  cycle = found;
  s = follow_cycle(tall, far, ticks, cycle, reached);
  CHECK(s.outcome == SearchOutcome::fell);
  CHECK(std::abs(reached - (10.0 / 3.0 - 2.5) / 1.4) < 2e-3);

  // x -> x - x^2 + c has fixed points +-sqrt(c): a fold at c = 0.
  Strobe<> folding;
  folding.a = 1.0;
  folding.c = 0.3;
  far = folding;
  far.c = -0.1;
  REQUIRE(find_cycle(folding, from(0.5), ticks, cycle).outcome == SearchOutcome::found);
  s = follow_cycle(folding, far, ticks, cycle, reached);
  CHECK(s.outcome == SearchOutcome::no_convergence);
  CHECK(reached <= 0.75);
  CHECK(reached > 0.74);
}

TEST_CASE("a closed orbit without events closes on a section") {
  worlds::Metronome<> m;  // its clock's phase is a section; the events of its own are on the way
  Cycle<2> cycle;
  const double dt = 1e-3;
  Search s = first_cycle(m, start_of(m), dt, 4.0, 0, 1, cycle, Phase{});
  REQUIRE(s.outcome == SearchOutcome::found);
  REQUIRE(cycle.count == 3);
  s = shoot(m, dt, 4.0, cycle, Phase{});
  REQUIRE(s.outcome == SearchOutcome::found);
  int sections = 0;
  for (int j = 0; j < 3; ++j) sections += cycle[j].edge < 0 ? 1 : 0;
  CHECK(sections == 1);
  CHECK(std::abs(cycle.period() - 1.0) < 1e-12);
  for (int j = 0; j < 3; ++j) {  // the multiplier keep^2 e^-k is the same at the section and at both guards
    CHECK(std::abs(return_map(cycle, j).trace() - 0.81 * std::exp(-1.0)) < 1e-10);
  }
}

TEST_CASE("a search does not allocate") {
  Strobe<> m;
  Strobe<> far;
  far.a = 3.1;
  Cycle<2> cycle;
  double reached = 0.0;
  const test::AllocationCount allocated;
  const Search s = find_cycle(m, from(0.55), ticks, cycle);
  const Search t = follow_cycle(m, far, ticks, cycle, reached);
  CHECK(allocated() == 0);
  CHECK(s.outcome == SearchOutcome::found);
  CHECK(t.outcome == SearchOutcome::found);
}
