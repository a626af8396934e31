#include "sim/multiplier_region.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>
#include <vector>

#include "core/orbit/orbit.hpp"
#include "core/random.hpp"
#include "core/spectrum/htf.hpp"
#include "core/spectrum/twiddles.hpp"
#include "sim/models/hopper_orbit.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

// A response that has the form exactly: h_m[r] of 8 sections and the multipliers 0.6 e^(+-0.7 pi i), by its geometric
// series; harmonics and outputs differ in their taps, which a real system has complex, and conjugate for -m.
constexpr int N = 8, P = 32;
const Complex multiplier = std::polar(0.6, 0.7 * std::numbers::pi);

Complex response(int line, int m, int output) {
  Complex sum{};
  for (int j = 0; j < 3 * N; ++j) {
    const double size = std::exp(-0.05 * j), angle = 1.0 + j * (1.3 + 0.2 * std::abs(m)) + output;
    const Complex tap{std::sin(angle) * size, m == 0 ? 0.0 : (m > 0 ? 1.0 : -1.0) * std::cos(1.7 * angle) * size};
    sum += tap * root_of_unity(-std::int64_t{line} * j, N * P);
  }
  const Complex w = root_of_unity(-std::int64_t{line} * N, N * P);
  return sum / ((1.0 - multiplier * w) * (1.0 - std::conj(multiplier) * w));
}

Identification table(double sigma, Random& random) {
  Identification id;
  id.sections = N;
  id.period = P;
  for (int m = -1; m <= 1; ++m) {
    for (int line = 1; line < 100; ++line) {
      if (line % (P / 2) == 0) continue;
      for (int c = 0; c < 2; ++c) {
        HtfEstimate h{m, line, c, response(line, m, c)};
        const double re = random.normal(), im = random.normal();
        h.value += sigma / std::numbers::sqrt2 * Complex{re, im};
        h.sigma = sigma;
        h.cycles = 4 * P;  // so well is it known
        id.htf.push_back(h);
      }
    }
  }
  return id;
}

}  // namespace

TEST_CASE("exact responses give the multipliers back", "[multipliers]") {
  Random random(1);
  Identification id = table(1e-12, random);
  const MultiplierRegion r = multiplier_region(id, 2);
  REQUIRE(r.status == Status::ok);
  CHECK(r.series == 6);
  CHECK(std::abs(r.multipliers[0] - multiplier) < 1e-9);
  CHECK(std::abs(r.multipliers[1] - std::conj(multiplier)) < 1e-9);
  for (auto& h : id.htf) h.sigma = std::nan("");
  CHECK(multiplier_region(id, 2).status == Status::missing);
}

namespace {

// The hopper's own harmonics, H_-3 ... H_3, at the lines below 10 cycles a cycle of a resolution of 1/16.
template <class Family>
Identification exact_hopper(const Family& family, const Hopper<>& m = {}) {
  const auto system = std::make_unique<LdtpOf<Hopper<>, 32>>();
  REQUIRE(find_orbit<32>(m, timebase_of(m, 512), family, *system).status == Status::ok);
  Identification id;
  id.sections = 32;
  id.period = 16;
  for (int line = 1; line < 160; ++line) {
    if (line % 8 == 0) continue;
    const auto h = htf(*system, 2.0 * std::numbers::pi * line / 512);
    for (int k = -3; k <= 3; ++k) {
      for (int c = 0; c < 2; ++c) id.htf.push_back({k, line, c, h(k)(c, 0)});
    }
  }
  return id;
}

template <class Family>
void multipliers_are_exact(const Family& family) {
  const Identification id = exact_hopper(family);
  for (const int harmonics : {0, 1, 3}) {
    RegionOptions o;
    o.harmonics = harmonics;
    const MultiplierRegion r = multiplier_region(id, 2, o);
    REQUIRE(r.status == Status::missing);  // no standard errors
    CHECK(r.series == 2 * (2 * harmonics + 1));
    // The reference, from the monodromy matrix, is good to 1e-8 itself: against it no closer; by harmonics, closer.
    CHECK(std::abs(r.multipliers[0] - Complex(-0.248983334736, 0.699333251798)) < 1e-9);
  }
}

}  // namespace

