#include "sim/multiplier_region.hpp"

#include <cmath>
#include <numbers>

#include "core/random.hpp"
#include "core/spectrum/twiddles.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

// A response that has the form exactly: h_m[r] of 8 sections and the multipliers 0.6 e^(+-0.7 pi i), by its geometric
// series; harmonics and outputs differ in their taps.
constexpr int N = 8, P = 32;
const Complex multiplier = std::polar(0.6, 0.7 * std::numbers::pi);

Complex response(int line, int m, int output) {
  Complex sum{};
  for (int j = 0; j < 3 * N; ++j) {
    const double tap = std::sin(1.0 + j * (1.3 + 0.2 * m) + output) * std::exp(-0.05 * j);
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

TEST_CASE("the ellipse is as wide as the errors are, and so is the bootstrap's", "[multipliers]") {
  Random random(2);
  int inside = 0, bootstrap_inside = 0;
  double square = 0.0, sigma = 0.0, chi = 0.0;
  constexpr int trials = 60;
  for (int t = 0; t < trials; ++t) {
    RegionOptions o;
    o.replicates = t < 15 ? 60 : 0;
    o.seed = static_cast<std::uint64_t>(t);
    const MultiplierRegion r = multiplier_region(table(0.05, random), 2, o);
    REQUIRE(r.status == Status::ok);
    inside += r.holds(0, multiplier, 0.95) ? 1 : 0;
    if (t < 15) bootstrap_inside += r.holds_by_bootstrap(0, multiplier, 0.95) ? 1 : 0;
    square += std::norm(r.multipliers[0] - multiplier) / trials;
    sigma += r.sigma(0) / trials;
    chi += r.chi_square / r.freedom / trials;
  }
  CHECK(inside >= 52);
  CHECK(bootstrap_inside >= 12);
  CHECK(std::abs(std::sqrt(square) / sigma - 1.0) < 0.25);
  CHECK(std::abs(chi - 1.0) < 0.05);
}

TEST_CASE("two estimates of one multiplier agree, those of different ones do not", "[multipliers]") {
  Random random(3);
  const MultiplierRegion a = multiplier_region(table(0.02, random), 2), b = multiplier_region(table(0.02, random), 2);
  CHECK(agreement(a, b, 0) > 0.001);
  MultiplierRegion off = b;
  off.multipliers[0] += 8.0 * b.sigma(0);
  CHECK(agreement(a, off, 0) < 1e-4);
}

TEST_CASE("too few lines are refused", "[multipliers]") {
  Random random(4);
  Identification id = table(0.1, random);
  std::erase_if(id.htf, [](const HtfEstimate& h) { return h.line > 12; });
  CHECK(multiplier_region(id, 2).status == Status::failed);
}
