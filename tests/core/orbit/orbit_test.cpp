#include "core/orbit/orbit.hpp"

#include <cmath>
#include <memory>

#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;
using namespace saltus::worlds;

namespace {

constexpr double turn = 2.0 * std::numbers::pi;

// A coordinate driven by the clock, x' = cos(clock) - x, and a guard that the orbit misses by `miss`.
struct Round : Chart<2>, Clock<1> {};
struct Touch : Edge<Round, Round> {};
template <class S = double>
struct Kiss {
  using Charts = List<Round>;
  using Edges = List<Touch>;
  using U = Vec<1, S>;
  static constexpr std::string_view name = "kiss";
  static constexpr std::array inputs{Quantity{"u", "1/s"}};
  static constexpr std::array outputs{Quantity{"x", "-"}};
  S miss = 0.1;  // [-]
  static constexpr auto parameters() { return std::array{Parameter{"miss", "-", &Kiss::miss}}; }
  Vec<2, S> flow(Round, const Vec<2, S>& x, const U& u) const noexcept { return {cos(x[1]) - x[0] + u[0], 1.0}; }
  S guard(Touch, const Vec<2, S>& x, const U&) const noexcept { return x[0] + std::sqrt(0.5) + miss; }
  Vec<2, S> reset(Touch, const Vec<2, S>& x, const U&) const noexcept { return {x[0] + 0.1, x[1]}; }
  Vec<1, S> output(Round, const Vec<2, S>& x, const U&) const noexcept { return Vec<1, S>(x[0]); }
  Start<Round, S> start() const noexcept { return {Vec<2, S>{0.5, 0.0}}; }
};
static_assert(check<Kiss<>>());

// Forty events a turn.
struct Odd : Chart<2>, Clock<1> {};
struct Even : Chart<2>, Clock<1> {};
struct ToEven : Edge<Odd, Even> {};
struct ToOdd : Edge<Even, Odd> {};
template <class S = double>
struct Rattle {
  using Charts = List<Odd, Even>;
  using Edges = List<ToEven, ToOdd>;
  using X = Vec<2, S>;
  using U = Vec<0, S>;
  static constexpr std::string_view name = "rattle";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array<Quantity, 0> outputs{};
  S beats = 20.0;  // [-]
  static constexpr auto parameters() { return std::array{Parameter{"beats", "-", &Rattle::beats}}; }
  template <class C>
  X flow(C, const X& x, const U&) const noexcept {
    return {-x[0], 1.0};
  }
  S guard(ToEven, const X& x, const U&) const noexcept { return sin(beats * (x[1] + 0.01)); }
  S guard(ToOdd, const X& x, const U&) const noexcept { return -sin(beats * (x[1] + 0.01)); }
  template <class E>
  X reset(E, const X& x, const U&) const noexcept {
    return x;
  }
  template <class C>
  Vec<0, S> output(C, const X&, const U&) const noexcept {
    return {};
  }
  Start<Odd, S> start() const noexcept { return {X{0.5, 0.0}}; }
};
static_assert(check<Rattle<>>());

template <int N, class M, class Family>
Orbit<M, N> orbit_of(const M& m, const Family& family, int ticks = 512, std::int64_t turns = 60) {
  const auto system = std::make_unique<LdtpOf<M, N>>();
  return find_orbit<N>(m, timebase_of(m, ticks), family, *system, turns);
}

// What the hopper's orbit is, whatever the sections: its two events.
template <int N>
void has_the_hoppers_events(const Orbit<Hopper<>, N>& orbit, double section_0) {
  REQUIRE(orbit.events == 2);
  CHECK(std::abs(orbit.period - 1.0) < 1e-9);
  for (int i = 0; i < 2; ++i) {
    const OrbitEvent<Hopper<>>& event = orbit.event[static_cast<std::size_t>(i)];
    const bool touchdown = event.edge == 0;
    const double t = event.t + section_0;
    const double expected = touchdown ? 0.350981787094387 : 0.516314426971245;
    CHECK(std::abs(std::remainder(t - expected, 1.0)) < 1e-9);
    CHECK(event.before.chart == (touchdown ? 0 : 1));
    CHECK(event.after.chart == (touchdown ? 1 : 0));
    CHECK(std::abs(std::remainder(event.before.x[2] - turn * expected, turn)) < 1e-8);
    CHECK(event.before.x[2] >= 0.0);
    CHECK(event.before.x[2] <= turn);
    if (touchdown) CHECK(std::abs(event.before.x[3]) < 1e-12);
    CHECK((event.before.x - event.after.x).head<3>().norm() < 1e-14);
  }
  CHECK(orbit.event[0].edge != orbit.event[1].edge);
}

}  // namespace

