#include "core/flow/crossing.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <tuple>

#include "core/flow/rk8.hpp"
#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/plain.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;
using namespace saltus::worlds;

namespace {

// One step of `f` from x0, as `advance` would hand it to `locate`.
template <class Method, int N, class F, class G>
Crossing<N> locate_in_step(const F& f, const Vec<N>& x0, double h, const G& guard, double whole = 0.0) {
  const Vec<N> f0 = f(x0);
  Vec<N> f1;
  const Vec<N> x1 = Method::template step<N, double>(f, x0, f0, h, f1);
  const Step<N, F, Method> step{f, {x0, f0, x1, f1, h}, x1, crossing::moment * std::fmax(h, whole)};
  return locate<N>(step, guard);
}

template <class Method, class M, class E>
Crossing<E::from::dim> locate_edge(const M& m, E e, const Vec<E::from::dim>& x0, const Input<M>& u, double h) {
  constexpr int n = E::from::dim;
  const auto f = [&](const Vec<n>& x) -> Vec<n> { return m.flow(typename E::from{}, x, u); };
  return locate_in_step<Method, n>(f, x0, h, [&](const Vec<n>& x) -> double { return m.guard(e, x, u); });
}

// A guard that is any function of time, in a chart where time is the state: Runge-Kutta and its cubic are exact.
template <class Method, class G>
Crossing<1> locate_in_time(const G& g, double h = 1.0, double t0 = 0.0) {
  const auto f = [](const Vec<1>&) { return Vec<1>(1.0); };
  return locate_in_step<Method, 1>(f, Vec<1>(t0), h, [&](const Vec<1>& x) -> double { return g(x[0]); });
}

using Kind = Crossing<1>::Kind;

template <class Method>
constexpr double usual_step = Method::long_steps ? 1.0 / 16.0 : 1.0 / 64.0;  // [s]

// Every state drawn that crosses within the step is located where plain bisection finds it.
template <class Method, class M, class E, class Draw>
void same_as_plain_bisection(const M& m, E e, const Input<M>& u, double h, Draw draw) {
  using K = typename Crossing<E::from::dim>::Kind;
  int crossed = 0;
  double worst_s = 0.0;
  double worst_x = 0.0;
  bool all_found = true;
  bool all_far = true;
  for (int i = 0; i < 3000; ++i) {
    const Vec<E::from::dim> x0 = draw();
    const Vec<E::from::dim> x1 = plain::step<Method>(m, typename E::from{}, x0, u, h);
    if (!(m.guard(e, x0, u) > 0.0 && m.guard(e, x1, u) <= 0.0)) continue;
    ++crossed;
    const auto found = locate_edge<Method>(m, e, x0, u, h);
    all_found = all_found && found.kind == K::crossed;
    all_far = all_far && m.guard(e, found.x, u) <= 0.0;
    const double s = plain::fall<Method>(m, e, x0, u, h);
    worst_s = std::fmax(worst_s, std::abs(found.s - s));
    worst_x = std::fmax(worst_x, (found.x - plain::step<Method>(m, typename E::from{}, x0, u, s * h)).norm());
  }
  CHECK(crossed > 300);
  CHECK(all_found);
  CHECK(all_far);
  CHECK(worst_s < (Method::long_steps ? 1e-11 : 1e-13));
  CHECK(worst_x < (Method::long_steps ? 1e-11 : 1e-13));
}

}  // namespace

