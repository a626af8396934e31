#include "core/orbit/time_to_impact.hpp"

#include <Eigen/LU>

#include <cmath>
#include <numbers>

#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;

namespace {

// x' = -y, y' = x: turns about the origin; the guard is the y axis.
struct Plane : Chart<2> {};
struct Axis : Edge<Plane, Plane> {};
template <class S = double>
struct Turning {
  using Charts = List<Plane>;
  using Edges = List<Axis>;
  using U = Vec<0, S>;
  static constexpr std::string_view name = "turning";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"x", "-"}};
  S pull = 0.0;  // towards the unit circle: with 1, x' = -y + x (1 - r^2), y' = x + y (1 - r^2), a closed orbit of
                 // period 2 pi

  static constexpr auto parameters() { return std::array{Parameter{"pull", "-", &Turning::pull}}; }
  Vec<2, S> flow(Plane, const Vec<2, S>& x, const U&) const noexcept {
    const S p = pull * (1.0 - x[0] * x[0] - x[1] * x[1]);
    return {-x[1] + x[0] * p, x[0] + x[1] * p};
  }
  S guard(Axis, const Vec<2, S>& x, const U&) const noexcept { return x[0]; }
  Vec<2, S> reset(Axis, const Vec<2, S>& x, const U&) const noexcept { return x; }
  Vec<1, S> output(Plane, const Vec<2, S>& x, const U&) const noexcept { return Vec<1, S>(x[0]); }
  Start<Plane, S> start() const noexcept { return {Vec<2, S>{1.0, 0.0}}; }
};

// The same flow without a guard, so that the orbit closes.
template <class S = double>
struct Closed : Turning<S> {
  using Edges = List<>;
  static constexpr auto parameters() { return std::array{Parameter{"pull", "-", &Closed::pull}}; }
};

// The half line y = 0, x > 0, crossed upwards.
struct HalfLine {
  template <class M, class C>
  ScalarOf<M> value(const M&, C, const Vec<C::dim, ScalarOf<M>>& x, const Input<M>&) const noexcept {
    return -x[1];
  }
};

constexpr double pi = std::numbers::pi;

}  // namespace

TEST_CASE("a leg of a rotation has the derivatives of a rotation, and eqs. 1 and 4 in closed form") {
  const Turning<> m;
  const Leg<2> leg = follow_leg<2>(m, start_of(m), pi / 1000.0, 10.0, true);
  REQUIRE(leg.status == Status::ok);
  CHECK(leg.end == Leg<2>::End::edge);
  CHECK(leg.edge == 0);
  CHECK(std::abs(leg.duration - pi / 2.0) < 1e-11);
  CHECK((leg.x1 - Vec<2>(0.0, 1.0)).norm() < 1e-11);
  Mat<2, 2> rotation;
  rotation << 0.0, -1.0, 1.0, 0.0;
  CHECK((leg.Phi - rotation).norm() < 1e-11);
  CHECK((leg.dh - Vec<2>(1.0, 0.0)).norm() == 0.0);
  CHECK(std::abs(leg.rate + 1.0) < 1e-11);
  CHECK((time_to_impact_gradient(leg) - Vec<2>(0.0, -1.0)).norm() < 1e-11);
  Mat<2, 2> total;
  total << 0.0, 0.0, 1.0, 0.0;
  CHECK((total_derivative(leg) - total).norm() < 1e-11);
  CHECK((total_derivative(leg) * leg.f0).norm() < 1e-11);  // the kernel is the flow's direction
  CHECK(invariant_residual(leg) < 1e-11);
  CHECK(std::abs(transversality(leg) - 1.0) < 1e-11);
}

TEST_CASE("derivatives of the leg are those of finite differences, where there is no closed form") {
  Turning<> m;
  m.pull = 0.7;
  const auto end_of = [&](double dx, double dy) {
    return follow_leg<2>(m, at<Turning<>>(Plane{}, Vec<2>{1.3 + dx, 0.2 + dy}), 1e-3, 10.0, false);
  };
  const Leg<2> leg = follow_leg<2>(m, at<Turning<>>(Plane{}, Vec<2>{1.3, 0.2}), 1e-3, 10.0, true);
  const double h = 1e-5;
  for (int k = 0; k < 2; ++k) {
    const Leg<2> forth = end_of(k == 0 ? h : 0.0, k == 1 ? h : 0.0);
    const Leg<2> back = end_of(k == 0 ? -h : 0.0, k == 1 ? -h : 0.0);
    CHECK(std::abs((forth.duration - back.duration) / (2.0 * h) - time_to_impact_gradient(leg)[k]) < 1e-8);
    CHECK(((forth.x1 - back.x1) / (2.0 * h) - total_derivative(leg).col(k)).norm() < 1e-8);
  }
}

