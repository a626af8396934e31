#include "sim/rig.hpp"

#include <memory>

#include "core/orbit/orbit.hpp"
#include "hal/loopback.hpp"
#include "sim/models/hopper_orbit.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;

namespace {

constexpr int sections = 32;

// A hopper on its limit cycle, and the outputs the cycle has on each section.
template <class Family>
struct Cycle {
  Hopper<> m;
  Timebase base = timebase_of(m, 512);
  Family family;
  Orbit<Hopper<>, sections> orbit;
  Run<Hopper<>> start;

  Cycle() {
    const auto system = std::make_unique<LdtpOf<Hopper<>, sections>>();
    orbit = find_orbit<sections>(m, base, family, *system);
    REQUIRE(orbit.status == Status::ok);
    start.at = orbit.point[0];
  }
  Rig<Hopper<>, Family> rig(double height_noise = 0.0, double speed_noise = 0.0, std::uint64_t seed = 1) const {
    return {m, base, family, start, Output<Hopper<>>(height_noise, speed_noise), seed};
  }
};

template <int Nu>
Stimulus<Nu> command(std::int64_t seq, double u) {
  Stimulus<Nu> c;
  c.session = 77;
  c.seq = c.tick = seq;
  c.u[0] = u;
  return c;
}

}  // namespace

TEST_CASE("A rig answers each stimulus once, with the next tick, and is still otherwise") {
  const Cycle<ClockPhases> cycle;
  auto rig = cycle.rig();
  Loopback<Stimulus<1>, Measurement<2>, 4> wire;
  auto here = wire.experimenter();
  auto machine = wire.machine();
  const auto first = rig.greeting();
  CHECK(first.seq == -1);
  CHECK(first.tick == 0);
  CHECK(first.status == Status::ok);
  CHECK(first.y[0] == cycle.orbit.output[0][0]);
  CHECK_FALSE(rig.serve(machine));
  CHECK(rig.run().tick == 0);
  Measurement<2> y;
  CHECK_FALSE(here.try_receive(y));
  for (std::int64_t n = 0; n < 70; ++n) {
    REQUIRE(here.try_send(command<1>(n, 0.0)));
    REQUIRE(rig.serve(machine));
    REQUIRE(here.try_receive(y));
    CHECK(y.seq == n);
    CHECK(y.session == 77);
    CHECK(y.tick == n + 1);
    CHECK(y.status == Status::ok);
    CHECK_FALSE(rig.serve(machine));
    CHECK_FALSE(here.try_receive(y));
  }
}

TEMPLATE_TEST_CASE("Left alone on its cycle a rig shows the cycle, section by section", "", ClockPhases,
                   KinematicPhases) {
  const Cycle<TestType> cycle;
  auto rig = cycle.rig();
  double worst = 0.0;
  for (std::size_t n = 1; n <= 10 * sections; ++n) {
    const auto y = rig.advance(command<1>(0, 0.0));
    REQUIRE(y.status == Status::ok);
    for (std::size_t i = 0; i < 2; ++i) {
      worst = std::max(worst, std::abs(y.y[i] - cycle.orbit.output[n % sections][static_cast<int>(i)]));
    }
  }
  CHECK(worst < 1e-10);
}

TEST_CASE("Under the kinematic phase every measurement lies on its section") {
  const Cycle<KinematicPhases> cycle;
  auto rig = cycle.rig();
  double worst = 0.0;
  for (int n = 1; n <= 10 * sections; ++n) {
    const auto y = rig.advance(command<1>(0, 0.02 * std::sin(0.7 * n)));
    REQUIRE(y.status == Status::ok);
    const double angle = std::atan2(y.y[1] / 1.9, (y.y[0] - 1.9) / 0.3);  // decreases in time
    worst = std::max(worst,
                     std::abs(std::remainder(angle + 2.0 * std::numbers::pi * n / sections, 2.0 * std::numbers::pi)));
  }
  CHECK(worst < 1e-9);
}

TEST_CASE("A stimulus is held from its section to the next, and shows in the next measurement") {
  // x' = (drive or 0) - k x + u in closed form over one section without an event.
  const worlds::Metronome<> m;
  Timebase base = timebase_of(m, 512);
  Run<worlds::Metronome<>> start;
  start.at = start_of(m);
  set_clock(start.at, base, 128);  // a quarter turn: in the first half, far from both events
  start.tick = 128;
  Rig<worlds::Metronome<>, ClockPhases> rig(m, base, ClockPhases{sections}, start, Vec<1>(0.0), 1);
  double x = rig.greeting().y[0];
  const double h = 1.0 / sections;
  for (int n = 0; n < 4; ++n) {
    const double u = 0.3 * n - 0.4;
    const auto y = rig.advance(command<1>(n, u));
    x = x * std::exp(-h) + (2.0 + u) * (1.0 - std::exp(-h));
    CHECK(std::abs(y.y[0] - x) < 1e-12);
  }
}

