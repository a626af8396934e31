#include "sim/models/compass_gait.hpp"

#include <cmath>
#include <numbers>

#include "tests/support/chain.hpp"
#include "tests/support/laws.hpp"
#include "tests/support/malloc_guard.hpp"
#include "tests/support/orbit_laws.hpp"

using namespace saltus;
using test::angular_momentum;
using test::cycle_of;
using test::followed;
using test::has_multipliers;
using test::has_state;
using test::kinetic_energy;
using test::Masses;
using test::Moving;
using test::torque;

namespace {

using compass_gait::Impact;
using compass_gait::Swing;

const std::vector<Complex> long_gait{
    {-0.199726126830, 0.544476062095}, {-0.199726126830, -0.544476062095}, 0.131572624077};

Point<CompassGait<>> from(const Vec<4>& x) { return at<CompassGait<>>(Swing{}, x); }

struct Walker {
  Moving hip, foot;  // of the swing leg
  Masses stance, swing;

  Masses all() const { return {stance[0], stance[1], swing[0]}; }
};
// From the stance foot at `pivot`; x axis up the slope's direction, level.
Walker walker(const CompassGait<>& p, const Vec<4>& x, const Vec<2>& z = Vec<2>::Zero(), const Moving& pivot = {}) {
  Walker r;
  r.hip = pivot.along(p.a + p.b, x[1], x[3], z[1]);
  r.foot = r.hip.along(-p.a - p.b, x[0], x[2], z[0]);
  r.stance = {{p.leg_mass, pivot.along(p.a, x[1], x[3], z[1])}, {p.hip_mass, r.hip}};
  r.swing = {{p.leg_mass, r.hip.along(-p.b, x[0], x[2], z[0])}};
  return r;
}

// Weight times descent of a step, less what its impact takes; all in [J].
double surplus(const CompassGait<>& p, const WideCycle& cycle) {
  const Walker before = walker(p, cycle[0].x.head<4>());
  const Walker after = walker(p, cycle[0].leg.x0.head<4>());
  const double weight = (p.hip_mass + 2.0 * p.leg_mass) * p.g;
  return -weight * before.foot.r[1] - (kinetic_energy(before.all()) - kinetic_energy(after.all()));
}

CompassGait<> with_slope(double degrees) {
  CompassGait<> p;
  p.slope = degrees / 180.0 * std::numbers::pi;
  return p;
}

}  // namespace

TEST_CASE("compass gait: keeps the laws of models and of cycles") {
  const CompassGait<> p;
  obeys_laws(p, 400, 19, 256);
  test::obeys_cycle_laws(p, *cycle_of(p));
}

TEST_CASE("compass gait: the long gait is the one computed elsewhere, and stable") {
  const auto c = cycle_of(CompassGait<>{});
  REQUIRE(c->fine.count == 1);
  has_state(c->fine[0].leg.x0, 1e-9, -0.323388558059, 0.218668802939, -0.377181558403, -1.091826677490);
  CHECK(std::abs(c->fine.period() - 0.734720962155) < 1e-9);
  const auto& g = c->analysis.guard[0];
  has_multipliers(g.spectrum, long_gait, 1e-8);
  CHECK(std::abs(g.spectrum.value[0]) < 1.0);
  // Theorem 3, for one chart and one edge: the reset has full rank on the guard, and so has the return map.
  CHECK(g.rank.value == 3);
  CHECK(g.bounds == Bounds{3, 3});
  CHECK(g.zeros.section == 1);
  CHECK(g.zeros.total() == 1);
  CHECK(c->analysis.edge[0].reset.value == 3);
  CHECK(c->analysis.edge[0].rank.transverse);
}

