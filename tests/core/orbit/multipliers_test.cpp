#include "core/orbit/multipliers.hpp"

#include <cmath>
#include <limits>
#include <memory>

#include "core/orbit/orbit.hpp"
#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;

namespace {

const Complex lambda(-0.248983334736, 0.699333251798);

// The four multipliers are lambda, its conjugate and two zeros.
void are_the_hoppers(const Mat<4, 4>& monodromy) {
  const auto found = multipliers<4>(monodromy);
  CHECK(std::abs(found[0] - lambda) < 1e-8);
  CHECK(std::abs(found[1] - std::conj(lambda)) < 1e-8);
  CHECK(std::abs(found[2]) < 1e-8);
  CHECK(std::abs(found[3]) < 1e-8);
}

template <int N, class Family>
void on_every_section(const Family& family) {
  const Hopper<> m;
  const auto system = std::make_unique<LdtpOf<Hopper<>, N>>();
  const auto orbit = find_orbit<N>(m, timebase_of(m, 512), family, *system);
  REQUIRE(orbit.status == Status::ok);
  for (int n = 0; n < N; ++n) are_the_hoppers(system->monodromy(n));
}

}  // namespace

TEST_CASE("multipliers: the hopper's are the same on every section of every family") {
  SECTION("clock phases") { on_every_section<32>(ClockPhases{}); }
  SECTION("kinematic phases") { on_every_section<32>(KinematicPhases{}); }
  SECTION("other numbers of them") {
    on_every_section<8>(ClockPhases{8});
    on_every_section<5>(KinematicPhases{5});
  }
  SECTION("touchdown") { on_every_section<1>(AtEdge<hopper::Touchdown>{}); }
  SECTION("liftoff") { on_every_section<1>(AtEdge<hopper::Liftoff>{}); }
}

TEST_CASE("multipliers: fall in modulus, the upper of a pair first") {
  Mat<4, 4> a = Mat<4, 4>::Zero();
  a(0, 0) = 0.1;
  a.block<2, 2>(1, 1) << 0.3, 0.4, -0.4, 0.3;
  a(3, 3) = -2.0;
  const auto r = multipliers<4>(a);
  CHECK(std::abs(r[0] + 2.0) < 1e-14);
  CHECK(std::abs(r[1] - Complex(0.3, 0.4)) < 1e-14);
  CHECK(std::abs(r[2] - Complex(0.3, -0.4)) < 1e-14);
  CHECK(std::abs(r[3] - 0.1) < 1e-14);
}

TEST_CASE("multipliers: of a matrix that is not finite are not finite") {
  Mat<4, 4> a = Mat<4, 4>::Identity();
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    a(1, 2) = bad;
    for (const Complex& z : multipliers<4>(a)) CHECK_FALSE(std::isfinite(z.real()));
  }
}

TEST_CASE("multipliers: nothing is allocated") {
  Mat<4, 4> a;
  a << 1, 2, 3, 4, 5, 6, 7, 8, 9, 1, 2, 3, 4, 5, 6, 8;
  const test::AllocationCount allocated;
  const auto r = multipliers<4>(a);
  CHECK(allocated() == 0);
  CHECK(std::abs(r[0]) >= std::abs(r[3]));
}
