#include "core/hybrid/with.hpp"

#include <cmath>
#include <string>

#include "core/flow/advance.hpp"
#include "sim/effects/force_laws.hpp"
#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/effects.hpp"
#include "tests/support/laws.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;
using namespace saltus::worlds;

namespace {

// The hopper with a damper in its leg, written by hand: the force of the leg is l - c (v_M - v_m), on the ground too.
template <class S = double>
struct DampedHopper : Hopper<S> {
  using U = Vec<1, S>;
  S c = 0.3;
  static constexpr auto parameters() { return std::array{Parameter{"c", "N s/m", &DampedHopper::c}}; }
  Vec<5, S> flow(hopper::Flight, const Vec<5, S>& x, const U& u) const noexcept {
    const S leg = this->k * (this->l0 - (x[0] - x[3])) + this->a * sin(x[2]) - c * (x[1] - x[4]);
    return {x[1], (leg + u[0]) / this->M - this->g, this->omega, x[4], -(leg + this->b * x[4]) / this->m - this->g};
  }
  Vec<3, S> flow(hopper::Stance, const Vec<3, S>& x, const U& u) const noexcept {
    const S leg = this->k * (this->l0 - x[0]) + this->a * sin(x[2]) - c * x[1];
    return {x[1], (leg + u[0]) / this->M - this->g, this->omega};
  }
  S guard(hopper::Touchdown, const Vec<5, S>& x, const U&) const noexcept { return x[3]; }
  S guard(hopper::Liftoff, const Vec<3, S>& x, const U&) const noexcept {
    return this->k * (this->l0 - x[0]) + this->a * sin(x[2]) - c * x[1] + this->m * this->g;
  }
};
static_assert(check<DampedHopper<>>());

// Records the order in which effects are asked.
template <int Factor, class S = double>
struct Times {
  using Scalar = S;  // a template of this shape says by itself how it is rebound
  template <class T>
  using rebind = Times<Factor, T>;
  static constexpr auto parameters() { return std::array<Parameter<Times, S>, 0>{}; }
  Vec<1, S> input(const Vec<1, S>& u) const noexcept { return Vec<1, S>(Factor * u[0] + 1.0); }
  Vec<2, S> output(const Vec<2, S>& y) const noexcept { return {Factor * y[0] + 1.0, y[1]}; }
};
template <class S = double>
using Double = Times<2, S>;
template <class S = double>
using Triple = Times<3, S>;

const Vec<5> flight(1.7, -1.1, 0.8, 0.4, -0.6);
const Vec<3> stance(1.9, 0.7, 2.9);
const Vec<1> u(0.25);

}  // namespace

TEST_CASE("with: a force at a port is the force written by hand, in both charts and in the guard it passes through") {
  const With m(Hopper<>{}, Damper<hopper::Leg>{});
  const DampedHopper<> hand;
  CHECK((m.flow(hopper::Flight{}, flight, u) - hand.flow(hopper::Flight{}, flight, u)).norm() < 1e-14);
  CHECK((m.flow(hopper::Stance{}, stance, u) - hand.flow(hopper::Stance{}, stance, u)).norm() < 1e-14);
  CHECK(std::abs(m.guard(hopper::Liftoff{}, stance, u) - hand.guard(hopper::Liftoff{}, stance, u)) < 1e-14);
  CHECK(m.guard(hopper::Touchdown{}, flight, u) == hand.guard(hopper::Touchdown{}, flight, u));
  // Over many cycles too, events and all.
  const Timebase base = timebase_of(m, 256);
  Run<With<Hopper<>, Damper<hopper::Leg>>> composed;
  Run<DampedHopper<>> written;
  composed.at = start_of(m);
  written.at = start_of(hand);
  int events = 0;
  for (int i = 0; i < 2560; ++i) {
    const Passage a = step(m, composed, u, base);
    const Passage b = step(hand, written, u, base);
    REQUIRE(a.status == Status::ok);
    REQUIRE(a.events == b.events);
    events += a.events;
  }
  CHECK(events >= 18);
  CHECK((composed.at.x - written.at.x).norm() < 1e-11);
}

TEST_CASE("with: a port that does not reach the ground leaves the liftoff guard alone") {
  const With m(Hopper<>{}, Damper<hopper::Body>{});
  const Hopper<> plain;
  CHECK(m.guard(hopper::Liftoff{}, stance, u) == plain.guard(hopper::Liftoff{}, stance, u));
  const double c = 0.3;
  Vec<5> expected = plain.flow(hopper::Flight{}, flight, u);
  expected[1] += -c * flight[1] / plain.M;
  CHECK((m.flow(hopper::Flight{}, flight, u) - expected).norm() < 1e-15);
}

