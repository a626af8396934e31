#include "core/orbit/assumptions.hpp"

#include "tests/support/catch.hpp"
#include "tests/support/strobe.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;
using worlds::Strobe;

TEST_CASE("Definition 4: the second round of a cycle is the first one again") {
  const worlds::Metronome<> m;
  Cycle<2> cycle;
  const Search s = find_cycle(m, start_of(m), 256, cycle);
  REQUIRE(s.outcome == SearchOutcome::found);
  const Periodicity r = repeat(m, s.dt, cycle);
  CHECK(r.same_order);
  CHECK(r.time < 1e-12);
  CHECK(r.state < 1e-12);
  CHECK(r.holds());

  cycle[0].leg.x1[0] += 1e-3;  // no cycle: it shows
  cycle[1].leg.x1[0] += 1e-3;
  CHECK(repeat(m, s.dt, cycle).state > 1e-5);
  CHECK_FALSE(repeat(m, s.dt, cycle).holds());
}

TEST_CASE("Definition 4: another order of events shows") {
  Strobe<> m;
  Cycle<2> cycle;
  const Search s = find_cycle(m, start_of(m), 64, cycle);
  REQUIRE(s.outcome == SearchOutcome::found);
  m.limit = 0.5;
  CHECK_FALSE(repeat(m, s.dt, cycle).same_order);
  CHECK_FALSE(repeat(m, s.dt, cycle).holds());
}

TEST_CASE("A3: the rank of a reset is constant around a guard, or it is not") {
  // D R = a (1 - 2 x): regular but at x = 1/2, where it vanishes alone.
  Strobe<> m;
  EdgeMap<2> map;
  map.edge = 0;
  map.dim = 2;
  map.x = Vec<2>(0.6, 1.0);
  const auto regular = sample_reset(m, map, 1e-3);
  CHECK(regular.points == 4);
  CHECK(regular.constant(1, 1e-6));
  CHECK(regular.constant(1));
  CHECK(regular.rounding < 1e-12);
  CHECK(regular.rounding > 1e-15);
  CHECK(std::abs(regular.margin(1) * regular.rounding - 2.5 * (2.0 * (0.6 - 1.6e-3) - 1.0)) < 1e-12);  // the smallest
  CHECK(std::abs(regular.most[0] - 2.5 * (2.0 * (0.6 + 1.6e-3) - 1.0)) < 1e-12);  // the largest is where x is
  CHECK(regular.most[1] < 1e-15);  // along the guard there is one direction
  map.x = Vec<2>(0.5, 1.0);
  const auto singular = sample_reset(m, map, 1e-3);
  CHECK_FALSE(singular.constant(0, 1e-6));
  CHECK_FALSE(singular.constant(1, 1e-6));
  CHECK_FALSE(singular.constant(0));
  map.edge = 1;  // Over halves x, wherever: constant
  map.x = Vec<2>(10.0, 1.0);
  CHECK(sample_reset(m, map, 1e-3).constant(1, 1e-6));
}
