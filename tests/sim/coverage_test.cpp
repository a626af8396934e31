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

TEST_CASE("intervals of lines and multipliers hold the truth as often as they promise", "[coverage]") {
  const Coverage white = small(ClockPhases{32}, 0.0, 12);
  CHECK(white.failed == 0);
  REQUIRE(white.lines == 12 * 140 * 3 * 2);
  CHECK(std::abs(white.line_rate() - 0.95) < 0.02);
  CHECK(white.multipliers == 12);
  CHECK(white.multipliers_inside >= 9);
  CHECK(white.error < 2.0 * white.sigma);

  const Coverage coloured = small(KinematicPhases{32}, 0.7, 4);
  CHECK(coloured.failed == 0);
  CHECK(std::abs(coloured.line_rate() - 0.95) < 0.03);
  CHECK(coloured.multipliers_inside >= 2);
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
