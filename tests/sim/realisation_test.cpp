#include "sim/realisation.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "core/orbit/orbit.hpp"
#include "core/random.hpp"
#include "core/spectrum/htf.hpp"
#include "sim/models/hopper_orbit.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

using System = LdtpOf<Hopper<>, 32>;

template <class Family>
const System& hopper_system(const Family& family) {
  static const auto system = [&] {
    auto s = std::make_unique<System>();
    const Hopper<> m;
    REQUIRE(find_orbit<32>(m, timebase_of(m, 512), family, *s).status == Status::ok);
    return s;
  }();
  return *system;
}

// Exact HTFs below 10 cycles a cycle at a resolution of 1/16.
HtfTable exact_table(const System& system) {
  HtfTable t;
  t.sections = 32;
  t.outputs = 2;
  for (int q = 1; q < 160; ++q) {
    if (q % 8 == 0) continue;
    const double omega = 2.0 * std::numbers::pi * q / 512;
    const auto h = htf(system, omega);
    Eigen::MatrixXcd value(32, 2);
    for (int m = 0; m < 32; ++m) value.row(m) = h(m).col(0).transpose();
    t.omega.push_back(omega);
    t.value.push_back(value);
    t.sigma.emplace_back(Eigen::MatrixXd::Zero(32, 2));
  }
  return t;
}

template <class Family>
void realises_exactly(const Family& family) {
  const System& system = hopper_system(family);
  const Realisation r = realise(exact_table(system));
  REQUIRE(r.multipliers.size() == 2);
  CHECK(std::abs(r.multipliers[0] - Complex(-0.248983334736, 0.699333251798)) < 1e-6);
  CHECK(r.error < 1e-5);
  CHECK(r.inconsistency < 1e-9);
  // Theorem 4 of Wendel & Ames: no more than the dimension of stance less one, two.
  CHECK(r.rank == 2);
  CHECK(r.model.dim(r.model.smallest_section()) == 2);
  for (int n = 0; n < 32; ++n) CHECK(r.model.dim(n) <= system.dim[static_cast<std::size_t>(n)]);
  // Between the lines it was made from, too.
  for (const double f : {0.03, 0.31, 1.77, 5.21, 9.4}) {
    const double omega = 2.0 * std::numbers::pi * f / 32.0;
    const auto exact = htf(system, omega);
    const Eigen::MatrixXcd h = r.model.htf(omega);
    for (int m = 0; m < 32; ++m) {
      for (int c = 0; c < 2; ++c) CHECK(std::abs(h(m, c) - exact(m)(c, 0)) < 1e-5 * (c == 0 ? 0.5 : 2.0));
    }
  }
}

}  // namespace

TEST_CASE("exact HTFs of the hopper give back its multipliers, its rank and its HTFs, isochrons", "[realisation]") {
  realises_exactly(ClockPhases{32});
}

TEST_CASE("exact HTFs of the hopper give back its multipliers, its rank and its HTFs, kinematic", "[realisation]") {
  realises_exactly(KinematicPhases{32});
}

TEST_CASE("noisy HTFs: the order is what stands above the noise, and the bootstrap says what remains",
          "[realisation]") {
  HtfTable t = exact_table(hopper_system(ClockPhases{32}));
  Random random(3);
  constexpr double level = 1e-4;
  for (std::size_t q = 0; q < t.omega.size(); ++q) {
    for (int m = 0; m < 32; ++m) {
      for (int c = 0; c < 2; ++c) {
        const double re = random.normal(), im = random.normal();
        t.value[q](m, c) += level / std::numbers::sqrt2 * Complex{re, im};
        t.sigma[q](m, c) = level;
      }
    }
  }
  RealisationOptions o;
  o.replicates = 12;
  const Realisation r = realise(t, o);
  REQUIRE(r.multipliers.size() == 2);
  REQUIRE(r.sigma.size() == 2);
  CHECK(r.model.dim(r.model.smallest_section()) == 2);
  CHECK(r.rank == 2);
  CHECK(r.singular.back() < r.threshold);
  const double off = std::abs(r.multipliers[0] - Complex(-0.248983334736, 0.699333251798));
  CHECK(off < 4.0 * r.sigma[0]);
  CHECK(r.sigma[0] < 0.02);
  CHECK(r.error_rms < 3.0 * level / 0.5);
}

TEST_CASE("what is exported is what was realised", "[realisation]") {
  const Realisation r = realise(exact_table(hopper_system(ClockPhases{32})));
  const auto j = nlohmann::json::parse(realisation_json(r));
  REQUIRE(j["A"].size() == 32);
  CHECK(j["A"][11].size() == 2);     // rows: the dimension in stance
  CHECK(j["A"][11][0].size() == 4);  // columns: that in flight
  CHECK(j["A"][5][1][2].get<double>() == r.model.A[5](1, 2));
  CHECK(j["multipliers"].size() == 2);
  std::size_t numbers = 0;
  for (int n = 0; n < 32; ++n) {
    const auto i = static_cast<std::size_t>(n);
    numbers += static_cast<std::size_t>(r.model.A[i].size() + r.model.B[i].size() + r.model.C[i].size());
  }
  const std::string csv = realisation_csv(r);
  CHECK(static_cast<std::size_t>(std::count(csv.begin(), csv.end(), '\n')) == numbers + 1);

  Ldtp<4, 1, 2, 32> fixed;
  REQUIRE(copy_to(r.model, fixed));
  const auto h = htf(fixed, 0.07);
  CHECK(std::abs(h(1)(0, 0) - r.model.htf(0.07)(1, 0)) < 1e-12);
  Ldtp<3, 1, 2, 32> small;
  CHECK_FALSE(copy_to(r.model, small));
}

TEST_CASE("too few lines, or an output that is silent, are refused", "[realisation]") {
  HtfTable t = exact_table(hopper_system(ClockPhases{32}));
  HtfTable few = t;
  few.omega.resize(40);
  few.value.resize(40);
  few.sigma.resize(40);
  CHECK_THROWS_AS(realise(few), std::invalid_argument);
  for (auto& v : t.value) v.col(1).setZero();
  CHECK_THROWS_AS(realise(t), std::invalid_argument);
}
