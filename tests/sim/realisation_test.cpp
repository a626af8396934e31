#include "sim/realisation.hpp"

#include <algorithm>
#include <array>
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

const Complex multiplier(-0.248983334736, 0.699333251798);

// Below 10 cycles a cycle at a resolution of 1/16.
HtfTable exact_table(const System& system) { return saltus::exact_table(system, 16, 10.0); }

template <class Family>
void realises_exactly(const Family& family) {
  const System& system = hopper_system(family);
  const Realisation r = realise(exact_table(system));
  REQUIRE(r.multipliers.size() == 2);
  CHECK(std::abs(r.multipliers[0] - multiplier) < 1e-6);
  CHECK(r.error < 1e-5);
  CHECK(r.inconsistency < 1e-9);
  // Theorem 4 of Wendel & Ames: no more than the dimension of stance less one, two.
  const Bounds bounds = rank_bounds(system);
  CHECK(bounds.lower == 0);  // touchdown takes two directions of four, and might take those that stance leaves by
  CHECK(bounds.upper == 2);
  CHECK(r.rank == 2);
  CHECK(r.stable());
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
  const double off = std::abs(r.multipliers[0] - multiplier);
  CHECK(off < 4.0 * r.sigma[0]);
  CHECK(r.sigma[0] < 0.02);
  CHECK(r.error_rms < 3.0 * level / 0.5);
}

namespace {

// What a campaign tells: H_-harmonics ... H_harmonics alone, with noise as large as `level` says of each output.
Identification measured(const System& system, int harmonics, const std::array<double, 2>& level, std::uint64_t seed) {
  Identification id;
  id.sections = 32;
  id.period = 16;
  Random random(seed);
  for (int line = 1; line < 160; ++line) {
    if (line % 8 == 0) continue;
    const auto h = htf(system, 2.0 * std::numbers::pi * line / 512);
    for (int m = -harmonics; m <= harmonics; ++m) {
      for (int c = 0; c < 2; ++c) {
        const double sigma = level[static_cast<std::size_t>(c)];
        const double re = random.normal(), im = random.normal();
        id.htf.push_back({m, line, c, h(m)(c, 0) + sigma / std::numbers::sqrt2 * Complex{re, im},
                          sigma > 0.0 ? sigma : std::nan(""), 64});
      }
    }
  }
  return id;
}

}  // namespace

TEST_CASE("without noise, harmonics that are missing are not taken for states", "[realisation]") {
  for (const System* system : {&hopper_system(ClockPhases{32}), &hopper_system(KinematicPhases{32})}) {
    const Realisation r = realise(measured(*system, 8, {0.0, 0.0}, 1), 2);
    CHECK(r.stable());
    CHECK(r.limit > 0.0);
    CHECK(r.threshold >= r.limit);
    for (int n = 0; n < 32; ++n) CHECK(r.model.dim(n) <= system->dim[static_cast<std::size_t>(n)]);
    REQUIRE(r.multipliers.size() == 2);
    REQUIRE(r.sigma.size() == 2);
    const double off = std::abs(r.multipliers[0] - multiplier);
    CHECK(off < 0.05);
    CHECK(off < 1.001 * r.sigma[0]);  // the distance to what the poles of all responses say, which is exact here
  }
}

TEST_CASE("the standard error of a realised multiplier takes in what was left out", "[realisation]") {
  const System& system = hopper_system(ClockPhases{32});
  int inside = 0;
  constexpr int trials = 20;
  for (std::uint64_t seed = 1; seed <= trials; ++seed) {
    const Realisation r = realise(measured(system, 3, {0.0016, 0.0094}, seed), 2);
    REQUIRE(r.multipliers.size() == 2);
    REQUIRE(r.sigma.size() == 2);
    inside += std::abs(r.multipliers[0] - multiplier) < 2.0 * r.sigma[0] ? 1 : 0;
  }
  // Twice a complex standard error holds 98 %; where they were right, fewer than 17 of 20 come once in 1500.
  CHECK(inside >= 17);
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
