#include "core/spectrum/stimulus.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

constexpr int L = 96;

Multisine<4> three_tones() {
  Multisine<4> u(L);
  REQUIRE(u.add({5, 0.7, 0.3}));
  REQUIRE(u.add({11, 1.1, -2.0}));
  REQUIRE(u.add({40, 0.2, 1.0}));
  return u;
}

Complex direct_line(const Multisine<4>& u, int q) {
  std::complex<long double> sum{};
  for (int n = 0; n < L; ++n) {
    const long double angle = -2.0L * std::numbers::pi_v<long double> * static_cast<long double>(q * n % L) / L;
    sum += static_cast<long double>(u(n)) * std::complex<long double>{std::cos(angle), std::sin(angle)};
  }
  return {static_cast<double>(sum.real() / L), static_cast<double>(sum.imag() / L)};
}

}  // namespace

TEST_CASE("a multisine is the sum of its cosines", "[stimulus]") {
  const Multisine<4> u = three_tones();
  for (int n = -L; n < 2 * L; ++n) {
    double direct = 0.0;
    for (int k = 0; k < u.tones(); ++k) {
      direct += u.tone(k).amplitude * std::cos(2.0 * std::numbers::pi * u.tone(k).line * n / L + u.tone(k).phase);
    }
    CHECK(std::abs(u(n) - direct) < 1e-13);
  }
}

TEST_CASE("it is exactly periodic, however far and before zero", "[stimulus]") {
  const Multisine<4> u = three_tones();
  constexpr std::int64_t far = (std::int64_t{1} << 62) / L * L;
  for (int n = 0; n < L; ++n) {
    CHECK(u(n) == u(n + L));
    CHECK(u(n) == u(n - L));
    CHECK(u(n) == u(n + far));
    CHECK(u(n) == u(n - far));
  }
}

TEST_CASE("the table has the bits of the function", "[stimulus]") {
  const Multisine<4> u = three_tones();
  static Twiddles<128> turn;
  REQUIRE(turn.configure(L));
  std::vector<double> table(L);
  REQUIRE(u.fill(turn, table));
  for (int n = 0; n < L; ++n) CHECK(table[static_cast<std::size_t>(n)] == u(n));
  std::vector<double> wrong(L - 1);
  CHECK_FALSE(u.fill(turn, wrong));
  REQUIRE(turn.configure(L / 2));
  CHECK_FALSE(u.fill(turn, table));
}

TEST_CASE("single precision costs a sample 2e-7 of the amplitudes, a line 2e-7 of its own", "[stimulus]") {
  constexpr int K = 62, N = 2048;
  static Multisine<K> exact(N);
  static Multisine<K, float> single(N);
  for (int k = 0; k < K; ++k) {
    REQUIRE(exact.add({k + 1, 0.01, 0.0}));
    REQUIRE(single.add({k + 1, 0.01, 0.0}));
  }
  Random one(3), same(3);
  exact.randomise_phases(one);
  single.randomise_phases(same);
  static Twiddles<N> turn;
  static Twiddles<N, float> short_turn;
  REQUIRE(turn.configure(N));
  REQUIRE(short_turn.configure(N));
  std::vector<float> table(N);
  REQUIRE(single.fill(short_turn, table));
  constexpr std::int64_t far = (std::int64_t{1} << 62) / N * N;
  double worst = 0.0;
  for (int n = 0; n < N; ++n) {
    CHECK(table[static_cast<std::size_t>(n)] == single(n));
    CHECK(single(n) == single(n - far));
    worst = std::max(worst, std::abs(static_cast<double>(single(n)) - exact(n)));
  }
  CHECK(worst < 2e-7 * K * 0.01);
  CHECK(worst > 0.0);
  for (int q = 0; q < 70; ++q) {
    Complex line{};
    for (int n = 0; n < N; ++n) line += static_cast<double>(single(n)) * turn(-q, n) / static_cast<double>(N);
    CHECK(std::abs(line - exact.spectrum(q)) < 2e-7 * 0.005);
    CHECK(single.spectrum(q) == exact.spectrum(q));
  }
}

TEST_CASE("its spectrum is that of its samples, at every line", "[stimulus]") {
  Multisine<4> u = three_tones();
  REQUIRE(u.add({0, 0.5, 0.4}));  // a constant: both of its images fall on line 0
  for (int q = -L; q < L; ++q) CHECK(std::abs(u.spectrum(q) - direct_line(u, q)) < 1e-15);
  Multisine<4> highest(L);
  REQUIRE(highest.add({L / 2, 0.5, 0.4}));
  CHECK(std::abs(highest.spectrum(L / 2) - direct_line(highest, L / 2)) < 1e-15);
  CHECK(u.spectrum(6) == Complex{});
}

TEST_CASE("tones beyond the capacity and numbers that are not finite are refused", "[stimulus]") {
  Multisine<4> u = three_tones();
  CHECK_FALSE(u.add({1, std::nan(""), 0.0}));
  CHECK_FALSE(u.add({1, 1.0, std::numeric_limits<double>::infinity()}));
  CHECK(u.tones() == 3);
  CHECK(u.add({1, 1.0, 0.0}));
  CHECK_FALSE(u.add({2, 1.0, 0.0}));
}

TEST_CASE("random phases follow their seed and keep the power", "[stimulus]") {
  Multisine<4> a = three_tones(), b = three_tones(), c = three_tones();
  Random one(1), same(1), two(2);
  a.randomise_phases(one);
  b.randomise_phases(same);
  c.randomise_phases(two);
  CHECK(a(17) == b(17));
  CHECK(a(17) != c(17));
  double power = 0.0;
  for (int n = 0; n < L; ++n) power += a(n) * a(n) / L;
  CHECK(std::abs(power - (0.49 + 1.21 + 0.04) / 2.0) < 1e-13);
}

TEST_CASE("crest factors of known signals", "[stimulus]") {
  std::vector<double> u(L);
  Multisine<1> cosine(L);
  REQUIRE(cosine.add({4, 3.0, 0.0}));
  for (int n = 0; n < L; ++n) u[static_cast<std::size_t>(n)] = cosine(n);
  CHECK(std::abs(crest_factor(u) - std::numbers::sqrt2) < 1e-14);
  CHECK(crest_factor(std::array{1.0, -1.0, 1.0}) == 1.0);
  CHECK(crest_factor(std::array{0.0, 0.0, 0.0, -2.0}) == 2.0);
  CHECK(crest_factor(std::array{0.0, 0.0}) == 0.0);
}
