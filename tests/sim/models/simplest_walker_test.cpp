#include "sim/models/simplest_walker.hpp"

#include <cmath>
#include <numbers>

#include "tests/support/laws.hpp"
#include "tests/support/orbit_laws.hpp"

using namespace saltus;
using test::cycle_of;
using test::followed;
using test::has_multipliers;
using test::has_state;

namespace {

using simplest_walker::Swing;

Point<SimplestWalker<>> short_start() { return at<SimplestWalker<>>(Swing{}, Vec<4>{0.194, -0.204, 0.388, -0.015}); }

// All of a state follows from where the stance leg comes down and how fast: (theta, theta', 2 theta, (1 - cos 2 theta)
// theta').
void stands(const Vec<orbit_width>& x, double theta, double rate) {
  has_state(x, 1e-9, theta, rate, 2.0 * theta, (1.0 - std::cos(2.0 * theta)) * rate);
}

SimplestWalker<> with_slope(double slope) {
  SimplestWalker<> p;
  p.slope = slope;
  return p;
}

// The short gait of another slope.
std::unique_ptr<test::FoundCycle> short_gait(double slope) {
  auto c = cycle_of(SimplestWalker<>{}, short_start());
  double reached = 0.0;
  c->search = follow_cycle(SimplestWalker<>{}, with_slope(slope), 512, c->coarse, reached);
  test::halve(with_slope(slope), *c);
  return c;
}

}  // namespace

TEST_CASE("simplest walker: keeps the laws of models and of cycles") {
  const SimplestWalker<> p;
  obeys_laws(p, 600, 29, 128);
  test::obeys_cycle_laws(p, *cycle_of(p));
}

TEST_CASE("simplest walker: the long gait is the one computed elsewhere, and stable") {
  const auto c = cycle_of(SimplestWalker<>{});
  REQUIRE(c->fine.count == 1);
  stands(c->fine[0].leg.x0, 0.200310900544, -0.199832473005);
  CHECK(std::abs(c->fine[0].leg.x0[3] + 0.015822999948) < 1e-9);
  CHECK(std::abs(c->fine.period() - 3.882463752851) < 1e-9);
  const auto& g = c->analysis.guard[0];
  has_multipliers(g.spectrum, {{-0.190099841066, 0.557598776682}, {-0.190099841066, -0.557598776682}}, 1e-8);
  CHECK(std::abs(g.spectrum.value[0]) < 1.0);
}

TEST_CASE("simplest walker: the short gait is found from beside it, and unstable") {
  const SimplestWalker<> p;
  const auto c = cycle_of(p, short_start());
  test::obeys_cycle_laws(p, *c);
  stands(c->fine[0].leg.x0, 0.193937369810, -0.203866927442);
  CHECK(std::abs(c->fine.period() - 3.096105868078) < 1e-9);
  has_multipliers(c->analysis.guard[0].spectrum, {4.003864358929, 0.459589589798}, 1e-8);
}

TEST_CASE("simplest walker: the impact forgets the swing leg: one zero is the section's, one the reset's") {
  const auto c = cycle_of(SimplestWalker<>{});
  const auto& g = c->analysis.guard[0];
  CHECK(g.rank.value == 2);
  CHECK(g.bounds == Bounds{2, 2});
  CHECK(g.zeros.section == 1);
  CHECK(g.zeros.reset == 1);
  CHECK(g.zeros.total() == 2);
  CHECK(c->analysis.edge[0].reset.value == 2);
  CHECK(c->analysis.leg[0].total.value == 3);
}

TEST_CASE("simplest walker: energy of the descent against the loss of the impact, in closed form") {
  // Point mass on a massless leg: the impact keeps cos(2 theta) of the speed; a step is 2 sin(theta) long.
  for (const bool shorter : {false, true}) {
    const SimplestWalker<> p;
    const auto c = shorter ? cycle_of(p, short_start()) : cycle_of(p);
    const double theta = -c->fine[0].x[0];
    const double before = c->fine[0].x[1];
    const double after = c->fine[0].leg.x0[1];
    CHECK(std::abs(after - std::cos(2.0 * theta) * before) < 1e-13);
    CHECK(std::abs(2.0 * std::sin(theta) * std::sin(p.slope) - 0.5 * (before * before - after * after)) < 1e-10);
  }
}

TEST_CASE("simplest walker: on gentle slopes both gaits are the asymptotic ones") {
  // Garcia, Chatterjee, Ruina & Coleman 1998: theta is 0.970956 (long) or 0.943976 (short) times the root of the slope,
  // and the short step lasts half a swing of the leg as a pendulum.
  for (const double slope : {0.002, 0.0005}) {
    const double root = std::cbrt(slope);
    const auto longer = followed(SimplestWalker<>{}, with_slope(slope));
    const auto shorter = short_gait(slope);
    CHECK(std::abs(longer->fine[0].leg.x0[0] - 0.970956 * root) < 0.4 * slope);
    CHECK(std::abs(shorter->fine[0].leg.x0[0] - 0.943976 * root) < 0.4 * slope);
    CHECK(std::abs(longer->fine.period() - 3.812092) < 1.7 * root * root);
    CHECK(std::abs(shorter->fine.period() - std::numbers::pi) < 1.7 * root * root);
  }
}

TEST_CASE("simplest walker: from a slope of 0.0151 on the long gait is unstable, and its period doubles") {
  const auto largest = [](double slope) {
    return followed(SimplestWalker<>{}, with_slope(slope))->analysis.guard[0].spectrum.value[0];
  };
  CHECK(largest(0.0150).real() > -1.0);
  CHECK(largest(0.0152).real() < -1.0);
  const SimplestWalker<> p = with_slope(0.0152);
  const auto two = cycle_of(p, start_of(p), 512, 2);
  REQUIRE(two->fine.count == 2);
  CHECK_FALSE(is_repeated<SimplestWalker<>>(two->fine));
  test::obeys_cycle_laws(p, *two);
  CHECK(std::abs(two->analysis.guard[0].spectrum.value[0]) < 1.0);
}

TEST_CASE("simplest walker: states and multipliers are of fourth order, with the impact inside a step") {
  const test::Halved ratio = test::halved(SimplestWalker<>{}, 128);
  INFO("states " << ratio.states << ", multipliers " << ratio.multipliers);
  CHECK(std::abs(ratio.states - 16.0) < 2.0);
  CHECK(std::abs(ratio.multipliers - 16.0) < 2.5);
}

TEST_CASE("simplest walker: pushed too little or the wrong way it falls back, and uphill it has no gait") {
  const SimplestWalker<> p;
  WideCycle cycle;
  const auto search = [&](const Vec<4>& x) {
    return find_cycle(p, at<SimplestWalker<>>(Swing{}, x), 512, cycle).outcome;
  };
  CHECK(search({0.2, -0.15, 0.4, -0.016}) == SearchOutcome::fell);
  CHECK(search({0.2, 0.2, 0.4, -0.016}) == SearchOutcome::fell);
  REQUIRE(find_cycle(p, start_of(p), 512, cycle).outcome == SearchOutcome::found);
  double reached = 0.0;
  CHECK(follow_cycle(p, with_slope(-0.001), 512, cycle, reached).outcome != SearchOutcome::found);
  CHECK(reached > 0.5);
  CHECK(reached < 0.91);
  CHECK(followed(p, with_slope(0.0))->analysis.doubt == Doubt::not_isolated);  // the last one of no length at all
}