TEST_CASE("orbit: the hopper on its isochrons") {
  const Hopper<> m;
  const auto orbit = orbit_of<32>(m, ClockPhases{});
  REQUIRE(orbit.status == Status::ok);
  CHECK(orbit.residual < 1e-12);
  CHECK(orbit.period == 1.0);
  const Vec<5> flight(1.8561810757180, -1.9213776705096, 0.0, 0.7061913261653, 1.0822766978996);
  CHECK(orbit.point[0].chart == 0);
  CHECK((orbit.point[0].x - flight).cwiseAbs().maxCoeff() < 1e-8);
  const Vec<3> stance(1.9650403694820, 1.8756675977655, std::numbers::pi);
  CHECK(orbit.point[16].chart == 1);
  CHECK((orbit.point[16].x.head<3>() - stance).cwiseAbs().maxCoeff() < 1e-8);
  for (int n = 0; n < 32; ++n) {
    const auto i = static_cast<std::size_t>(n);
    CHECK(orbit.point[i].chart == (n >= 12 && n <= 16 ? 1 : 0));
    CHECK(orbit.point[i].x[2] == turn * n / 32.0);
    CHECK(std::abs(orbit.time[i] - n / 32.0) < 1e-13);
    CHECK(orbit.output[i] == Vec<2>(orbit.point[i].x[0], orbit.point[i].x[1]));
  }
  has_the_hoppers_events(orbit, 0.0);
}

TEST_CASE("orbit: the hopper on its kinematic phase, in the order of time") {
  const auto orbit = orbit_of<32>(Hopper<>{}, KinematicPhases{});
  REQUIRE(orbit.status == Status::ok);
  const double apex = 0.723342352151;  // [s] after clock phase 0
  CHECK(std::abs(orbit.point[0].x[2] / turn - apex) < 1e-9);
  CHECK(std::abs(orbit.point[0].x[1]) < 1e-12);
  for (int n = 0; n < 32; ++n) {
    const auto i = static_cast<std::size_t>(n);
    CHECK(orbit.point[i].chart == (n >= 21 && n <= 25 ? 1 : 0));
    CHECK(orbit.point[i].x[2] >= 0.0);
    CHECK(orbit.point[i].x[2] <= turn);
    CHECK(std::abs(std::remainder(orbit.point[i].x[2] / turn - apex - orbit.time[i], 1.0)) < 1e-9);
    if (n > 0) CHECK(orbit.time[i] > orbit.time[i - 1]);
    // The phase decreases in time.
    const double phase = std::atan2(orbit.output[i][1] / 1.9, (orbit.output[i][0] - 1.9) / 0.3);
    CHECK(std::abs(std::remainder(phase + turn * n / 32.0, turn)) < 1e-9);
  }
  has_the_hoppers_events(orbit, apex);
}

TEST_CASE("orbit: the hopper from touchdown to touchdown and from liftoff to liftoff") {
  const auto touchdown = orbit_of<1>(Hopper<>{}, AtEdge<hopper::Touchdown>{});
  REQUIRE(touchdown.status == Status::ok);
  has_the_hoppers_events(touchdown, 0.350981787094387);
  CHECK(touchdown.event[0].edge == 0);  // the section's own edge comes first
  CHECK(touchdown.event[0].t == 0.0);
  CHECK(touchdown.point[0].chart == 0);
  const auto liftoff = orbit_of<1>(Hopper<>{}, AtEdge<hopper::Liftoff>{});
  REQUIRE(liftoff.status == Status::ok);
  has_the_hoppers_events(liftoff, 0.516314426971245);
  CHECK(liftoff.event[0].edge == 1);
  CHECK(liftoff.point[0].chart == 1);
}

TEST_CASE("orbit: does not depend on the step beyond its order") {
  const auto coarse = orbit_of<32>(Hopper<>{}, ClockPhases{}, 64);
  const auto fine = orbit_of<32>(Hopper<>{}, ClockPhases{}, 2048);
  REQUIRE(coarse.status == Status::ok);
  REQUIRE(fine.status == Status::ok);
  const Vec<5> flight(1.8561810757180, -1.9213776705096, 0.0, 0.7061913261653, 1.0822766978996);
  CHECK((fine.point[0].x - flight).norm() < 1e-11);
  CHECK((coarse.point[0].x - flight).norm() < 1e-6);
  CHECK((coarse.point[0].x - flight).norm() > 1e-10);
}

