#include "core/spectrum/distortion.hpp"

#include <array>
#include <cmath>
#include <numbers>

#include "core/random.hpp"
#include "core/spectrum/twiddles.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

Complex circular(Random& random, double sigma) {
  const double re = random.normal(), im = random.normal();
  return sigma / std::numbers::sqrt2 * Complex{re, im};
}

}  // namespace

TEST_CASE("squares of an odd stimulus fall on even lines, cubes on odd ones, whatever the period does to them",
          "[distortion]") {
  constexpr int P = 16, N = 8, L = P * N;
  const std::array<int, 3> tones{3, 17, 37};  // classes 3, 1, 5; class 7 is silent
  for (const int order : {2, 3}) {
    std::array<double, L> y{};
    for (int n = 0; n < L; ++n) {
      double u = 0.0;
      for (const int q : tones) u += std::cos(2.0 * std::numbers::pi * q * n / L + q);
      const double gain = 1.0 + 0.5 * std::sin(2.0 * std::numbers::pi * n / N) + 0.2 * (n % N == 3);  // of period N
      y[static_cast<std::size_t>(n)] = gain * std::pow(u, order);
    }
    double even = 0.0, odd = 0.0, seen = 0.0;
    for (int q = 0; q < L; ++q) {
      Complex line{};
      for (int n = 0; n < L; ++n)
        line += y[static_cast<std::size_t>(n)] * root_of_unity(-std::int64_t{q} * n, L) / double(L);
      const LineKind kind = line_kind(q, P, tones);
      if (kind == LineKind::even) even += std::norm(line);
      if (kind == LineKind::odd) odd += std::norm(line);
      if (kind == LineKind::odd) CHECK(residue_class(q, P) == 7);
      seen += kind == LineKind::neither ? 0.0 : std::norm(line);
    }
    CHECK((order == 2 ? even : odd) > 0.05);
    CHECK((order == 2 ? odd : even) < 1e-24);
    CHECK(seen > 0.0);
  }
}

TEST_CASE("the level of distortion is sized, and none is claimed where there is none", "[distortion]") {
  Random random(5);
  int claims = 0;
  double sum = 0.0, sigma = 0.0, square = 0.0;
  constexpr int trials = 400;
  for (int t = 0; t < trials; ++t) {
    DistortionLevel silent, present;
    for (int q = 0; q < 40; ++q) {
      double variance = 0.0;  // of one period, from three degrees of freedom
      for (int k = 0; k < 3; ++k) variance += std::norm(circular(random, 1.0)) / 3.0;
      silent.add(circular(random, 0.5), variance, 4);
      present.add(std::polar(0.4, double(q)) + circular(random, 0.5), variance, 4);
    }
    claims += silent.chance() < 0.05 ? 1 : 0;
    sum += present.rms() / trials;
    square += (present.rms() - 0.4) * (present.rms() - 0.4) / trials;
    sigma += present.sigma() / trials;
    CHECK(silent.lines() == 40);
    CHECK(std::abs(silent.noise() - 0.5) < 0.2);
  }
  CHECK(std::abs(claims / double(trials) - 0.05) < 0.04);
  CHECK(std::abs(sum - 0.4) < 0.02);
  CHECK(std::abs(std::sqrt(square) / sigma - 1.0) < 0.3);
}

TEST_CASE("a ladder of amplitudes leads to amplitude zero with the least degree that fits", "[distortion]") {
  Random random(6);
  const std::array<double, 5> amplitude{0.1, 0.2, 0.4, 0.7, 1.0};
  constexpr double noise = 1e-3;
  const std::array<double, 5> sigma{noise, noise, noise, noise, noise};
  const auto ladder = [&](Complex c1, Complex c2) {
    std::array<Complex, 5> h;
    for (std::size_t i = 0; i < h.size(); ++i) {
      const double x = amplitude[i] * amplitude[i];
      h[i] = Complex{0.5, -0.2} + c1 * x + c2 * x * x + circular(random, noise);
    }
    return extrapolate_to_zero(amplitude, h, sigma);
  };
  const auto flat = ladder(0.0, 0.0), bent = ladder({0.03, 0.01}, 0.0), twice = ladder({0.03, 0.01}, {-0.2, 0.1});
  CHECK(flat.degree == 0);
  CHECK(bent.degree == 1);
  CHECK(twice.degree == 2);
  for (const auto& z : {flat, bent, twice}) {
    CHECK(z.fits);
    CHECK(std::abs(z.value - Complex{0.5, -0.2}) < 3.5 * z.sigma);
    CHECK(z.sigma < 2.5 * noise);
  }
  CHECK_FALSE(extrapolate_to_zero({}, {}, {}).fits);
}
