#include "core/flow/rk4.hpp"

#include <cmath>

#include "core/scalar.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/plain.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;

namespace {

// Slope of log error over log step.
template <class E>
double order(const E& error) {
  return std::log2(error(0.02) / error(0.01));
}

}  // namespace

TEST_CASE("rk4: one step is of order five in its length, and exact for what is cubic in time") {
  // x' = x: e^h.
  const auto f = [](const Vec<1>& x) { return x; };
  const double slope = order([&](double h) {
    const Vec<1> x(1.0);
    return std::abs(rk4<1, double>(f, x, f(x), h)[0] - std::exp(h));
  });
  CHECK(slope > 4.9);
  CHECK(slope < 5.1);
  // (t, x), t' = 1, x' = 4 t^3 - 3 t^2 + 1: the quadrature is Simpson's, exact to degree three.
  const auto g = [](const Vec<2>& x) { return Vec<2>(1.0, 4.0 * x[0] * x[0] * x[0] - 3.0 * x[0] * x[0] + 1.0); };
  const Vec<2> x(0.3, 0.0);
  const double t = 0.3 + 0.7;
  const Vec<2> y = rk4<2, double>(g, x, g(x), 0.7);
  CHECK(std::abs(y[1] - ((t * t * t * t - t * t * t + t) - (0.0081 - 0.027 + 0.3))) < 1e-15);
}

TEST_CASE("rk4: is the textbook's") {
  const worlds::Pendulum<> m;
  const Vec<1> u(0.3);
  const auto f = [&](const Vec<2>& x) -> Vec<2> { return m.flow(worlds::pendulum::Swing{}, x, u); };
  for (const double h : {-0.1, 0.0, 1e-3, 0.1}) {
    const Vec<2> x(0.4, -1.3);
    CHECK((rk4<2, double>(f, x, f(x), h) - plain::rk4(m, worlds::pendulum::Swing{}, x, u, h)).norm() < 1e-15);
  }
}

TEMPLATE_TEST_CASE("a step over dual numbers: its derivative is that of the step itself", "", Rk4, Rk8) {
  const worlds::Pendulum<> m;
  const auto lifted = lift<Dual<3>>(m);
  const auto f = [&](const Vec<2, Dual<3>>& x) -> Vec<2, Dual<3>> {
    return lifted.flow(worlds::pendulum::Swing{}, x, Vec<1, Dual<3>>(Dual<3>(0.3)));
  };
  const Vec<2, Dual<3>> x(Dual<3>::variable(0.4, 0), Dual<3>::variable(-1.3, 1));
  const Dual<3> h = Dual<3>::variable(0.05, 2);  // the length may be a variable too
  const Mat<2, 3> exact = gradient_of(TestType::template step<2, Dual<3>>(f, x, f(x), h));
  const auto step = [&](double a, double b, double length) {
    return plain::step<TestType>(m, worlds::pendulum::Swing{}, Vec<2>(a, b), Vec<1>(0.3), length);
  };
  const double d = 1e-6;
  Mat<2, 3> rough;
  rough.col(0) = (step(0.4 + d, -1.3, 0.05) - step(0.4 - d, -1.3, 0.05)) / (2.0 * d);
  rough.col(1) = (step(0.4, -1.3 + d, 0.05) - step(0.4, -1.3 - d, 0.05)) / (2.0 * d);
  rough.col(2) = (step(0.4, -1.3, 0.05 + d) - step(0.4, -1.3, 0.05 - d)) / (2.0 * d);
  CHECK((exact - rough).cwiseAbs().maxCoeff() < 1e-8);
}

TEST_CASE("hermite: meets both ends with their slopes, is exact for cubics and of order four") {
  const auto cubic = [](double t) { return Vec<2>(2.0 * t * t * t - t * t + 3.0, 1.0 - t); };
  const auto slope = [](double t) { return Vec<2>(6.0 * t * t - 2.0 * t, -1.0); };
  const Hermite<2> curve{cubic(0.5), slope(0.5), cubic(1.7), slope(1.7), 1.2};
  CHECK(curve(0.0) == cubic(0.5));
  CHECK(curve(1.0) == cubic(1.7));
  for (const double s : {0.1, 0.35, 0.5, 0.99}) CHECK((curve(s) - cubic(0.5 + 1.2 * s)).norm() < 1e-14);

  const double rate = order([](double h) {
    const Hermite<1> c{Vec<1>(1.0), Vec<1>(1.0), Vec<1>(std::exp(h)), Vec<1>(std::exp(h)), h};
    return std::abs(c(0.5)[0] - std::exp(0.5 * h));
  });
  CHECK(rate > 3.9);
  CHECK(rate < 4.1);
}
