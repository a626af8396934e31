#include "core/flow/linearise.hpp"

#include <cmath>

#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/effects.hpp"
#include "tests/support/malloc_guard.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;
using namespace saltus::worlds;

namespace {

// Largest disagreement between the derivatives of a tick and its central differences, over `ticks` ticks from the
// model's start. Ticks whose events differ between the two sides of a difference are passed over, and counted.
struct Agreement {
  double state = 0.0, input = 0.0, parameters = 0.0;
  int events = 0, compared = 0, passed_over = 0;
};

template <class M>
bool same_events(const Passage& a, const Passage& b) {
  if (a.status != Status::ok || b.status != Status::ok || a.events != b.events) return false;
  for (std::size_t i = 0; i < static_cast<std::size_t>(a.events); ++i) {
    if (a.event[i].edge != b.event[i].edge) return false;
  }
  return true;
}

template <class M>
Agreement agreement(const M& m, const Input<M>& u, double h, int ticks) {
  constexpr double step = 1e-5;
  Agreement r;
  Point<M> p = start_of(m);
  for (int tick = 0; tick < ticks; ++tick) {
    Point<M> end = p;
    Jacobian<M> exact;
    const Passage passage = linearise(m, end, u, h, exact);
    REQUIRE(passage.status == Status::ok);
    r.events += passage.events;
    bool comparable = true;
    // f(sign) runs the tick with something moved by sign * step.
    const auto difference = [&](auto f) -> Vec<max_dim<M>> {
      Point<M> forth = p;
      Point<M> back = p;
      const Passage a = f(forth, 1.0);
      const Passage b = f(back, -1.0);
      if (!same_events<M>(passage, a) || !same_events<M>(passage, b)) comparable = false;
      return (forth.x - back.x) / (2.0 * step);
    };
    Jacobian<M> rough;
    for (int i = 0; i < dim_of(p); ++i) {
      rough.state.col(i) = difference([&](Point<M>& q, double sign) {
        q.x[i] += sign * step;
        return advance(m, q, u, h);
      });
    }
    if constexpr (input_count < M >> 0)
      for (int i = 0; i < input_count<M>; ++i) {
        rough.input.col(i) = difference([&](Point<M>& q, double sign) {
          Input<M> v = u;
          v[i] += sign * step;
          return advance(m, q, v, h);
        });
      }
    if constexpr (parameter_count < M >> 0)
      for (int i = 0; i < parameter_count<M>; ++i) {
        rough.parameters.col(i) = difference([&](Point<M>& q, double sign) {
          M moved = m;
          int k = 0;
          visit_parameters(moved, [&](auto, auto, double& value) {
            if (k++ == i) value += sign * step;
          });
          return advance(moved, q, u, h);
        });
      }
    const auto worst = [](double so_far, const auto& a, const auto& b) {
      if constexpr (std::decay_t<decltype(a)>::SizeAtCompileTime == 0) {
        return so_far;
      } else {
        return std::fmax(so_far, (a - b).cwiseAbs().maxCoeff() / (1.0 + a.cwiseAbs().maxCoeff()));
      }
    };
    if (comparable) {
      ++r.compared;
      r.state = worst(r.state, exact.state, rough.state);
      r.input = worst(r.input, exact.input, rough.input);
      r.parameters = worst(r.parameters, exact.parameters, rough.parameters);
    } else {
      ++r.passed_over;
    }
    p = end;
  }
  return r;
}

template <class M>
void agrees(const M& m, const Input<M>& u, double h, int ticks, int events) {
  const Agreement a = agreement(m, u, h, ticks);
  CHECK(a.state < 1e-7);
  CHECK(a.input < 1e-7);
  CHECK(a.parameters < 1e-7);
  CHECK(a.events >= events);
  CHECK(a.passed_over <= ticks / 50);  // an event moved into the next tick, or a start moved behind a guard
}

template <int N>
Vec<N> input(double a) {
  return Vec<N>::Constant(a);
}

}  // namespace

