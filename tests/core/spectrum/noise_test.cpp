#include "core/spectrum/noise.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "core/random.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;

namespace {

Complex circular(Random& random) {  // E |z|^2 = 1
  const double re = random.normal(), im = random.normal();
  return Complex{re, im} / std::sqrt(2.0);
}

}  // namespace

TEST_CASE("mean and covariance of a class, as the two-pass sums give them", "[noise]") {
  Random random(4);
  ClassNoise<3> noise;
  std::vector<std::array<Complex, 3>> all;
  for (int r = 0; r < 7; ++r) {
    const Complex a = circular(random), b = circular(random);
    const std::array<Complex, 3> y{Complex{5.0, -2.0} + a, 0.5 * a + b, Complex{0.0, 1e3} + b};
    all.push_back(y);
    const test::AllocationCount allocated;
    CHECK(noise.add(y));
    CHECK(allocated() == 0);
  }
  CHECK_FALSE(noise.add(std::array<Complex, 3>{Complex{std::nan(""), 0.0}, 0.0, 0.0}));
  CHECK(noise.periods() == 7);
  CHECK(noise.freedom() == 6);
  for (int i = 0; i < 3; ++i) {
    Complex mi{};
    for (const auto& y : all) mi += y[static_cast<std::size_t>(i)] / 7.0;
    CHECK(std::abs(noise.mean(i) - mi) < 1e-12);
    for (int j = 0; j < 3; ++j) {
      Complex mj{}, sum{};
      for (const auto& y : all) mj += y[static_cast<std::size_t>(j)] / 7.0;
      for (const auto& y : all)
        sum += (y[static_cast<std::size_t>(i)] - mi) * std::conj(y[static_cast<std::size_t>(j)] - mj);
      CHECK(std::abs(noise.covariance(i, j) - sum / 6.0) < 1e-10);
    }
  }
}

TEST_CASE("pooled neighbours add their degrees of freedom, not their means", "[noise]") {
  Random random(8);
  ClassNoise<2> pooled;
  for (int k = 0; k < 400; ++k) {
    ClassNoise<2> one;
    for (int r = 0; r < 4; ++r) {
      const Complex a = circular(random), b = circular(random);
      (void)one.add(std::array<Complex, 2>{Complex(k) + a, 2.0 * a + b});
    }
    k == 0 ? void(pooled = one) : pooled.pool(one);
  }
  CHECK(pooled.freedom() == 1200);
  CHECK(pooled.periods() == 4);
  CHECK(std::abs(pooled.mean(0)) < 2.0);
  CHECK(std::abs(pooled.covariance(0, 0) - 1.0) < 0.12);
  CHECK(std::abs(pooled.covariance(1, 1) - 5.0) < 0.6);
  CHECK(std::abs(pooled.covariance(1, 0) - 2.0) < 0.25);
  CHECK(std::abs(pooled.sigma(1) - std::sqrt(pooled.covariance(1, 1).real() / 4.0)) < 1e-14);
}

TEST_CASE("the confidence circle holds what it says, with few degrees of freedom too", "[noise]") {
  Random random(1);
  for (const int freedom : {1, 3, 20}) {
    int inside = 0;
    constexpr int trials = 20000;
    for (int t = 0; t < trials; ++t) {
      double sum = 0.0;
      for (int k = 0; k < freedom; ++k) sum += std::norm(circular(random));
      const double sigma = std::sqrt(sum / freedom);
      inside += std::abs(circular(random)) < confidence_radius(0.95, freedom) * sigma ? 1 : 0;
    }
    CHECK(std::abs(inside / double(trials) - 0.95) < 0.006);
  }
  CHECK(std::abs(confidence_radius(0.95, std::numeric_limits<double>::infinity()) - 1.7308183826) < 1e-9);
}

TEST_CASE("a harmonic that is not there is found as often as chance says", "[noise]") {
  Random random(2);
  int found = 0;
  constexpr int trials = 4000, lines = 30, freedom = 90;
  for (int t = 0; t < trials; ++t) {
    double square = 0.0, variance = 0.0;
    for (int q = 0; q < lines; ++q) square += std::norm(circular(random)) / lines;
    for (int k = 0; k < freedom; ++k) variance += std::norm(circular(random)) / freedom;
    found += chance_of(square / variance, lines, freedom) < 0.05 ? 1 : 0;
  }
  CHECK(std::abs(found / double(trials) - 0.05) < 0.012);
  CHECK(chance_of(2.0, 300, 1e6) < 1e-12);
  CHECK(chance_of(0.5, 300, 1e6) > 0.999);
}

TEST_CASE("coherence is the part of the power that repeats", "[noise]") {
  CHECK(std::abs(coherence({3.0, 4.0}, 0.0, 4) - 1.0) < 1e-15);
  CHECK(coherence({0.1, 0.0}, 1.0, 4) == 0.0);
  CHECK(std::abs(coherence({1.0, 0.5}, 1.0, 4) - 0.5) < 1e-15);
}
