#include "sim/models/hopper.hpp"

#include <cmath>

#include "core/flow/advance.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/laws.hpp"

using namespace saltus;

namespace {

const Vec<5> flight(1.7, -1.1, 0.8, 0.4, -0.6);
const Vec<3> stance(1.9, 0.7, 2.9);
const Vec<1> u(0.25);

}  // namespace

TEST_CASE("hopper: keeps the laws of models") {
  obeys_laws(Hopper<>{}, 1024, 13, 256);
  Hopper<> other;
  other.m = 0.8;
  other.M = 2.2;
  other.omega = 5.9;
  other.l0 = 1.9;
  obeys_laws(other, 1024, 13, 256);
}

TEST_CASE("hopper: the equations of motion, written another way") {
  const Hopper<> p;
  // Newton's law for each mass: the leg pushes them apart, the drag of the lower one is against the world.
  const double leg = 10.0 * (2.0 - (1.7 - 0.4)) + 20.0 * std::sin(0.8);
  const Vec<5> f = p.flow(hopper::Flight{}, flight, u);
  CHECK(f[0] == -1.1);
  CHECK(std::abs(2.0 * f[1] - (leg - 2.0 * 2.0 + 0.25)) < 1e-14);
  CHECK(f[2] == 2.0 * std::numbers::pi);
  CHECK(f[3] == -0.6);
  CHECK(std::abs(1.0 * f[4] - (-leg - 1.0 * 2.0 + 5.0 * 0.6)) < 1e-14);
  // In stance the lower mass rests on the ground; its weight and the leg's force are what the ground bears.
  const double standing = 10.0 * (2.0 - 1.9) + 20.0 * std::sin(2.9);
  const Vec<3> s = p.flow(hopper::Stance{}, stance, u);
  CHECK(s[0] == 0.7);
  CHECK(std::abs(2.0 * s[1] - (standing - 2.0 * 2.0 + 0.25)) < 1e-14);
  CHECK(std::abs(p.guard(hopper::Liftoff{}, stance, u) - (standing + 1.0 * 2.0)) < 1e-14);
  CHECK(p.guard(hopper::Touchdown{}, flight, u) == 0.4);
  // At liftoff the lower mass starts from rest, and what the ground bore is what accelerates it: zero.
  const Vec<5> lifted = p.reset(hopper::Liftoff{}, stance, u);
  CHECK(lifted == Vec<5>(1.9, 0.7, 2.9, 0.0, 0.0));
  CHECK(std::abs(p.flow(hopper::Flight{}, lifted, u)[4] + p.guard(hopper::Liftoff{}, stance, u)) < 1e-13);
  CHECK(p.reset(hopper::Touchdown{}, flight, u) == flight.head<3>());
  CHECK(p.output(hopper::Flight{}, flight, u) == Vec<2>(1.7, -1.1));
  CHECK(p.output(hopper::Stance{}, stance, u) == Vec<2>(1.9, 0.7));
}

TEST_CASE("hopper: a force between two masses conserves momentum, one on a mass changes it by that force") {
  const Hopper<> p;
  const auto momentum = [&](const Vec<5>& rate) { return p.M * rate[1] + p.m * rate[4]; };
  CHECK(std::abs(momentum(p.port(hopper::Leg{}, hopper::Flight{}, flight).per_force)) < 1e-15);
  CHECK(momentum(p.port(hopper::Body{}, hopper::Flight{}, flight).per_force) == 1.0);
  CHECK(momentum(p.port(hopper::Foot{}, hopper::Flight{}, flight).per_force) == 1.0);
}

TEST_CASE("hopper: the rate of a port is that of its displacement, and a force works along it") {
  const Hopper<> p;
  const auto check_port = [&](auto port, auto chart, const auto& x) {
    using C = decltype(chart);
    const Vec<C::dim> f = p.flow(chart, x, u);
    const double h = 1e-6;
    const auto motion = p.port(port, chart, x);
    const double forth = p.port(port, chart, Vec<C::dim>(x + h * f)).displacement;
    const double back = p.port(port, chart, Vec<C::dim>(x - h * f)).displacement;
    CHECK(std::abs((forth - back) / (2.0 * h) - motion.rate) < 1e-8);
    // Power of a unit force: the change of kinetic energy that it makes.
    double power = p.M * x[1] * motion.per_force[1];
    if constexpr (C::dim == 5) power += p.m * x[4] * motion.per_force[4];
    CHECK(std::abs(power - motion.rate) < 1e-14);
  };
  check_port(hopper::Body{}, hopper::Flight{}, flight);
  check_port(hopper::Leg{}, hopper::Flight{}, flight);
  check_port(hopper::Foot{}, hopper::Flight{}, flight);
  check_port(hopper::Body{}, hopper::Stance{}, stance);
  check_port(hopper::Leg{}, hopper::Stance{}, stance);
}

TEST_CASE("hopper: hops for five thousand cycles, and the last is the first") {
  const Hopper<> p;
  const Timebase base = timebase_of(p, 64);
  CHECK(base.period == 1.0);
  Run<Hopper<>> run;
  run.at = start_of(p);
  set_clock(run.at, base, 0);
  const auto turns = [&](int n) {
    int events = 0;
    for (int i = 0; i < 64 * n; ++i) events += step(p, run, Vec<1>(0.0), base).events;
    return events;
  };
  turns(100);
  const Vec<5> settled = run.at.x;
  CHECK(turns(4900) == 2 * 4900);
  CHECK((run.at.x - settled).norm() < 1e-12);
  CHECK(run.ledger[Status::ok] == 64 * 5000);
  CHECK(run.time(base) == 5000.0);
}
