// The models of machines that records are of: pendulum, leg bench, compass-gait robot.
#include <cmath>
#include <numbers>

#include "core/flow/advance.hpp"
#include "sim/models/compass_gait.hpp"
#include "sim/models/compass_gait_robot.hpp"
#include "sim/models/leg_bench.hpp"
#include "sim/models/pendulum.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

template <class M, class C>
Vec<C::dim> rate(const M& m, C c, const Vec<C::dim>& x, double u) {
  return m.flow(c, x, Input<M>(u));
}

// Rate of change of a chart's energy along the flow, by central differences.
template <class M, class C>
double power(const M& m, C c, const Vec<C::dim>& x, double u) {
  const Vec<C::dim> f = rate(m, c, x, u);
  constexpr double h = 1e-5;
  return (m.energy(c, Vec<C::dim>(x + h * f)) - m.energy(c, Vec<C::dim>(x - h * f))) / (2.0 * h);
}

}  // namespace

TEST_CASE("a pendulum swings at the root of weight over inertia, and its rotor counts by the gear squared") {
  Pendulum<> p;
  const double small = 1e-6;
  CHECK(std::abs(rate(p, Pendulum<>::Swing{}, Vec<2>(small, 0.0), 0.0)[1] / small + p.mgl / p.inertia) < 1e-9);
  p.gear = 6.0;
  p.rotor_inertia = 6.07e-5;
  CHECK(std::abs(rate(p, Pendulum<>::Swing{}, Vec<2>(0.0, 0.0), 1.0)[1] - 1.0 / (0.1495 + 36.0 * 6.07e-5)) < 1e-12);
  CHECK(std::abs(power(p, Pendulum<>::Swing{}, Vec<2>(1.1, -2.0), 0.3) - 0.3 * -2.0) < 1e-8);
}

TEST_CASE("the leg on its bench is driven by the motor's constant") {
  const LegBench<> m;
  const double torque = m.motor_constant * 5.0;
  CHECK(std::abs(power(m, LegBench<>::Swing{}, Vec<2>(0.4, 3.0), 5.0) - torque * 3.0) < 1e-8);
  // It rests where weight and motor balance.
  const double rest = std::asin(torque / (m.mass * m.g * m.com));
  CHECK(std::abs(rate(m, LegBench<>::Swing{}, Vec<2>(rest, 0.0), 5.0)[1]) < 1e-12);
}

TEST_CASE("the robot gains what its motor gives, along the angle of its hip, whichever leg stands") {
  const CompassGaitRobot<> m;
  const Vec<4> x(0.3, 0.12, -1.7, 0.6);
  CHECK(std::abs(power(m, CompassGaitRobot<>::Outer{}, x, 0.7) - m.motor_constant * 0.7 * x[2]) < 1e-8);
  CHECK(std::abs(power(m, CompassGaitRobot<>::Inner{}, x, 0.7) - m.motor_constant * 0.7 * x[2]) < 1e-8);
}

TEST_CASE("with legs of point masses and no boom the robot is the compass gait on level ground") {
  CompassGaitRobot<> m;
  m.com_inner = m.com_outer = 0.1;
  m.inertia_inner = m.inertia_outer = m.leg_mass * 0.1 * 0.1;
  m.hip_gravity_mass = m.hip_mass;
  CompassGait<> c;
  c.hip_mass = m.hip_mass;
  c.leg_mass = m.leg_mass;
  c.b = 0.1;
  c.a = m.leg_length - 0.1;
  c.slope = 0.0;
  c.g = m.g;
  // There, angles lean the other way: the standing leg's is `stance`, the swinging one's stance + hip (inner standing).
  const Vec<4> x(0.25, -0.1, 0.8, -0.9);
  const auto robot = rate(m, CompassGaitRobot<>::Inner{}, x, 0.0);
  const Vec<4> y(x[1] + x[0], x[1], x[3] + x[2], x[3]);
  const Vec<4> gait = c.flow(CompassGait<>::Swing{}, y, Vec<0>());
  CHECK(std::abs(robot[3] - gait[3]) < 1e-10);
  CHECK(std::abs(robot[2] + robot[3] - gait[2]) < 1e-10);
  // And so is its impact.
  const Vec<4> after = m.reset(CompassGaitRobot<>::OuterImpact{}, x, Vec<1>(0.0));
  const Vec<4> gait_after = c.reset(CompassGait<>::Impact{}, y, Vec<0>());
  CHECK(std::abs(after[1] - gait_after[1]) < 1e-12);
  CHECK(std::abs(after[3] - gait_after[3]) < 1e-10);
  CHECK(std::abs(after[3] - after[2] - gait_after[2]) < 1e-10);
}

TEST_CASE("a foot that meets the ground keeps the angle of the hip and loses energy") {
  const CompassGaitRobot<> m;
  const Vec<4> x(0.36, -0.18, 0.5, -1.2);
  const Vec<4> y = m.reset(CompassGaitRobot<>::OuterImpact{}, x, Vec<1>(0.0));
  CHECK(y[0] == x[0]);
  CHECK(std::abs(y[1] - 0.18) < 1e-12);
  CompassGaitRobot<> weightless = m;
  weightless.g = 0.0;
  CHECK(weightless.energy(CompassGaitRobot<>::Outer{}, y) < weightless.energy(CompassGaitRobot<>::Inner{}, x));
}