TEMPLATE_TEST_CASE("locate: the root is that of plain bisection, and lies on the far side", "", Rk4, Rk8) {
  std::mt19937_64 random(1);
  const auto uniform = [&](double a, double b) { return std::uniform_real_distribution<double>(a, b)(random); };
  const double h = usual_step<TestType>;
  SECTION("ball") {
    same_as_plain_bisection<TestType>(Ball<>{}, ball::Impact{}, Vec<1>(0.3), h,
                                      [&] { return Vec<2>(uniform(0.0, 0.03), uniform(-3.0, 0.1)); });
  }
  SECTION("spring and wall") {
    Wall<> m;
    m.w = 12.0;
    same_as_plain_bisection<TestType>(m, wall::Hit{}, Vec<1>(-0.4), h,
                                      [&] { return Vec<2>(uniform(-0.5, -0.45), uniform(-4.0, 0.0)); });
  }
  SECTION("pendulum, a nonlinear guard") {
    same_as_plain_bisection<TestType>(Pendulum<>{}, pendulum::Stop{}, Vec<1>(0.1), h,
                                      [&] { return Vec<2>(uniform(-0.3, -0.2), uniform(-5.0, -0.5)); });
  }
  SECTION("hopper") {
    const Hopper<> m;
    same_as_plain_bisection<TestType>(m, hopper::Touchdown{}, Vec<1>(0.2), h, [&] {
      return Vec<5>(uniform(1.4, 1.8), uniform(-1.0, 1.0), uniform(1.5, 2.6), uniform(0.0, 0.03), uniform(-3.0, -0.3));
    });
    same_as_plain_bisection<TestType>(m, hopper::Liftoff{}, Vec<1>(0.2), h,
                                      [&] { return Vec<3>(uniform(1.95, 2.2), uniform(0.5, 2.0), uniform(3.0, 3.5)); });
  }
}

TEMPLATE_TEST_CASE("locate: a crossing typically costs 7 further evaluations, 16 of order eight, the worst a constant",
                   "", Rk4, Rk8) {
  constexpr bool eight = TestType::long_steps;
  long calls = 0;
  const Pendulum<> m;
  const auto f = [&](const Vec<2>& x) -> Vec<2> {
    ++calls;
    return m.flow(pendulum::Swing{}, x, Vec<1>(0.0));
  };
  const auto guard = [&](const Vec<2>& x) -> double { return m.guard(pendulum::Stop{}, x, Vec<1>(0.0)); };
  constexpr long own = eight ? 12 : 5;  // of the step itself
  long most = 0;
  long sum = 0;
  int crossed = 0;
  for (int i = 0; i < 1000; ++i) {
    calls = 0;
    const auto found = locate_in_step<TestType, 2>(f, Vec<2>(-0.3 + 2e-5 * (i + 1), -3.0), 1.0 / 64.0, guard);
    if (found.kind != Crossing<2>::Kind::crossed) continue;
    ++crossed;
    most = std::max(most, calls - own);
    sum += calls - own;
  }
  CHECK(crossed == 1000);
  CHECK(static_cast<double>(sum) / crossed <= (eight ? 16.0 : 7.0));
  CHECK(most <= (eight ? 20 : 12));

  // One for the bottom of a dip, then the polishes, then the halvings: three evaluations each. Of order eight twelve
  // for each, polishes for the bottom too.
  constexpr long bound = eight ? 12 * (2 + 2 * crossing::polishes + crossing::halvings)
                               : 3 * (1 + crossing::polishes + crossing::halvings);
  const auto clock = [&](const Vec<1>&) {
    ++calls;
    return Vec<1>(1.0);
  };
  const auto worst = [&](auto g) {
    calls = 0;
    const auto found =
        locate_in_step<TestType, 1>(clock, Vec<1>(0.0), 1.0, [&](const Vec<1>& x) -> double { return g(x[0]); });
    CHECK(found.kind == Kind::crossed);
    CHECK(g(found.x[0]) <= 0.0);
    CHECK(calls - own <= bound);
    return found.s;
  };
  CHECK(std::abs(worst([](double t) { return t < 0.3 ? 1.0 : -1.0; }) - 0.3) < 1e-14);              // a jump
  CHECK(std::abs(worst([](double t) { return std::cbrt(0.7 - t); }) - 0.7) < 1e-13);                // infinitely steep
  CHECK(std::abs(worst([](double t) { return (0.6 - t) * (0.6 - t) * (0.6 - t); }) - 0.6) < 1e-4);  // flat
  CHECK(std::abs(worst([](double t) { return std::exp(-40.0 * t) - 1e-9; }) + std::log(1e-9) / 40.0) < 1e-13);
  CHECK(std::abs(worst([](double t) { return std::tanh(1e9 * (0.1 - t)); }) - 0.1) < 1e-13);
}