TEST_CASE("orbit: closed forms") {
  SECTION("a metronome, whose start is not at clock zero") {
    Metronome<> m;
    for (const double shift : {0.0, 0.3, 2.0, 5.5}) {
      m.shift = shift;
      const auto orbit = orbit_of<8>(m, ClockPhases{8}, 256, 5);
      REQUIRE(orbit.status == Status::ok);
      const double half = std::exp(-0.5 * m.k);
      const double kk = m.keep * m.keep;
      const double turned_on = kk * half * (m.drive / m.k) * (1.0 - half) / (1.0 - kk * half * half);
      const double turned_off = m.keep * (m.drive / m.k * (1.0 - half) + turned_on * half);
      REQUIRE(orbit.events == 2);
      for (int i = 0; i < 2; ++i) {
        const auto& event = orbit.event[static_cast<std::size_t>(i)];
        CHECK(std::abs(event.after.x[0] - (event.edge == 0 ? turned_off : turned_on)) < 1e-10);
        const double angle = shift + (event.edge == 0 ? 0.5 * turn : 0.0);
        CHECK(std::abs(std::remainder(turn * event.t - angle, turn)) < 1e-12);
      }
    }
  }
  SECTION("a relaxation oscillator, whose section is a point") {
    const Relaxation<> m;
    const double period = m.tau * (std::log((1.0 - m.low) / (1.0 - m.high)) + std::log(m.high / m.low));
    Ldtp<1, 1, 1, 1> system;
    const auto orbit = find_orbit<1>(m, Timebase{1.0, 512}, AtEdge<relaxation::Full>{}, system, 3);
    REQUIRE(orbit.status == Status::ok);
    CHECK(std::abs(orbit.period - period) < 1e-10);
    CHECK(orbit.events == 2);
    CHECK(system.dim[0] == 0);
    CHECK(system.monodromy(0)(0, 0) == 0.0);
  }
  SECTION("an unstable orbit, which Newton's method finds and settling does not") {
    Metronome<> m;
    m.keep = 2.0;
    const double half = std::exp(-0.5 * m.k);
    const double kk = m.keep * m.keep;
    REQUIRE(kk * half * half > 1.0);  // its multiplier
    const double turned_on = kk * half * (m.drive / m.k) * (1.0 - half) / (1.0 - kk * half * half);
    m.shift = 0.5;
    Ldtp<1, 1, 1, 8> system;
    const auto orbit = find_orbit<8>(m, timebase_of(m, 256), ClockPhases{8}, system, 0);
    REQUIRE(orbit.status == Status::ok);
    CHECK(std::abs(system.monodromy(0)(0, 0) - kk * half * half) < 1e-8);
    for (int i = 0; i < orbit.events; ++i) {
      const auto& event = orbit.event[static_cast<std::size_t>(i)];
      if (event.edge == 1) CHECK(std::abs(event.after.x[0] - turned_on) < 1e-8);
    }
  }
}

TEST_CASE("orbit: what is no orbit is not called one") {
  SECTION("a ball that comes to rest") { CHECK(orbit_of<1>(Ball<>{}, AtEdge<ball::Impact>{}).status == Status::zeno); }
  SECTION("sections that do not divide the turn, or of another number") {
    CHECK(orbit_of<32>(Hopper<>{}, ClockPhases{}, 500).status == Status::failed);
    CHECK(orbit_of<16>(Hopper<>{}, ClockPhases{32}).status == Status::failed);
    CHECK(orbit_of<16>(Hopper<>{}, KinematicPhases{32}).status == Status::failed);
    CHECK(orbit_of<32>(Hopper<>{}, ClockPhases{}, 0).status == Status::failed);
  }
  SECTION("a section that the orbit does not meet") {
    KinematicPhases family;
    family.o_p = 7.0;  // the origin lies outside the orbit: half of the phases are never met
    CHECK(orbit_of<32>(Hopper<>{}, family).status == Status::failed);
  }
  SECTION("more events than are kept") {
    CHECK(orbit_of<2>(Rattle<>{}, ClockPhases{2}).status == Status::zeno);
    Rattle<> slower;
    slower.beats = 16.0;
    const auto orbit = orbit_of<2>(slower, ClockPhases{2});
    CHECK(orbit.status == Status::ok);
    CHECK(orbit.events == 32);
  }
}

TEST_CASE("orbit: one that touches a guard is reported as grazing") {
  Kiss<> m;
  const auto free = orbit_of<8>(m, ClockPhases{8});
  REQUIRE(free.status == Status::ok);
  CHECK(std::abs(free.point[5].x[0] + std::sqrt(0.5)) < 1e-8);  // the lowest point, x = cos(clock - pi / 4) / sqrt(2)
  m.miss = -free.point[5].x[0] - std::sqrt(0.5) + 1e-12;
  const auto touching = orbit_of<8>(m, ClockPhases{8});
  CHECK(touching.status == Status::grazing);
  CHECK(touching.events == 0);
  CHECK((touching.point[0].x - free.point[0].x).norm() < 1e-12);
}

TEST_CASE("orbit: nothing is allocated") {
  const Hopper<> m;
  const Timebase base = timebase_of(m, 64);
  const auto system = std::make_unique<LdtpOf<Hopper<>, 32>>();
  const test::AllocationCount allocated;
  Status status = find_orbit<32>(m, base, ClockPhases{}, *system).status;
  status = worse(status, find_orbit<32>(m, base, KinematicPhases{}, *system).status);
  CHECK(allocated() == 0);
  CHECK(status == Status::ok);
}