TEST_CASE("Noise has the size asked for, is white and independent, and is told by the seed") {
  const Cycle<ClockPhases> cycle;
  constexpr int n = 20000;
  const auto noise_of = [&](double a, double b, std::uint64_t seed) {
    auto rig = cycle.rig(a, b, seed);
    std::vector<std::array<double, 2>> e;
    for (int i = 1; i <= n; ++i) {
      const auto y = rig.advance(command<1>(i, 0.0));
      const auto& clean = cycle.orbit.output[static_cast<std::size_t>(i % sections)];
      e.push_back({y.y[0] - clean[0], y.y[1] - clean[1]});
    }
    return e;
  };
  const auto e = noise_of(1e-3, 6e-3, 5);
  double mean = 0.0, square = 0.0, other = 0.0, next = 0.0, cross = 0.0;
  for (std::size_t i = 0; i < e.size(); ++i) {
    const double a = e[i][0] / 1e-3, b = e[i][1] / 6e-3;
    mean += a;
    square += a * a;
    other += b * b;
    cross += a * b;
    if (i > 0) next += a * e[i - 1][0] / 1e-3;
  }
  // Five standard errors of each mean.
  const double five = 5.0 / std::sqrt(n);
  CHECK(std::abs(mean / n) < five);
  CHECK(std::abs(square / n - 1.0) < 1.42 * five);
  CHECK(std::abs(other / n - 1.0) < 1.42 * five);
  CHECK(std::abs(cross / n) < five);
  CHECK(std::abs(next / n) < five);
  CHECK(noise_of(1e-3, 6e-3, 5) == e);
  CHECK(noise_of(1e-3, 6e-3, 6) != e);
  // No noise on an output is no noise, whatever the other has.
  for (const auto& [a, b] : noise_of(0.0, 1.0, 5)) {
    if (std::abs(a) > 1e-9) FAIL("noise on an output without any");
  }
}

TEST_CASE("Started over, a rig stands where it stood, and each experiment has noise of its own") {
  const Cycle<ClockPhases> cycle;
  auto rig = cycle.rig(1e-3, 0.0, 9);
  const auto run = [&](std::int32_t experiment) {
    std::vector<double> y{rig.start(experiment).y[0]};
    CHECK(rig.run().tick == 0);
    for (int n = 0; n < 100; ++n) y.push_back(rig.advance(command<1>(n, 0.01)).y[0]);
    return y;
  };
  const auto first = run(0), second = run(1);
  CHECK(first != second);
  CHECK(run(0) == first);
  CHECK(run(1) == second);
}

TEST_CASE("Coarse sensors give multiples of their quantum, late actuators act late") {
  const Cycle<ClockPhases> cycle;
  auto plain = cycle.rig(), coarse = cycle.rig(), late = cycle.rig();
  coarse.degrade(Output<Hopper<>>(0.01, 0.0), 0);
  late.degrade(Output<Hopper<>>(0.0, 0.0), 3);
  const auto u = [](int n) { return n < 0 ? 0.0 : 0.05 * std::cos(1.3 * n); };
  for (int n = 0; n < 100; ++n) {
    const auto y = plain.advance(command<1>(n, u(n)));
    const auto steps = coarse.advance(command<1>(n, u(n)));
    CHECK(std::abs(steps.y[0] - y.y[0]) <= 0.005 + 1e-12);
    CHECK(std::abs(steps.y[0] / 0.01 - std::round(steps.y[0] / 0.01)) < 1e-9);
    CHECK(steps.y[1] == y.y[1]);
  }
  auto shifted = cycle.rig();
  for (int n = 0; n < 100; ++n) {
    CHECK(late.advance(command<1>(n, u(n))).y == shifted.advance(command<1>(n, u(n - 3))).y);
  }
}

TEST_CASE("A machine that breaks says so in its answer") {
  const Cycle<ClockPhases> cycle;
  for (const double u : {1.7e308, std::nan("")}) {
    auto rig = cycle.rig();
    Status worst = Status::ok;
    for (int n = 0; n < 640; ++n) worst = worse(worst, rig.advance(command<1>(n, u)).status);
    CHECK_FALSE(usable(worst));
  }
}

TEST_CASE("Serving allocates nothing") {
  const Cycle<ClockPhases> clock;
  const Cycle<KinematicPhases> kinematic;
  auto a = clock.rig(1e-3, 6e-3);
  auto b = kinematic.rig(1e-3, 6e-3);
  const test::AllocationCount allocated;
  for (int n = 0; n < 2000; ++n) {
    a.advance(command<1>(n, 0.01));
    b.advance(command<1>(n, 0.01));
  }
  a.start(1);
  CHECK(allocated() == 0);
}
