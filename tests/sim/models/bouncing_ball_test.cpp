#include "sim/models/bouncing_ball.hpp"

#include <cmath>
#include <numbers>

#include "tests/support/laws.hpp"
#include "tests/support/orbit_laws.hpp"

using namespace saltus;
using test::cycle_of;
using test::followed;
using test::has_multipliers;

namespace {

// The bounce once a turn in closed form: the ball leaves at v = g T / 2 and comes back at -v, so that the table's speed
// at the impact is v (1 - e) / (1 + e).
struct Bounce {
  double phase, speed;
};
Bounce bounce(const BouncingBall<>& p) {
  const double turn = 2.0 * std::numbers::pi / p.omega;
  const double v = p.g * turn / 2.0;
  const double table = v * (1.0 - p.e) / (1.0 + p.e);
  return {std::acos(table / (p.A * p.omega)), v};
}

// Multipliers of the map of (time of impact, speed after it), by the implicit function theorem.
std::array<Complex, 2> multipliers_in_closed_form(const BouncingBall<>& p) {
  const Bounce b = bounce(p);
  const double turn = 2.0 * std::numbers::pi / p.omega;
  const double s1 = p.A * p.omega * std::cos(b.phase);             // the table's speed
  const double s2 = -p.A * p.omega * p.omega * std::sin(b.phase);  // and acceleration
  // s(t0) + w (t1 - t0) - g (t1 - t0)^2 / 2 - s(t1) = 0
  const double by_t0 = s1 - b.speed + p.g * turn;
  const double by_w = turn;
  const double by_t1 = b.speed - p.g * turn - s1;
  const double t_t = -by_t0 / by_t1;
  const double t_w = -by_w / by_t1;
  // w1 = (1 + e) s'(t1) - e (w - g (t1 - t0))
  const double slope = (1.0 + p.e) * s2 + p.e * p.g;
  const double w_t = slope * t_t - p.e * p.g;
  const double w_w = slope * t_w - p.e;
  const double trace = t_t + w_w;
  const double det = t_t * w_w - t_w * w_t;
  const Complex root = std::sqrt(Complex(trace * trace / 4.0 - det));
  return {trace / 2.0 + root, trace / 2.0 - root};
}

}  // namespace

TEST_CASE("bouncing ball: keeps the laws of models") { obeys_laws(BouncingBall<>{}, 1024, 13, 256); }

TEST_CASE("bouncing ball: bounces once a turn, where the closed form says, with its multipliers") {
  for (const double amplitude : {0.112, 0.115, 0.13}) {
    BouncingBall<> p;
    p.A = amplitude;
    const auto c = followed(BouncingBall<>{}, p);
    test::obeys_cycle_laws(p, *c);
    const Bounce b = bounce(p);
    CHECK(std::abs(c->fine.period() - 1.0) < 1e-12);
    CHECK(std::abs(c->fine[0].x[1] + b.speed) < 1e-10);
    CHECK(std::abs(std::remainder(c->fine[0].x[2] - b.phase, 2.0 * std::numbers::pi)) < 1e-10);
    const auto expected = multipliers_in_closed_form(p);
    has_multipliers(c->analysis.guard[0].spectrum, {expected[0], expected[1]}, 1e-9);
    CHECK(std::abs(std::abs(expected[0] * expected[1]) - p.e * p.e) < 1e-12);  // areas shrink by e^2
    CHECK(c->analysis.guard[0].rank.value == 2);
    CHECK(c->analysis.guard[0].bounds == Bounds{2, 2});
  }
}

TEST_CASE("bouncing ball: where the single bounce is unstable it bounces twice in two turns") {
  BouncingBall<> p;
  p.A = 0.28;
  CHECK(std::abs(multipliers_in_closed_form(p)[1]) > 1.0);
  const auto c = cycle_of(p, start_of(p), 512, 2);
  test::obeys_cycle_laws(p, *c);
  REQUIRE(c->fine.count == 2);
  CHECK(std::abs(c->fine.period() - 2.0) < 1e-11);
  CHECK_FALSE(is_repeated<BouncingBall<>>(c->fine));
  for (const auto& g : {c->analysis.guard[0], c->analysis.guard[1]}) {
    REQUIRE(g.spectrum.nonzero == 2);
    CHECK(g.rank.value == 2);
    CHECK(g.spectrum.value[0].imag() > 0.1);  // a pair, so that both moduli are the root of what areas shrink by, e^4
    for (const Complex& z : {g.spectrum.value[0], g.spectrum.value[1]})
      CHECK(std::abs(std::abs(z) - p.e * p.e) < 1e-10);
  }
}

TEST_CASE("bouncing ball: the figures told with its measured records") {
  const BouncingBall<> p;
  const auto c = cycle_of(p);
  CHECK(std::abs(bounce(p).phase / (2.0 * std::numbers::pi) - 0.1090110043) < 1e-9);
  has_multipliers(c->analysis.guard[0].spectrum, {{0.358077377766, 0.715388420044}, {0.358077377766, -0.715388420044}},
                  1e-9);
}

TEST_CASE("bouncing ball: on a table at rest the saltation matrix is the closed form") {
  BouncingBall<> p;
  p.A = 0.0;
  const double v = -3.0;  // [m/s] before the impact
  const auto s = saltation(p, bouncing_ball::Impact{}, Vec<3>{0.0, v, 0.4}, Vec<1>{0.0});
  Mat<2, 2> expected;
  expected << -p.e, 0.0, -(1.0 + p.e) * p.g / v, -p.e;
  CHECK((s.state.topLeftCorner<2, 2>() - expected).cwiseAbs().maxCoeff() < 1e-14);
  CHECK(std::abs(s.rate - v) < 1e-14);
}

TEST_CASE("bouncing ball: a force on it accelerates it by that force over its mass") {
  const BouncingBall<> p;
  const auto body = p.port(bouncing_ball::Body{}, bouncing_ball::Flight{}, Vec<3>{0.3, -1.2, 0.4});
  CHECK(body.displacement == 0.3);
  CHECK(body.rate == -1.2);
  CHECK(body.per_force == Vec<3>(0.0, 2.0, 0.0));
}
