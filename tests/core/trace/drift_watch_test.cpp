#include "core/trace/drift_watch.hpp"

#include "core/orbit/orbit.hpp"
#include "core/random.hpp"
#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;

namespace {

constexpr int sections = 32;
using Watch = DriftWatch<Hopper<>, ClockPhases, sections>;
constexpr Watch::Sample noise{1e-3, 6e-3};

struct Bench {
  Hopper<> declared;
  Timebase base = timebase_of(declared, 512);
  ClockPhases family{sections};
  Run<Hopper<>> start;
  Bench() {
    LdtpOf<Hopper<>, sections> system;
    const auto orbit = find_orbit<sections>(declared, base, family, system);
    REQUIRE(orbit.status == Status::ok);
    start.at = orbit.point[0];
  }
};

// Cycles until the alarm, `most` where there was none: `machine` measured with noise, both under one random input.
std::int64_t cycles_until(Bench& bench, Watch& watch, const Hopper<>& machine, std::uint64_t seed, std::int64_t most) {
  Random random(seed);
  Run<Hopper<>> run = bench.start;
  watch.begin();
  for (std::int64_t n = 0; n < most * sections; ++n) {
    const Input<Hopper<>> u = Input<Hopper<>>::Constant(0.5 * random.normal());
    const Output<Hopper<>> y = output_at(machine, run.at, Input<Hopper<>>(Input<Hopper<>>::Zero()));
    REQUIRE(usable(watch.push(u, {y[0] + noise[0] * random.normal(), y[1] + noise[1] * random.normal()})));
    if (watch.raised()) return n / sections;
    REQUIRE(usable(to_next_section(machine, run, static_cast<int>(n % sections), u, bench.base, bench.family,
                                   [](const auto&, const auto&) {})));
  }
  return most;
}

}  // namespace

TEST_CASE("a machine that is as declared raises no alarm, whatever drives it") {
  Bench bench;
  Watch watch;
  REQUIRE(watch.configure(bench.declared, bench.base, bench.family, bench.start, noise, 1e-5, 20) == Status::ok);
  int alarms = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed)
    alarms += cycles_until(bench, watch, bench.declared, seed, 100) < 100;
  CHECK(alarms == 0);  // 0.01 are expected
}

TEST_CASE("a machine that is otherwise is found out within cycles, and where") {
  Bench bench;
  Watch watch;
  REQUIRE(watch.configure(bench.declared, bench.base, bench.family, bench.start, noise, 1e-5, 20) == Status::ok);
  Hopper<> stiffer;
  stiffer.k = 10.2;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const auto at = cycles_until(bench, watch, stiffer, seed, 200);
    CHECK(at >= 20);
    CHECK(at < 60);
    const auto d = watch.departure();
    CHECK(d.cycle == at);
    REQUIRE(d.section >= 0);
    REQUIRE(d.section < sections);
    CHECK(std::abs(d.z) > 4.0);
    // On the cycle the foot stands from 0.351 to 0.516 of it.
    const double phase = static_cast<double>(d.section) / sections;
    if (phase > 0.40 && phase < 0.48) CHECK(d.chart == 1);
    if (phase < 0.30 || phase > 0.60) CHECK(d.chart == 0);
  }
}

TEST_CASE("the watch allocates nothing, keeps missing measurements out, and refuses misuse") {
  Bench bench;
  Watch watch;
  CHECK(watch.push(Input<Hopper<>>::Zero(), {0.0, 0.0}) == Status::failed);
  CHECK(watch.configure(bench.declared, bench.base, bench.family, bench.start, {0.0, 1.0}, 1e-5, 20) == Status::failed);
  CHECK(watch.configure(bench.declared, bench.base, bench.family, bench.start, noise, 1e-5, -1) == Status::failed);
  REQUIRE(watch.configure(bench.declared, bench.base, bench.family, bench.start, noise, 1e-5, 0) == Status::ok);
  const Output<Hopper<>> y = output_at(bench.declared, bench.start.at, Input<Hopper<>>(Input<Hopper<>>::Zero()));
  CHECK(watch.push(Input<Hopper<>>::Zero(), {std::nan(""), y[1]}) == Status::missing);
  const test::AllocationCount allocated;
  for (int n = 0; n < 10 * sections; ++n) watch.push(Input<Hopper<>>::Zero(), {y[0], y[1]});
  CHECK(allocated() == 0);
  // An input that throws the model out of its numbers is said, and stays said.
  CHECK_FALSE(usable(watch.push(Input<Hopper<>>::Constant(std::nan("")), {y[0], y[1]})));
  CHECK_FALSE(usable(watch.push(Input<Hopper<>>::Zero(), {y[0], y[1]})));
}