TEST_CASE(
    "of a closed orbit Dtau does not vanish and Dphi_tau has rank n - 1: the paper's C2 and 'only if' are false") {
  Closed<> m;
  m.pull = 1.0;
  const Leg<2> leg = follow_leg<2>(m, start_of(m), pi / 1000.0, 10.0, true, HalfLine{});
  REQUIRE(leg.end == Leg<2>::End::section);
  CHECK(std::abs(leg.duration - 2.0 * pi) < 1e-9);  // it is closed (C1)
  CHECK((leg.x1 - leg.x0).norm() < 1e-9);
  CHECK((leg.Phi * leg.f0 - leg.f0).norm() < 1e-8);                        // C3 holds
  CHECK(std::abs(time_to_impact_gradient(leg).dot(leg.f0) + 1.0) < 1e-9);  // and C2 does not

  // Phi_T = diag(e^-4pi, 1) in closed form: regular, with the trivial eigenvalue 1. Dphi_tau: rank 1 of 2, without it.
  const double kept = std::exp(-4.0 * pi);
  CHECK(std::abs(leg.Phi(0, 0) - kept) < 1e-9);
  CHECK(std::abs(leg.Phi(1, 1) - 1.0) < 1e-9);
  CHECK(std::abs(leg.Phi.determinant()) > 0.5 * kept);
  const Mat<2, 2> total = total_derivative(leg);
  CHECK(std::abs(total(0, 0) - kept) < 1e-9);
  CHECK(total.col(1).norm() < 1e-9);
  CHECK(total.row(1).norm() < 1e-9);
}

TEST_CASE("Dtau f = -1 whatever the leg") {
  Turning<> m;
  for (const double pull : {0.0, 0.4, 1.0}) {
    for (const double y : {0.0, 0.3, 0.9}) {
      m.pull = pull;
      const Leg<2> leg = follow_leg<2>(m, at<Turning<>>(Plane{}, Vec<2>{0.8, y}), 1e-3, 10.0, true);
      CHECK(std::abs(time_to_impact_gradient(leg).dot(leg.f0) + 1.0) < 1e-10);
    }
  }
}

TEST_CASE("a leg that is given a time ends there, on the plane normal to the flow") {
  const Turning<> m;
  const Leg<3> leg = follow_leg<3>(m, start_of(m), 0.01, 0.7, true);  // one coordinate of room to spare
  CHECK(leg.end == Leg<3>::End::time);
  CHECK(leg.duration == 0.7);
  CHECK(leg.dim == 2);
  CHECK((leg.x1 - Vec<3>(std::cos(0.7), std::sin(0.7), 0.0)).norm() < 1e-9);
  CHECK(leg.dh == leg.f1);
  CHECK(std::abs(transversality(leg) - 1.0) < 1e-14);
  CHECK(leg.Phi.row(2).norm() == 0.0);
  CHECK(leg.Phi.col(2).norm() == 0.0);
}

TEST_CASE("what the flow reports comes with the leg: grazing, and a state that leaves its chart") {
  worlds::Ball<> ball;
  ball.g = -1.0;  // dips to 0.5 v^2 under its start, and rises
  const auto dip = [&](double depth) {
    const double v = std::sqrt(2.0 * (1.0 + depth));
    return follow_leg<2>(ball, at<worlds::Ball<>>(worlds::ball::Air{}, Vec<2>{1.0, -v}), 0.01, 10.0, true);
  };
  CHECK(dip(-0.1).end == Leg<2>::End::time);
  CHECK(dip(0.1).end == Leg<2>::End::edge);
  CHECK(dip(0.1).status == Status::ok);
  CHECK(transversality(dip(1e-12)) < 1e-5);
  CHECK(dip(1e-12).status == Status::grazing);
  CHECK_FALSE(
      usable(follow_leg<2>(ball, at<worlds::Ball<>>(worlds::ball::Air{}, Vec<2>{-1.0, -1.0}), 0.01, 1.0, true).status));
}

TEST_CASE("the order of the leg's derivatives is four") {
  Turning<> m;
  m.pull = 0.7;
  const auto error = [&](double dt) {
    const Point<Turning<>> from = at<Turning<>>(Plane{}, Vec<2>{1.3, 0.2});
    const Leg<2> exact = follow_leg<2>(m, from, 1e-4, 10.0, true);
    return (total_derivative(follow_leg<2>(m, from, dt, 10.0, true)) - total_derivative(exact)).norm();
  };
  const double ratio = error(0.02) / error(0.01);
  CHECK(ratio > 13.0);
  CHECK(ratio < 19.0);
}

TEST_CASE("a leg does not allocate") {
  Turning<> m;
  m.pull = 0.7;
  const test::AllocationCount allocated;
  const Leg<2> leg = follow_leg<2>(m, start_of(m), 1e-3, 10.0, true);
  const double norm = total_derivative(leg).norm();
  CHECK(allocated() == 0);
  CHECK(std::isfinite(norm));
}