TEST_CASE("with: a port that a chart has not is silent there") {
  const With m(Hopper<>{}, Damper<hopper::Foot>{});
  const Hopper<> plain;
  CHECK(m.flow(hopper::Stance{}, stance, u) == plain.flow(hopper::Stance{}, stance, u));
  CHECK(m.flow(hopper::Flight{}, flight, u)[4] == plain.flow(hopper::Flight{}, flight, u)[4] + 0.3 * 0.6 / plain.m);
}

TEST_CASE("with: effects on a chart, a guard, a reset, the input and the output") {
  const Hopper<> plain;
  SECTION("rate of one chart") {
    const With m(plain, Wind<>{});
    const double wind = 0.4 * (1.0 + 0.1 * flight[1] + u[0]);
    CHECK(std::abs(m.flow(hopper::Flight{}, flight, u)[1] - plain.flow(hopper::Flight{}, flight, u)[1] - wind) < 1e-15);
    CHECK(m.flow(hopper::Stance{}, stance, u) == plain.flow(hopper::Stance{}, stance, u));
  }
  SECTION("force that knows the clock, in the flow and in the guard that it passes through") {
    const With m(plain, Shaker<hopper::Leg>{});
    const double air = 0.5 * std::sin(flight[2]);
    Vec<5> expected = plain.flow(hopper::Flight{}, flight, u);
    expected[1] += air / plain.M;
    expected[4] -= air / plain.m;
    CHECK((m.flow(hopper::Flight{}, flight, u) - expected).norm() < 1e-14);
    const double ground = 0.5 * std::sin(stance[2]);
    CHECK(std::abs(m.guard(hopper::Liftoff{}, stance, u) - plain.guard(hopper::Liftoff{}, stance, u) - ground) < 1e-14);
  }
  SECTION("reset that asks the model") {
    const With m(plain, Arrest<>{});
    CHECK(m.reset(hopper::Touchdown{}, flight, u) == Vec<3>(flight[0], -0.1 * plain.g, flight[2]));
    CHECK(m.reset(hopper::Liftoff{}, stance, u) == plain.reset(hopper::Liftoff{}, stance, u));
  }
  SECTION("guard and reset, each of one edge") {
    const With m(plain, DeepGround<>{});
    CHECK(m.guard(hopper::Touchdown{}, flight, u) == flight[3] + 0.02);
    CHECK(m.guard(hopper::Liftoff{}, stance, u) == plain.guard(hopper::Liftoff{}, stance, u));
    CHECK(m.reset(hopper::Liftoff{}, stance, u)[3] == -0.02);
    CHECK(m.reset(hopper::Touchdown{}, flight, u) == plain.reset(hopper::Touchdown{}, flight, u));
  }
  SECTION("reset, of what it was before") {
    const With m(plain, LossyTouchdown<>{});
    CHECK((m.reset(hopper::Touchdown{}, flight, u) - Vec<3>(flight[0], 0.95 * flight[1], flight[2])).norm() < 1e-15);
  }
  SECTION("input, wherever the model sees it") {
    const With m(plain, InputGain<>{}, Wind<>{});
    const Vec<1> more(1.1 * u[0]);
    CHECK(m.flow(hopper::Stance{}, stance, u) == plain.flow(hopper::Stance{}, stance, more));
    const With windy(plain, Wind<>{});
    CHECK(m.flow(hopper::Flight{}, flight, u) == windy.flow(hopper::Flight{}, flight, more));
  }
  SECTION("output") {
    const With m(plain, SensorError<>{});
    CHECK(m.output(hopper::Stance{}, stance, u) == Vec<2>(1.2 * stance[0] + 0.1, stance[1]));
  }
}

TEST_CASE("with: several effects add, in any order, and nest") {
  const With both(Hopper<>{}, Damper<hopper::Leg>{}, Cubic<hopper::Leg>{});
  const With other(Hopper<>{}, Cubic<hopper::Leg>{}, Damper<hopper::Leg>{});
  const With nested(With(Hopper<>{}, Damper<hopper::Leg>{}), Cubic<hopper::Leg>{});
  static_assert(std::is_same_v<decltype(nested), const With<With<Hopper<>, Damper<hopper::Leg>>, Cubic<hopper::Leg>>>);
  const Vec<5> f = both.flow(hopper::Flight{}, flight, u);
  CHECK((f - other.flow(hopper::Flight{}, flight, u)).norm() < 1e-14);
  CHECK((f - nested.flow(hopper::Flight{}, flight, u)).norm() < 1e-14);
  const double g = both.guard(hopper::Liftoff{}, stance, u);
  CHECK(std::abs(g - nested.guard(hopper::Liftoff{}, stance, u)) < 1e-14);
  CHECK((f - Hopper<>{}.flow(hopper::Flight{}, flight, u)).norm() > 0.1);
}