TEST_CASE("saltation: the matrix of a bouncing ball is that of the closed form") {
  for (const double v : {-0.3, -2.0, -7.0}) {
    const Ball<> m;
    const auto s = saltation(m, ball::Impact{}, Vec<2>(0.0, v), Vec<1>(0.0));
    Mat<2, 2> exact;
    exact << -m.e, 0.0, -(1.0 + m.e) * m.g / v, -m.e;
    CHECK((s.state - exact).norm() < 1e-13);
    CHECK(s.rate == v);
    // A held force is gravity's equal.
    exact(1, 0) = -(1.0 + m.e) * (m.g - 1.5) / v;
    CHECK((saltation(m, ball::Impact{}, Vec<2>(0.0, v), Vec<1>(1.5)).state - exact).norm() < 1e-13);
  }
}

TEST_CASE("saltation: an edge between charts of different dimension") {
  // Touchdown keeps (y_M, v_M, clock): f- and f+ agree there but for the leg's length, which is the same, so that the
  // matrix is the projection plus the jump of the upper mass's acceleration, which is zero.
  const Hopper<> m;
  const Vec<5> x(1.6, -0.4, 2.2, 0.0, -0.7);
  const auto s = saltation(m, hopper::Touchdown{}, x, Vec<1>(0.0));
  Mat<3, 5> exact = Mat<3, 5>::Zero();
  exact.leftCols<3>().setIdentity();
  CHECK((s.state - exact).norm() < 1e-13);
  CHECK(s.rate == -0.7);
  // Liftoff starts the foot from rest with an acceleration of zero: the identity, and zeros.
  const Vec<3> y(2.2, 1.5, 0.0);
  Mat<5, 3> back = Mat<5, 3>::Zero();
  back.topRows<3>().setIdentity();
  CHECK((saltation(m, hopper::Liftoff{}, y, Vec<1>(0.0)).state - back).norm() < 1e-13);
}

TEST_CASE("linearise: the derivative of a spring and wall is that of the closed form, with order four") {
  const Wall<> m;
  const double T = 1.5;  // one impact
  const double t1 = std::acos(-m.d) / m.w;
  const auto turn = [&](double t) {
    Mat<2, 2> r;
    r << std::cos(m.w * t), std::sin(m.w * t) / m.w, -m.w * std::sin(m.w * t), std::cos(m.w * t);
    return r;
  };
  const double v = -m.w * std::sin(m.w * t1);
  Mat<2, 2> leap;
  leap << -m.e, 0.0, (1.0 + m.e) * m.w * m.w * m.d / v, -m.e;
  const Mat<2, 2> exact = turn(T - t1) * leap * turn(t1);
  double sx = 0.0, sy = 0.0, sxx = 0.0, sxy = 0.0;
  int count = 0;
  for (double n = 20.0; n < 400.0; n *= 1.11, ++count) {
    const int steps = static_cast<int>(n);
    Point<Wall<>> p = start_of(m);
    Mat<2, 2> product = Mat<2, 2>::Identity();
    for (int i = 0; i < steps; ++i) {
      Jacobian<Wall<>> j;
      REQUIRE(linearise(m, p, Vec<1>(0.0), T / steps, j).status == Status::ok);
      product = (j.state * product).eval();
    }
    const double x = std::log(1.0 / steps);
    const double y = std::log((product - exact).norm());
    sx += x;
    sy += y;
    sxx += x * x;
    sxy += x * y;
    if (steps > 300) CHECK((product - exact).norm() < 1e-7);
  }
  const double slope = (count * sxy - sx * sy) / (count * sxx - sx * sx);
  CHECK(slope > 3.7);
  CHECK(slope < 4.3);
}

