#include "sim/models/zero_rank.hpp"

#include <cmath>
#include <numbers>

#include "tests/support/laws.hpp"
#include "tests/support/orbit_laws.hpp"

using namespace saltus;
using test::cycle_of;

TEST_CASE("zero rank: keeps the laws of models and of cycles") {
  const ZeroRank<> m;
  obeys_laws(m, 800, 11, 128);
  test::obeys_cycle_laws(m, *cycle_of(m));
}

TEST_CASE("zero rank: the orbit and its derivatives are known in closed form") {
  const ZeroRank<> m;
  const auto c = cycle_of(m, start_of(m), 1024);
  REQUIRE(c->fine.count == 2);
  const double tolerance = 1e-10;
  const double pi = std::numbers::pi;
  CHECK(std::abs(c->fine.period() - pi) < tolerance);
  const auto& first = c->fine[0];  // E1, then the leg in D2
  const auto& second = c->fine[1];
  REQUIRE(first.edge == 0);
  test::has_state(first.x, tolerance, 0.0, 1.0);
  test::has_state(first.leg.x0, tolerance, 0.0, 1.0, 0.0);
  test::has_state(second.x, tolerance, 0.0, 0.0, 1.0);
  test::has_state(second.leg.x0, tolerance, 1.0, 0.0);
  CHECK(std::abs(first.leg.duration - pi / 2.0) < tolerance);
  CHECK(std::abs(second.leg.duration - pi / 2.0) < tolerance);

  Mat<orbit_width, orbit_width> d1 = Mat<orbit_width, orbit_width>::Zero();
  d1(1, 0) = std::exp(-pi);
  CHECK((total_derivative(second.leg) - d1).cwiseAbs().maxCoeff() < tolerance);
  Mat<orbit_width, orbit_width> d2 = Mat<orbit_width, orbit_width>::Zero();
  d2(0, 0) = std::exp(-pi / 2.0);
  d2(2, 1) = 1.0;
  CHECK((total_derivative(first.leg) - d2).cwiseAbs().maxCoeff() < tolerance);
}

TEST_CASE("zero rank: DP_1 = 0, but DP_2 has rank 1 and is nilpotent, where the paper prints 0 for both") {
  const ZeroRank<> m;
  const auto c = cycle_of(m);
  const auto& d1 = c->analysis.guard[0];
  const auto& d2 = c->analysis.guard[1];
  CHECK(d1.rank.value == 0);
  CHECK(d2.rank.value == 1);
  CHECK(std::abs(d2.rank.sigma[0] - std::exp(-std::numbers::pi)) < 1e-10);
  CHECK(d1.bounds == Bounds{0, 1});
  CHECK(d2.bounds == Bounds{0, 1});
  // Rank and the number of non-zero multipliers are different questions: both spectra are {0}.
  CHECK(d1.spectrum.nonzero == 0);
  CHECK(d2.spectrum.nonzero == 0);
  CHECK(d1.spectrum.index == 1);
  CHECK(d2.spectrum.index == 2);
  const Mat<orbit_width, orbit_width> p2 = return_map(c->fine, 1) * onto_guard(c->fine, 1);
  CHECK(p2.cwiseAbs().maxCoeff() > 0.04);
  CHECK((p2 * p2).cwiseAbs().maxCoeff() < 1e-12);
  CHECK(d1.zeros.chain == 1);
  CHECK(d2.zeros.dimension == 1);
  CHECK(d2.zeros.nilpotent == 1);
  CHECK(c->analysis.edge[0].reset.value == 1);
  CHECK(c->analysis.edge[1].reset.value == 1);
}

TEST_CASE("zero rank: a zero that is known to within 1e-3 only is no zero") {
  const auto c = cycle_of(ZeroRank<>{});
  c->coarse[0].leg.Phi(0, 1) += 0.05;  // DP_1 is then off by 0.05 e^-pi with the larger step
  const auto a = analyse(c->coarse, c->fine);
  CHECK(a.guard[0].rank.value == 0);
  CHECK(a.guard[0].spectrum.error[0] > 1e-3);
  CHECK(a.doubt == Doubt::undecided_rank);
  CHECK(a.finer);
}

TEST_CASE("zero rank: a perturbation is gone after the second passage, as the matrices say") {
  const ZeroRank<> m;
  // From just after E2 at x = dx beside the cycle: the first return remembers it in z, the second does not.
  const auto returned = [&](double dx, int times) {
    Point<ZeroRank<>> p = at<ZeroRank<>>(zero_rank::D1{}, Vec<2>{1.0 + dx, 0.0});
    double z = 0.0;
    for (int i = 0; i < times; ++i) {
      const auto in_d1 = follow_leg<3>(m, p, 1e-3, 10.0, false);
      p = at<ZeroRank<>>(zero_rank::D2{}, m.reset(zero_rank::E1{}, in_d1.x1.head<2>(), Vec<0>{}));
      const auto in_d2 = follow_leg<3>(m, p, 1e-3, 10.0, false);
      z = in_d2.x1[2];
      p = at<ZeroRank<>>(zero_rank::D1{}, m.reset(zero_rank::E2{}, in_d2.x1, Vec<0>{}));
    }
    return z - 1.0;
  };
  CHECK(std::abs(returned(1e-4, 1) - 1e-4 * std::exp(-std::numbers::pi)) < 1e-8);
  CHECK(std::abs(returned(1e-4, 2)) < 1e-10);
}
