#include "core/hybrid/point.hpp"

#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;

TEST_CASE("point: coordinates beyond the chart are zero") {
  Point<Hopper<>> p = at<Hopper<>>(hopper::Flight{}, Vec<5>(1.0, 2.0, 3.0, 4.0, 5.0));
  CHECK(p.chart == 0);
  CHECK(p.in(hopper::Flight{}) == Vec<5>(1.0, 2.0, 3.0, 4.0, 5.0));
  CHECK(dim_of(p) == 5);
  p.set(hopper::Stance{}, Vec<3>(6.0, 7.0, 8.0));
  CHECK(p.chart == 1);
  CHECK(p.x == Vec<5>(6.0, 7.0, 8.0, 0.0, 0.0));
  CHECK(p.in(hopper::Stance{}) == Vec<3>(6.0, 7.0, 8.0));
  CHECK(dim_of(p) == 3);
  // Its own coordinates may be set from itself.
  p.set(hopper::Stance{}, p.in(hopper::Stance{}));
  CHECK(p.x == Vec<5>(6.0, 7.0, 8.0, 0.0, 0.0));
}

TEST_CASE("point: start, output and clock") {
  const Hopper<> m;
  const Point<Hopper<>> p = start_of(m);
  CHECK(p.chart == 0);
  CHECK(p.in(hopper::Flight{}) == m.start().x);
  CHECK(output_at(m, p, Vec<1>(0.0)) == Vec<2>(p.x[0], p.x[1]));
  CHECK(clock_index(p) == 2);
  CHECK(clock_index(start_of(worlds::Ball<>{})) == -1);
  const worlds::Sawtooth<> saw;
  CHECK(output_at(saw, start_of(saw), Vec<2>(0.7, 0.0)) == Vec<1>(0.7));  // an output that sees the input
}

TEST_CASE("point: no chart is active where the index names none") {
  Point<Hopper<>> p;
  for (const int chart : {-1, 2}) {
    p.chart = chart;
    bool visited = false;
    visit_chart(p, [&](auto) { visited = true; });
    CHECK_FALSE(visited);
    CHECK(dim_of(p) == 0);
    CHECK(clock_index(p) == -1);
  }
}