TEMPLATE_TEST_CASE("locate: a guard at zero at the start", "", Rk4, Rk8) {
  SECTION("and rising does not fire") {
    CHECK(locate_in_time<TestType>([](double t) { return t; }).kind == Kind::none);
  }
  SECTION("and rising from rest does not fire") {
    CHECK(locate_in_time<TestType>([](double t) { return t * t; }).kind == Kind::none);
  }
  SECTION("a hair below it, and rising, does not fire") {
    CHECK(locate_in_time<TestType>([](double t) { return t - 1e-12; }).kind == Kind::none);
  }
  SECTION("rising and falling within the step fires at the fall") {
    const auto found = locate_in_time<TestType>([](double t) { return t * (0.4 - t); });
    CHECK(found.kind == Kind::crossed);
    CHECK(std::abs(found.s - 0.4) < 1e-14);
    CHECK_FALSE(found.grazing);
  }
  SECTION("rising, falling and rising again fires at the fall") {
    const auto found = locate_in_time<TestType>([](double t) { return t * (0.4 - t) * (0.7 - t); });
    CHECK(found.kind == Kind::crossed);
    CHECK(std::abs(found.s - 0.4) < 1e-14);
  }
  SECTION("and falling, or a hair below it, fires at once") {
    for (const double g0 : {0.0, -1e-18, -1e-11}) {
      const auto found = locate_in_time<TestType>([&](double t) { return g0 - t; });
      CHECK(found.kind == Kind::crossed);
      CHECK(found.s == 0.0);
      CHECK(found.x[0] == 0.0);
    }
  }
  SECTION("and falling from rest is not armed") {
    CHECK(locate_in_time<TestType>([](double t) { return t < 0.5 ? 0.0 : 0.5 - t; }).kind == Kind::unarmed);
  }
  SECTION("and staying there is not armed") {
    CHECK(locate_in_time<TestType>([](double) { return 0.0; }).kind == Kind::unarmed);
  }
  SECTION("in a remainder too short to tell, fires if it falls and waits if it rises") {
    const auto f = [](const Vec<1>&) { return Vec<1>(1.0); };
    const double h = 1.0 / 64.0;
    for (const double rest : {0.0, 0x1p-60, 0x1p-40, 0x1p-27}) {
      for (const double sign : {-1.0, 0.0, 1.0}) {
        const auto found = locate_in_step<TestType, 1>(
            f, Vec<1>(0.0), rest, [&](const Vec<1>& x) -> double { return sign * x[0] - 1e-18; }, h);
        CHECK(found.kind == (sign < 0.0 ? Kind::crossed : Kind::none));
      }
    }
  }
}

TEMPLATE_TEST_CASE("locate: a guard below zero at the start has escaped, whatever comes after", "", Rk4, Rk8) {
  CHECK(locate_in_time<TestType>([](double t) { return t - 0.5; }).kind == Kind::escaped);
  CHECK(locate_in_time<TestType>([](double t) { return t - 1e-5; }).kind == Kind::escaped);
  CHECK(locate_in_time<TestType>([](double t) { return -0.5 - t; }).kind == Kind::escaped);
  CHECK(locate_in_time<TestType>([](double) { return -1.0; }).kind == Kind::escaped);
}

