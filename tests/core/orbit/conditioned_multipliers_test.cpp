#include "core/orbit/conditioned_multipliers.hpp"

#include <random>

#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;

namespace saltus {
template ConditionedMultipliers<4> conditioned_multipliers<4>(const Measured<4>&, int, Rank<4>) noexcept;
}

namespace {

using M4 = Mat<4, 4>;
const M4 exact = M4::Zero();

M4 of(std::initializer_list<double> rows) {
  M4 m;
  int i = 0;
  for (const double x : rows) {
    m(i / 4, i % 4) = x;
    ++i;
  }
  return m;
}

double distance(const Complex& a, const Complex& b) { return std::abs(a - b); }

}  // namespace

TEST_CASE("multipliers of a matrix of full rank are its eigenvalues, by falling modulus, the upper conjugate first") {
  // Companion matrix of (z - 3)(z^2 - z + 1/2)(z + 1/4).
  const M4 c = of({3.75, -2.5, 0.625, 0.375, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0});
  const auto m = conditioned_multipliers<4>(c, 4, 1e-12, exact);
  REQUIRE(m.status == Status::ok);
  CHECK(m.nonzero == 4);
  CHECK(m.index == 0);
  CHECK(distance(m.value[0], 3.0) < 1e-13);
  CHECK(distance(m.value[1], Complex(0.5, 0.5)) < 1e-13);
  CHECK(distance(m.value[2], Complex(0.5, -0.5)) < 1e-13);
  CHECK(distance(m.value[3], -0.25) < 1e-13);
}

TEST_CASE("a nilpotent part shows as zeros, not as a ring of small numbers") {
  // One Jordan block of three zeros beside 0.5, moved by 1e-12: its eigenvalues are then of size 1e-4.
  M4 j = of({0.5, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1e-12, 0.0, 0.0});
  const auto m = conditioned_multipliers<4>(j, 4, 1e-10, M4::Constant(1e-12));
  REQUIRE(m.status == Status::ok);
  CHECK(m.nonzero == 1);
  CHECK(m.index == 3);
  CHECK(distance(m.value[0], 0.5) < 1e-11);
  for (std::size_t i = 1; i < 4; ++i) {
    CHECK(m.value[i] == 0.0);
    CHECK(m.error[i] > 1e-4);  // the error of such a zero is the cube root of the matrix's
    CHECK(m.error[i] < 1e-2);
  }
  const auto rank_one =
      conditioned_multipliers<4>(of({0, 0, 0, 0, 0.04, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}), 3, 1e-12, exact);
  CHECK(rank_one.nonzero == 0);
  CHECK(rank_one.index == 2);
  const auto zero = conditioned_multipliers<4>(M4(M4::Zero()), 3, 0.0, exact);
  CHECK(zero.status == Status::ok);
  CHECK(zero.nonzero == 0);
  CHECK(zero.index == 1);
  CHECK(zero.error[0] == 0.0);
}

TEST_CASE("the errors bound what an error of the matrix does to its multipliers, closely enough") {
  std::mt19937_64 random(17);
  std::normal_distribution<double> normal;
  const auto random_matrix = [&] {
    M4 m;
    for (int i = 0; i < 16; ++i) m.data()[i] = normal(random);
    return m;
  };
  double closest = 0.0;
  for (int trial = 0; trial < 50; ++trial) {
    M4 m = random_matrix();
    if (trial % 2 == 0) m.row(3) = m.row(2);   // rank 3
    const Vec<4> scale(1.0, 1e2, 1e-1, 10.0);  // coordinates of very different units
    m = (scale.asDiagonal() * m * scale.cwiseInverse().asDiagonal()).eval();
    const auto clean = conditioned_multipliers<4>(m, 4, 1e-7, exact);
    REQUIRE(clean.status == Status::ok);
    M4 size = random_matrix().cwiseAbs();
    size = (1e-7 * scale.asDiagonal() * size * scale.cwiseInverse().asDiagonal()).eval();
    const auto told = conditioned_multipliers<4>(m, 4, 1e-7, size);
    for (int flip = 0; flip < 10; ++flip) {
      const M4 moved = m + size.cwiseProduct(random_matrix().cwiseSign());
      const Eigen::EigenSolver<M4> other(moved, true);
      for (int i = 0; i < told.nonzero; ++i) {
        const auto at = static_cast<std::size_t>(i);
        double nearest = 1e300;
        for (int k = 0; k < 4; ++k) nearest = std::min(nearest, distance(told.value[at], other.eigenvalues()[k]));
        CHECK(nearest <= 1.01 * told.error[at] + 1e-12);
        closest = std::max(closest, nearest / told.error[at]);
      }
    }
  }
  CHECK(closest > 0.3);  // and not by orders of magnitude
}