TEST_CASE("compass gait: the short gait is found from beside it, and unstable") {
  const CompassGait<> p;
  const auto c = cycle_of(p, from({-0.31, 0.205, -0.71, -1.21}));
  test::obeys_cycle_laws(p, *c);
  CHECK(c->fine.period() < 0.6);
  CHECK(c->analysis.guard[0].spectrum.value[0].real() > 4.0);
  CHECK(std::abs(surplus(p, c->fine)) < 1e-9);

  // It is there: it repeats itself for some steps, while a thousandth beside it grows by the multiplier each step.
  const double mu = c->analysis.guard[0].spectrum.value[0].real();
  const auto after = [&](const Vec<4>& start, int steps) {
    Vec<4> x = start;
    for (int i = 0; i < steps; ++i) {
      const auto leg = follow_leg<4>(p, from(x), c->search.dt / 2.0, 10.0, false);
      REQUIRE(leg.end == Leg<4>::End::edge);
      x = p.reset(Impact{}, leg.x1, Vec<0>{});
    }
    return x;
  };
  const Vec<4> cycle = c->fine[0].leg.x0.head<4>();
  CHECK((after(cycle, 4) - cycle).norm() < 1e-8);
  const Vec<4> beside = after(cycle + 1e-7 * Vec<4>::UnitX(), 4) - cycle;
  const Vec<4> later = after(cycle + 1e-7 * Vec<4>::UnitX(), 5) - cycle;
  CHECK(std::abs(later.norm() / beside.norm() - mu) < 1e-2 * mu);
}

TEST_CASE("compass gait: a step gains by its descent what its impact takes") {
  for (const double slope : {3.0, 2.0}) {
    const CompassGait<> p = with_slope(slope);
    const auto c = followed(CompassGait<>{}, p);
    CHECK(std::abs(surplus(p, c->fine)) < 1e-9);
    if (slope != 3.0) continue;
    const Vec<2> foot = walker(p, c->fine[0].x.head<4>()).foot.r;
    CHECK(std::abs(foot.norm() - 0.5354454154300082) < 1e-9);
    CHECK(std::abs(foot[1] + foot.norm() * std::sin(p.slope)) < 1e-12);  // it stands on the slope
  }
}

TEST_CASE("compass gait: its equations are Newton's law of three masses") {
  CompassGait<> p;
  p.leg_mass = 4.0;
  p.a = 0.6;
  const Vec<2> gravity{0.0, -p.g};
  const Vec<4> x{-0.31, 0.17, 0.8, -1.2};
  const Vec<4> f = p.flow(Swing{}, x, Vec<0>{});
  CHECK(f.head<2>() == x.tail<2>());
  const Walker w = walker(p, x, f.tail<2>());
  CHECK(std::abs(torque(w.all(), Vec<2>::Zero(), gravity)) < 1e-11);
  CHECK(std::abs(torque(w.swing, w.hip.r, gravity)) < 1e-11);

  // At the impact: of all about the new foot, and of the old stance leg about the hip.
  const Vec<4> y{0.2187, -0.3234, -1.8, -1.5};
  const Walker before = walker(p, y);
  Moving pivot;
  pivot.r = before.foot.r;
  const Walker after = walker(p, p.reset(Impact{}, y, Vec<0>{}), Vec<2>::Zero(), pivot);
  CHECK((after.hip.r - before.hip.r).norm() < 1e-15);
  CHECK(after.foot.r.norm() < 1e-15);
  CHECK(std::abs(angular_momentum(before.all(), pivot.r) - angular_momentum(after.all(), pivot.r)) < 1e-12);
  CHECK(std::abs(angular_momentum({before.stance[0]}, before.hip.r) - angular_momentum(after.swing, after.hip.r)) <
        1e-12);
}

TEST_CASE("compass gait: with its mass at hip and feet it is the point-foot walker of the literature") {
  // Hip 1000 times as heavy as a foot, as published with 13 digits for the simplest walker's program.
  CompassGait<> p;
  p.hip_mass = 1000.0;
  p.leg_mass = 1.0;
  p.a = 0.0;
  p.b = 1.0;
  p.g = 1.0;
  p.slope = 0.009;
  const auto c = cycle_of(p, from({-0.209, 0.191, -0.184, -0.2}));
  const auto& x = c->fine[0].leg.x0;
  CHECK(std::abs(x[1] + p.slope - 0.20016107216975) < 1e-9);
  CHECK(std::abs(x[3] - -0.199906060087682) < 1e-9);
  CHECK(std::abs(x[1] - x[0] - 0.400322144339512) < 1e-9);
  CHECK(std::abs(x[3] - x[2] - -0.015805473227965) < 1e-9);
  CHECK(std::abs(c->fine.period() - 3.88194000127684) < 1e-8);
  // The foot's mass acts through the hip alone: where the leg came from is forgotten.
  has_multipliers(c->analysis.guard[0].spectrum,
                  {{-0.1966681781285728, 0.5447267742249542}, {-0.1966681781285728, -0.5447267742249542}}, 1e-7);
  CHECK(c->analysis.guard[0].rank.value == 2);
  CHECK(c->analysis.guard[0].zeros.section == 1);
  CHECK(c->analysis.guard[0].zeros.reset == 1);
}