TEMPLATE_TEST_CASE("locate: the end belongs to the step", "", Rk4, Rk8) {
  SECTION("zero at the end") {
    const auto found = locate_in_time<TestType>([](double t) { return 1.0 - t; });
    CHECK(found.kind == Kind::crossed);
    CHECK(found.s == 1.0);
    CHECK(found.x[0] == 1.0);
  }
  SECTION("zero at the end, tangentially") {
    const auto found = locate_in_time<TestType>([](double t) { return (1.0 - t) * (1.0 - t); });
    CHECK(found.kind == Kind::crossed);
    CHECK(found.grazing);
  }
  SECTION("one ulp before, at and after the end") {
    for (int ulps = -8; ulps <= 8; ++ulps) {
      const double root = 1.0 + ulps * 0x1p-53;
      const auto found = locate_in_time<TestType>([&](double t) { return root - t; });
      if (root <= 1.0) {
        CHECK(found.kind == Kind::crossed);
        CHECK(found.s <= 1.0);
        CHECK(found.x[0] >= root);
        CHECK(found.x[0] - root < 1e-14);
      } else {
        CHECK(found.kind == Kind::none);
      }
    }
  }
}

TEMPLATE_TEST_CASE("locate: when a guard falls twice in a step the first fall counts", "", Rk4, Rk8) {
  int wrong = 0;
  int tried = 0;
  for (double r1 = 0.05; r1 < 0.9; r1 += 0.0371) {
    for (double r2 = r1 + 0.013; r2 < 0.95; r2 += 0.0473) {
      for (double r3 = r2 + 0.011; r3 < 1.2; r3 += 0.0391) {
        ++tried;
        const auto found = locate_in_time<TestType>([&](double t) { return (r1 - t) * (r2 - t) * (r3 - t); });
        if (found.kind != Kind::crossed || std::abs(found.s - r1) > 1e-10) ++wrong;
      }
    }
  }
  CHECK(tried > 2000);
  CHECK(wrong == 0);
}