TEST_CASE("with: inputs pass from the outermost effect inwards, outputs from the innermost outwards") {
  // u -> 2 u + 1 -> 3 (2 u + 1) + 1 in one With, first named first; a nested one is asked after the one around it.
  const With both(Hopper<>{}, Double<>{}, Triple<>{});
  const With nested(With(Hopper<>{}, Triple<>{}), Double<>{});
  const Hopper<> plain;
  const Vec<1> seen(3.0 * (2.0 * u[0] + 1.0) + 1.0);
  CHECK(both.flow(hopper::Stance{}, stance, u) == plain.flow(hopper::Stance{}, stance, seen));
  CHECK(nested.flow(hopper::Stance{}, stance, u) == plain.flow(hopper::Stance{}, stance, seen));
  CHECK(both.output(hopper::Stance{}, stance, u)[0] == 3.0 * (2.0 * stance[0] + 1.0) + 1.0);
  CHECK(nested.output(hopper::Stance{}, stance, u)[0] == 2.0 * (3.0 * stance[0] + 1.0) + 1.0);
}

TEST_CASE("with: parameters of the model and of its effects, in order") {
  With m(Hopper<>{}, Damper<hopper::Leg>{}, SensorError<>{});
  static_assert(parameter_count<decltype(m)> == 8 + 1 + 2);
  std::string names;
  visit_parameters(m, [&](std::string_view name, std::string_view, double& value) {
    names += std::string(name) + " ";
    if (name == "c") value = 0.7;
  });
  CHECK(names == "m M k b l0 a omega g c gain offset ");
  CHECK(std::get<0>(m.effects).c == 0.7);
  const auto lifted = lift<Dual<1>>(m);
  CHECK(std::get<0>(lifted.effects).c.value == 0.7);
}

TEST_CASE("with: effects whose parameters vanish may rest, all others act") {
  With m(Hopper<>{}, Damper<hopper::Leg>{}, Cubic<hopper::Leg>{}, Double<>{});
  const Vec<5> acting = m.flow(hopper::Flight{}, flight, u);
  m.rest_idle();
  CHECK(m.resting == 0);
  CHECK(m.flow(hopper::Flight{}, flight, u) == acting);
  std::get<0>(m.effects).c = 0.0;
  m.rest_idle();
  CHECK(m.resting == 1);
  CHECK(m.flow(hopper::Flight{}, flight, u) ==
        With(Hopper<>{}, Cubic<hopper::Leg>{}, Double<>{}).flow(hopper::Flight{}, flight, u));
  // Over dual numbers a parameter of zero acts as long as its derivative is asked for.
  auto lifted = lift_parameters<10>(m, 0);
  lifted.rest_idle();
  CHECK(lifted.resting == 0);
  auto constant = lift<Dual<10>>(m);
  constant.rest_idle();
  CHECK(constant.resting == 1);
  // Woken again.
  std::get<0>(m.effects).c = 0.3;
  m.rest_idle();
  CHECK(m.flow(hopper::Flight{}, flight, u) == acting);
}

TEST_CASE("with: a friction that acts is known to have a kink, one that rests is not") {
  With m(Hopper<>{}, Damper<hopper::Leg>{}, effects::Coulomb<hopper::Leg>{});
  CHECK(m.kinked());  // nobody has let it rest
  m.rest_idle();
  CHECK_FALSE(m.kinked());
  std::get<1>(m.effects).F = 0.1;
  m.rest_idle();
  CHECK(m.kinked());
}

TEST_CASE("with: no effect at all is the model itself") {
  using Bare = With<Hopper<>>;
  const Bare m;
  CHECK(m.flow(hopper::Flight{}, flight, u) == Hopper<>{}.flow(hopper::Flight{}, flight, u));
  static_assert(std::is_same_v<Rebind<Bare, Dual<2>>, With<Hopper<Dual<2>>>>);
}

TEST_CASE("with: a model with effects keeps the laws of models") {
  obeys_laws(With(Hopper<>{}, Damper<hopper::Leg>{}, InputGain<>{}), 512, 31);
  obeys_laws(With(Hopper<>{}, Cubic<hopper::Leg>{}, Wind<>{}, DeepGround<>{}, LossyTouchdown<>{}, SensorError<>{}), 512,
             31);
}

TEST_CASE("with: nothing is allocated") {
  const int ticks = test::counting() ? 100000 : 5000;
  const With m(Hopper<>{}, Damper<hopper::Leg>{}, Cubic<hopper::Leg>{}, InputGain<>{}, SensorError<>{});
  const Timebase base = timebase_of(m, 512);
  Run<std::decay_t<decltype(m)>> run;
  run.at = start_of(m);
  const test::AllocationCount allocated;
  for (int i = 0; i < ticks; ++i) step(m, run, u, base);
  CHECK(allocated() == 0);
  CHECK(run.ledger[Status::ok] == ticks);
}