TEST_CASE("where eigenvectors coincide the error is still a bound") {
  // A Jordan block of 0.5 twice: a change of 1e-10 moves them by 1e-5.
  const M4 j = of({0.5, 1.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.2});
  const auto m = conditioned_multipliers<4>(j, 4, 1e-9, M4::Constant(1e-10));
  REQUIRE(m.status == Status::ok);
  CHECK(std::isfinite(m.error[0]));
  CHECK(m.error[0] > 1e-5);
  CHECK(m.error[3] < 1e-9);
}

TEST_CASE("undecided ranks and non-finite matrices have no multipliers") {
  CHECK(conditioned_multipliers<4>(of({1, 0, 0, 0, 0, 3e-9, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}), 4, 1e-9, exact).status ==
        Status::failed);
  M4 bad = M4::Identity();
  bad(2, 1) = std::nan("");
  CHECK(conditioned_multipliers<4>(bad, 4, 1e-9, exact).status == Status::failed);
}

TEST_CASE("a multiplier below its error is zero within that, and the others are told all the same") {
  // Of rank 3, by a theorem; its smallest multiplier drowns, and says nothing of the largest.
  const M4 a = M4(Vec<4>(-200.0, 0.25, 1e-9, 0.0).asDiagonal());
  const M4 error = M4(Vec<4>(1e-8, 1e-8, 1e-8, 0.0).asDiagonal());
  const Measured<4> m{a, a, 1e-7, 1e-13, error};
  const auto told = conditioned_multipliers<4>(m, 4, rank_of<4>(m, {3, 3}));
  REQUIRE(told.status == Status::ok);
  CHECK(told.nonzero == 2);
  CHECK(told.untold == 1);
  CHECK(distance(told.value[0], -200.0) < 1e-10);
  CHECK(told.error[0] < 1e-7);
  CHECK(told.value[2] == 0.0);
  CHECK(told.error[2] > 1e-9);  // it holds the truth
  CHECK(told.error[2] < 1e-6);

  // Where the rank is undecided the numbers are there with their errors, for whoever needs no rank.
  const auto undecided = conditioned_multipliers<4>(m, 4, rank_of<4>(m, {0, 3}));
  CHECK(undecided.status == Status::failed);
  CHECK(undecided.nonzero == 2);
  CHECK(distance(undecided.value[0], -200.0) <= undecided.error[0] + 1e-10);

  // Known better elsewhere, it is the partner of the zero that it was here.
  const Measured<4> finer{a, a, 1e-11, 1e-13, 1e-5 * error};
  const auto better = conditioned_multipliers<4>(finer, 4, rank_of<4>(finer, {3, 3}));
  CHECK(better.nonzero == 3);
  CHECK(std::abs(spectral_distance(told, better) - 1e-9) < 1e-12);
  CHECK(spectral_distance(told, better) <= allowed_distance(told, better));
}

TEST_CASE("spectra are compared as sets, and only when equally many") {
  const auto a = conditioned_multipliers<4>(M4(Vec<4>(0.5, -0.5, 0.3, 0.0).asDiagonal()), 4, 1e-9, exact);
  const auto b = conditioned_multipliers<4>(M4(Vec<4>(0.0, 0.3, -0.5 + 1e-6, 0.5).asDiagonal()), 4, 1e-9, exact);
  const auto c = conditioned_multipliers<4>(M4(Vec<4>(0.5, -0.5, 0.3, 0.1).asDiagonal()), 4, 1e-9, exact);
  CHECK(std::abs(spectral_distance(a, b) - 1e-6) < 1e-12);
  CHECK(std::isinf(spectral_distance(a, c)));
}

TEST_CASE("multipliers do not allocate") {
  const M4 m = of({3.75, -2.5, 0.625, 0.375, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0});
  const test::AllocationCount allocated;
  const auto r = conditioned_multipliers<4>(m, 4, 1e-12, exact);
  CHECK(allocated() == 0);
  CHECK(r.nonzero == 4);
}