TEST_CASE("compass gait: on steep slopes every other step is the same, and two steps are one cycle") {
  // Goswami, Thuilot & Espiau 1996: the period doubles between 4 and 5 degrees.
  const auto largest = [](double degrees) {
    return followed(CompassGait<>{}, with_slope(degrees))->analysis.guard[0].spectrum.value[0].real();
  };
  CHECK(largest(4.35) > -1.0);
  CHECK(largest(4.45) < -1.0);
  const CompassGait<> p = with_slope(4.5);
  const auto two = cycle_of(p, start_of(p), 512, 2);
  REQUIRE(two->fine.count == 2);
  CHECK_FALSE(is_repeated<CompassGait<>>(two->fine));
  test::obeys_cycle_laws(p, *two);
  CHECK(std::abs(two->analysis.guard[0].spectrum.value[0]) < 1.0);
  CHECK(std::abs(two->fine[0].leg.duration - two->fine[1].leg.duration) > 1e-2);
}

TEST_CASE("compass gait: in other units it is the same walker") {
  CompassGait<> p;
  p.hip_mass *= 3.0;
  p.leg_mass *= 3.0;
  p.a *= 0.81;
  p.b *= 0.81;
  const auto c = followed(CompassGait<>{}, p);
  CHECK(std::abs(c->fine.period() - 0.9 * 0.734720962155) < 1e-9);
  has_multipliers(c->analysis.guard[0].spectrum, long_gait, 1e-8);
  // And gravity is a unit of time alone.
  CompassGait<> heavier;
  heavier.g = 9.81;
  CHECK(std::abs(followed(CompassGait<>{}, heavier)->fine.period() - 0.7343463911587184) < 1e-9);
}

TEST_CASE("compass gait: states and multipliers are of fourth order, with the impact inside a step") {
  const test::Halved ratio = test::halved(CompassGait<>{}, 384);
  INFO("states " << ratio.states << ", multipliers " << ratio.multipliers);
  CHECK(std::abs(ratio.states - 16.0) < 2.0);
  CHECK(std::abs(ratio.multipliers - 16.0) < 2.0);
}

TEST_CASE("compass gait: one that falls, or never takes a step, is not a cycle") {
  const CompassGait<> p;
  WideCycle cycle;
  const auto search = [&](const Vec<4>& x) { return find_cycle(p, from(x), 512, cycle).outcome; };
  CHECK(search({-0.32, 0.22, -0.4, 0.3}) == SearchOutcome::fell);  // backwards
  CHECK(search({0.2, 0.2, 0.0, 0.0}) != SearchOutcome::found);
  // Legs together it stands still, or trembles on the spot: events without end, but no cycle.
  for (const double slower : {0.9, 0.95}) {
    Vec<4> x = start_of(p).x;
    x.tail<2>() *= slower;
    INFO(slower);
    const SearchOutcome outcome = search(x);
    CHECK((outcome != SearchOutcome::found || cycle.period() > 0.5));
  }
}

TEST_CASE("compass gait: on level ground no gait is left, and what rounding makes of it is a doubt") {
  const auto c = followed(CompassGait<>{}, with_slope(0.0));
  CHECK(std::abs(c->fine[0].x[0]) < 1e-4);
  CHECK(c->analysis.doubt == Doubt::not_isolated);
}

TEST_CASE("compass gait: its search does not allocate") {
  const CompassGait<> p;
  WideCycle cycle;
  const test::AllocationCount allocated;
  const Search s = find_cycle(p, start_of(p), 256, cycle);
  CHECK(allocated() == 0);
  CHECK(s.outcome == SearchOutcome::found);
}