TEST_CASE("linearise: derivatives agree with central differences, events or none") {
  SECTION("ball") { agrees(Ball<>{}, input<1>(0.3), 1.0 / 64.0, 150, 4); }
  SECTION("ball, several impacts in an interval") { agrees(Ball<>{}, input<1>(0.3), 0.6, 4, 4); }
  SECTION("spring and wall") { agrees(Wall<>{}, input<1>(-0.5), 1.0 / 256.0, 1000, 3); }
  SECTION("pendulum") { agrees(Pendulum<>{}, input<1>(-1.0), 1.0 / 256.0, 1000, 3); }
  SECTION("fork") {
    Fork<> m;
    m.b = 0.7;
    agrees(m, Vec<0>(), 0.03, 40, 1);
  }
  SECTION("box") { agrees(Box<>{}, Vec<0>(), 0.03, 300, 10); }
  SECTION("sawtooth, whose guard and reset see the input") { agrees(Sawtooth<>{}, Vec<2>(0.3, -0.1), 0.11, 100, 8); }
  SECTION("sawtooth, several events in an interval") { agrees(Sawtooth<>{}, Vec<2>(0.3, -0.1), 4.1, 10, 30); }
  SECTION("relaxation oscillator") { agrees(Relaxation<>{}, input<1>(0.1), 0.004, 300, 4); }
  SECTION("metronome") {
    Metronome<> m;
    m.shift = 0.3;
    agrees(m, input<1>(0.1), 1.0 / 128.0, 256, 3);
  }
  SECTION("hopper") {
    agrees(Hopper<>{}, input<1>(0.1), 1.0 / 512.0, 1024, 4);
    agrees(Hopper<>{}, input<1>(-0.3), 1.0 / 2048.0, 4096, 4);
  }
  SECTION("hopper with effects") {
    const With m(Hopper<>{}, Damper<hopper::Body>{}, Damper<hopper::Leg>{}, Cubic<hopper::Leg>{}, Wind<>{},
                 DeepGround<>{}, LossyTouchdown<>{}, InputGain<>{}, SensorError<>{});
    agrees(m, input<1>(0.1), 1.0 / 512.0, 1024, 4);
  }
}

TEST_CASE("linearise: nothing moves where nothing depends") {
  // A time-invariant step of a sawtooth: x1 = x0 + (rate + u_1) h.
  const Sawtooth<> m;
  Point<Sawtooth<>> p = start_of(m);
  Jacobian<Sawtooth<>> j;
  REQUIRE(linearise(m, p, Vec<2>(0.2, 0.0), 0.25, j).status == Status::ok);
  CHECK(j.state(0, 0) == 1.0);
  CHECK(j.input == Mat<1, 2>(0.0, 0.25));
  CHECK(j.parameters == Mat<1, 3>(0.25, 0.0, 0.0));
  // Through its event: x1 = share u_0 + (rate + u_1) h - (level + u_0) + x0.
  p = start_of(m);
  REQUIRE(linearise(m, p, Vec<2>(0.2, 0.0), 1.5, j).status == Status::ok);
  CHECK((j.state - Mat<1, 1>(1.0)).norm() < 1e-14);
  CHECK((j.input - Mat<1, 2>(0.5 - 1.0, 1.5)).norm() < 1e-14);
  CHECK((j.parameters - Mat<1, 3>(1.5, -1.0, 0.2)).norm() < 1e-14);
}

TEST_CASE("linearise: a tick that ends in trouble says so and leaves the derivatives alone") {
  const Ball<> m;
  Point<Ball<>> p = at<Ball<>>(ball::Air{}, Vec<2>(0.0, 0.0));
  Jacobian<Ball<>> j;
  j.state.setConstant(7.0);
  CHECK(linearise(m, p, Vec<1>(0.0), 0.01, j).status == Status::escaped);
  CHECK(j.state == Mat<2, 2>::Constant(7.0));
}

TEST_CASE("linearise: nothing is allocated") {
  const int ticks = test::counting() ? 20000 : 1000;
  const Hopper<> m;
  Point<Hopper<>> p = start_of(m);
  Jacobian<Hopper<>> j;
  Status status = Status::ok;
  const test::AllocationCount allocated;
  for (int i = 0; i < ticks; ++i) status = worse(status, linearise(m, p, Vec<1>(0.0), 1.0 / 512.0, j).status);
  CHECK(allocated() == 0);
  CHECK(status == Status::ok);
}