TEST_CASE("every harmonic of the hopper has its multipliers for poles, isochrons", "[multipliers]") {
  multipliers_are_exact(ClockPhases{32});
}

TEST_CASE("every harmonic of the hopper has its multipliers for poles, kinematic", "[multipliers]") {
  multipliers_are_exact(KinematicPhases{32});
}

TEST_CASE("harmonics that do not stand above the noise are left out", "[multipliers]") {
  Random random(5);
  Identification id = table(0.05, random);
  for (HtfEstimate& h : id.htf) {
    if (h.m == 0) continue;
    const double re = random.normal(), im = random.normal();
    h.value = 0.05 / std::numbers::sqrt2 * Complex{re, im};
  }
  const MultiplierRegion r = multiplier_region(id, 2);
  REQUIRE(r.status == Status::ok);
  CHECK(r.series == 2);
  RegionOptions o;
  o.harmonics = 0;
  const MultiplierRegion alone = multiplier_region(id, 2, o);
  CHECK(r.multipliers[0] == alone.multipliers[0]);
  CHECK(r.sigma(0) == alone.sigma(0));
}

TEST_CASE("the ellipse is as wide as the errors are, and so is the bootstrap's", "[multipliers]") {
  Random random(2);
  int inside = 0, bootstrap_inside = 0;
  double square = 0.0, sigma = 0.0, chi = 0.0;
  constexpr int trials = 200;
  for (int t = 0; t < trials; ++t) {
    RegionOptions o;
    o.replicates = t < 20 ? 40 : 0;
    o.seed = static_cast<std::uint64_t>(t);
    const MultiplierRegion r = multiplier_region(table(0.05, random), 2, o);
    REQUIRE(r.status == Status::ok);
    inside += r.holds(0, multiplier, 0.95) ? 1 : 0;
    if (t < 20) bootstrap_inside += r.holds_by_bootstrap(0, multiplier, 0.95) ? 1 : 0;
    square += std::norm(r.multipliers[0] - multiplier) / trials;
    sigma += r.sigma(0) / trials;
    chi += r.chi_square / r.freedom / trials;
  }
  // 190 +- 3.1 of 200 and 19 +- 1 of 20 are expected: within three of these, one run in 400 would fall outside.
  CHECK(std::abs(inside - 190) <= 9);
  CHECK(bootstrap_inside >= 16);
  CHECK(std::abs(std::sqrt(square) / sigma - 1.0) < 0.11);  // of 400 squares: 3.5 % one sigma
  CHECK(std::abs(chi - 1.0) < 0.01);                        // of 200 x 650 squares: 0.4 %
}