TEMPLATE_TEST_CASE("locate: a dip below zero and back within one step is found down to 1e-6 of the guard's scale", "",
                   Rk4, Rk8) {
  // Parabola: exact for Runge-Kutta and for the cubic. Oscillators: the cubic is off by up to 7e-4 of the scale, 2e-2
  // for order eight.
  const double h = usual_step<TestType>;
  struct Tally {
    int found = 0, reported = 0, silent = 0, invented = 0, late = 0;
  };
  const auto sweep = [&](auto step, auto depth_of, double bottom_value) {
    Tally tally;
    for (double exponent = -1.0; exponent >= -12.0; exponent -= 0.25) {
      for (const double sign : {1.0, -1.0}) {
        for (double phase = 0.01; phase < 1.0; phase += 0.0298) {
          const double depth = sign * std::pow(10.0, exponent) * bottom_value;
          const auto setup = step(depth, phase);
          const Vec<2>& x0 = std::get<0>(setup);
          const auto& f = std::get<1>(setup);
          const auto& guard = std::get<2>(setup);
          // The truth: the path of the re-integrated step, scanned finely.
          const Vec<2> f0 = f(x0);
          const auto on_path = [&](double s) { return guard(TestType::template step<2, double>(f, x0, f0, s * h)); };
          double bottom = 0.0;
          for (int i = 1; i <= 50; ++i) bottom = on_path(i / 50.0) < on_path(bottom) ? i / 50.0 : bottom;
          double left = std::fmax(0.0, bottom - 0.02);
          double right = std::fmin(1.0, bottom + 0.02);
          for (int i = 0; i < 40; ++i) {
            const double third = (right - left) / 3.0;
            if (on_path(left + third) < on_path(right - third)) {
              right -= third;
            } else {
              left += third;
            }
          }
          bottom = 0.5 * (left + right);
          const double lowest = on_path(bottom);
          if (!(guard(x0) > 0.0) || !(on_path(1.0) > 0.0)) continue;
          const auto found = locate_in_step<TestType, 2>(f, x0, h, guard);
          const bool crossed = found.kind == Crossing<2>::Kind::crossed;
          tally.found += crossed;
          tally.reported += !crossed && found.grazing;
          tally.silent += !crossed && !found.grazing && lowest < -1e-6 * depth_of();
          tally.invented += crossed && (lowest > 1e-12 * depth_of() || guard(found.x) > 0.0);
          tally.late += crossed && found.s > bottom + 1e-7;
        }
      }
    }
    return tally;
  };
  SECTION("parabola") {
    const double a = 5.0;
    const auto t = sweep(
        [&](double depth, double phase) {
          const double t0 = -phase * h;
          const auto f = [a](const Vec<2>& x) -> Vec<2> { return {x[1], a}; };
          const auto guard = [](const Vec<2>& x) -> double { return x[0]; };
          return std::tuple{Vec<2>(0.5 * a * t0 * t0 - depth, a * t0), f, guard};
        },
        [&] { return 0.5 * a * h * h; }, 0.5 * a * h * h);
    CHECK(t.found > 500);
    CHECK(t.reported > 100);
    CHECK(t.silent == 0);
    CHECK(t.invented == 0);
    CHECK(t.late == 0);
  }
  for (const double w : {1.0, 6.283185307179586, 20.0, TestType::long_steps ? 32.0 : 25.0}) {
    SECTION("oscillator at " + std::to_string(w) + " rad/s") {
      const double scale = 0.5 * w * w * h * h;
      const auto t = sweep(
          [&](double depth, double phase) {
            const double angle = w * phase * h;
            const double amplitude = 1.0 + depth;
            const auto f = [w](const Vec<2>& x) -> Vec<2> { return {x[1], -w * w * x[0]}; };
            const auto guard = [](const Vec<2>& x) -> double { return x[0] + 1.0; };
            return std::tuple{Vec<2>(-amplitude * std::cos(angle), -amplitude * w * std::sin(angle)), f, guard};
          },
          [&] { return scale; }, scale);
      CHECK(t.found > 300);
      CHECK(t.silent == 0);
      CHECK(t.invented == 0);
      CHECK(t.late == 0);
    }
  }
}

TEMPLATE_TEST_CASE("locate: a tangential crossing is reported, a steep one is not", "", Rk4, Rk8) {
  CHECK(locate_in_time<TestType>([](double t) { return std::pow(0.5 - t, 3); }).grazing);
  CHECK(locate_in_time<TestType>([](double t) { return (0.5 - t) * (0.5 - t) - 1e-13; }).grazing);
  CHECK(locate_in_time<TestType>([](double t) {
          return (1.0 - t) * (1.0 - t) + 1e-13;
        }).grazing);  // at the end, and missed
  CHECK_FALSE(locate_in_time<TestType>([](double t) { return 0.5 - t; }).grazing);
  CHECK_FALSE(locate_in_time<TestType>([](double t) { return 1.0 + 1e-13 - t; }).grazing);
  CHECK_FALSE(locate_in_time<TestType>([](double) { return 1e-13; }).grazing);
  CHECK_FALSE(locate_in_time<TestType>([](double t) { return (0.5 - t) * (0.5 - t) - 1e-3; }).grazing);
}

TEMPLATE_TEST_CASE("locate: a guard that is not finite is reported, wherever it is met", "", Rk4, Rk8) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, inf, -inf}) {
    CHECK(locate_in_time<TestType>([&](double t) { return t <= 0.0 ? bad : 1.0; }).kind == Kind::diverged);
    CHECK(locate_in_time<TestType>([&](double t) { return t >= 1.0 ? bad : 1.0; }).kind == Kind::diverged);
    CHECK(locate_in_time<TestType>([&](double) { return bad; }).kind == Kind::diverged);
  }
  CHECK(locate_in_time<TestType>([&](double t) { return t > 0.3 && t < 0.9 ? nan : 0.5 - t; }).kind == Kind::diverged);
}
