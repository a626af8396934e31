#include "sim/coverage.hpp"

#include <cmath>

#include "sim/models/hopper_orbit.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

// The sixteen-cycle stimulus keeps this small; `saltus coverage` plays the whole campaign a thousand times.
Coverage small(const auto& family, double colour, int trials) {
  PlanOptions p;
  p.period = 16;
  p.amplitude = 0.02;
  CoverageOptions o;
  o.trials = trials;
  o.colour = colour;
  o.noise = {1e-3, 6e-3};
  return cover(Hopper<>{}, family, make_plan(p), o);
}

}  // namespace

namespace {

// Of 60 campaigns 57 +- 1.7 ellipses hold the multiplier: fewer than 52 or more than 60 are 3 standard errors off. The
// rate of 60 x 140 x 7 x 2 lines is known to 0.06 %; the rest of what is allowed is for noise that differs among the
// lines whose repeats are pooled. The root of the mean of 60 squared complex errors is known to 6.5 %.
void promises_are_kept(const Coverage& r, double pooled) {
  CHECK(r.failed == 0);
  REQUIRE(r.lines == 60 * 140 * 7 * 2);
  CHECK(std::abs(r.line_rate() - 0.95) < 0.002 + pooled);
  REQUIRE(r.multipliers == 60);
  CHECK(r.multipliers_inside >= 52);
  CHECK(std::abs(r.error / r.sigma - 1.0) < 0.2);
}

}  // namespace

TEST_CASE("intervals hold the truth as often as they promise: isochrons, white noise", "[coverage]") {
  promises_are_kept(small(ClockPhases{32}, 0.0, 60), 0.0);
}

TEST_CASE("intervals hold the truth as often as they promise: kinematic, coloured noise", "[coverage]") {
  promises_are_kept(small(KinematicPhases{32}, 0.7, 60), 0.006);
}

TEST_CASE("intervals hold the truth as often as they promise: isochrons, process noise", "[coverage]") {
  // A stimulus twenty times as long as the machine remembers, for the noise of one period is to know none of the
  // next's.
  PlanOptions p;
  p.band = 2.0;
  CoverageOptions o;
  o.trials = 30;
  o.noise = {3e-4, 2e-3};
  o.process = 0.03;  // [N]
  const Coverage r = cover(Hopper<>{}, ClockPhases{32}, make_plan(p), o);
  CHECK(r.failed == 0);
  REQUIRE(r.lines == 30 * 124 * 7 * 2);
  // Errors of the fourteen estimates of a line go together: as if there were half as many, at least.
  CHECK(std::abs(r.line_rate() - 0.95) < 0.015);
  REQUIRE(r.multipliers == 30);
  CHECK(r.multipliers_inside >= 25);  // 28.5 +- 1.2
  CHECK(std::abs(r.error / r.sigma - 1.0) < 0.25);
}

TEST_CASE("coloured noise keeps its variance and its correlation", "[coverage]") {
  ColouredNoise source(0.8, 3);
  double last = source(), square = 0.0, lagged = 0.0;
  constexpr int n = 200000;
  for (int i = 0; i < n; ++i) {
    const double x = source();
    square += x * x / n;
    lagged += x * last / n;
    last = x;
  }
  CHECK(std::abs(square - 1.0) < 0.03);
  CHECK(std::abs(lagged - 0.8) < 0.03);
}