TEST_CASE("errors that go together widen the ellipse as much as they do the errors", "[multipliers]") {
  // One draw a line for all harmonics and outputs, along the responses themselves, as noise that went through a machine
  // at its resonance: it moves all of them to the poles of one other machine.
  Random random(8);
  const auto along = [](int line, int m, int c) { return response(line, m, c) / std::abs(response(line, m, c)); };
  int inside = 0, independent_inside = 0, bootstrap_inside = 0;
  double square = 0.0, sigma = 0.0;
  constexpr int trials = 200;
  for (int t = 0; t < trials; ++t) {
    Identification id = table(1e-12, random);
    std::map<int, Complex> error;
    for (HtfEstimate& h : id.htf) {
      if (error.count(h.line) == 0) {
        const double re = random.normal(), im = random.normal();
        error[h.line] = 0.05 / std::numbers::sqrt2 * Complex{re, im};
      }
      h.value += along(h.line, h.m, h.output) * error[h.line];
      h.sigma = 0.05;
    }
    independent_inside += multiplier_region(id, 2).holds(0, multiplier, 0.95) ? 1 : 0;
    for (const auto& [line, unused] : error) {
      ClassCorrelation together{line, 1, 1e9, 1e9, Eigen::MatrixXcd(6, 6)};
      Eigen::VectorXcd direction(6);
      for (int m = -1; m <= 1; ++m) {
        for (int c = 0; c < 2; ++c) direction[together.row(m, c)] = along(line, m, c);
      }
      together.matrix = direction * direction.adjoint();
      id.classes.push_back(together);
    }
    RegionOptions o;
    o.replicates = t < 20 ? 40 : 0;
    const MultiplierRegion r = multiplier_region(id, 2, o);
    REQUIRE(r.status == Status::ok);
    inside += r.holds(0, multiplier, 0.95) ? 1 : 0;
    if (t < 20) bootstrap_inside += r.holds_by_bootstrap(0, multiplier, 0.95) ? 1 : 0;
    square += std::norm(r.multipliers[0] - multiplier) / trials;
    sigma += r.sigma(0) / trials;
  }
  // As above: 190 +- 3.1, 19 +- 1, and 3.5 %.
  CHECK(std::abs(inside - 190) <= 9);
  CHECK(independent_inside < 160);
  CHECK(bootstrap_inside >= 16);
  CHECK(std::abs(std::sqrt(square) / sigma - 1.0) < 0.11);
}

TEST_CASE("two estimates of one multiplier agree, those of different ones do not", "[multipliers]") {
  Random random(3);
  const MultiplierRegion a = multiplier_region(table(0.02, random), 2), b = multiplier_region(table(0.02, random), 2);
  CHECK(agreement(a, b, 0) > 0.001);
  MultiplierRegion off = b;
  off.multipliers[0] += 8.0 * b.sigma(0);
  CHECK(agreement(a, off, 0) < 1e-4);
}

TEST_CASE("both families of sections tell the same multipliers, by chance alone apart", "[multipliers]") {
  Random random(6);
  // Noise that differs among the outputs as a campaign's does.
  const auto noisy = [&](Identification id) {
    for (HtfEstimate& h : id.htf) {
      h.sigma = h.output == 0 ? 0.0016 : 0.0094;
      h.cycles = 64;
      const double re = random.normal(), im = random.normal();
      h.value += h.sigma / std::numbers::sqrt2 * Complex{re, im};
    }
    return id;
  };
  const Hopper<> m;
  const Identification clock = exact_hopper(ClockPhases{32}, m), kinematic = exact_hopper(KinematicPhases{32}, m);
  RegionOptions o;
  o.harmonics = 0;
  std::vector<double> chance;
  for (int trial = 0; trial < 40; ++trial) {
    chance.push_back(agreement(multiplier_region(noisy(clock), 2, o), multiplier_region(noisy(kinematic), 2, o), 0));
  }
  std::sort(chance.begin(), chance.end());
  double furthest = 0.0;  // from the uniform distribution (Kolmogorov & Smirnov)
  for (std::size_t i = 0; i < chance.size(); ++i) {
    const double n = static_cast<double>(chance.size()), before = static_cast<double>(i) / n;
    furthest = std::max({furthest, chance[i] - before, before + 1.0 / n - chance[i]});
  }
  CHECK(furthest < 0.30);  // 1.95 / sqrt(40) is passed once in a thousand

  // Isochrons of a clock that turns 3 % faster, beside kinematic sections of the machine that was meant.
  Hopper<> fast = m;
  fast.omega *= 1.03;
  const Identification wrong = exact_hopper(ClockPhases{32}, fast);
  for (int trial = 0; trial < 3; ++trial) {
    CHECK(agreement(multiplier_region(noisy(wrong), 2, o), multiplier_region(noisy(kinematic), 2, o), 0) < 1e-3);
  }
}

TEST_CASE("too few lines are refused", "[multipliers]") {
  Random random(4);
  Identification id = table(0.1, random);
  std::erase_if(id.htf, [](const HtfEstimate& h) { return h.line > 12; });
  CHECK(multiplier_region(id, 2).status == Status::failed);
}
