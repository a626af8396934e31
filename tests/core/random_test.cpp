#include "core/random.hpp"

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>

#include "tests/support/catch.hpp"

using saltus::Random;

namespace {

std::uint64_t fold(std::uint64_t hash, std::uint64_t word) { return (hash ^ word) * 0x100000001b3; }

}  // namespace

TEST_CASE("a seed and a stream give the same bits everywhere", "[random]") {
  constexpr std::uint64_t first = Random(1).bits();
  STATIC_REQUIRE(first == Random(1).bits());
  STATIC_REQUIRE(Random(1).bits() != Random(2).bits());
  STATIC_REQUIRE(Random(1).bits() != Random(1, 1).bits());

  Random random(2014, 7);
  std::uint64_t hash = 0xcbf29ce484222325;
  for (int i = 0; i < 1000; ++i) {
    hash = fold(hash, random.bits());
    hash = fold(hash, std::bit_cast<std::uint64_t>(random.normal()));
    hash = fold(hash, random.uniform_int(1000));
  }
  CHECK(hash == 0x594b73c0260122c);  // from an independent program
}

TEST_CASE("the engine is xoshiro256** seeded by SplitMix64", "[random]") {
  // From an independent program that reproduces the published vectors of both generators.
  constexpr std::array<std::uint64_t, 4> one{0x68b02a87b58ad621, 0x5153de78d62694ca, 0x66c6d2b92073a542,
                                             0xa4d9f154ea82b748};
  constexpr std::array<std::uint64_t, 4> other{0xb05044df97ad033, 0x623b81c631ea59ce, 0x65758cf408bcba8d,
                                               0x502e1982767e9d92};
  Random a(1), b(2014, 7);
  for (const std::uint64_t x : one) CHECK(a.bits() == x);
  for (const std::uint64_t x : other) CHECK(b.bits() == x);
}

TEST_CASE("uniform numbers fill the unit interval evenly", "[random]") {
  Random random(3);
  std::array<int, 16> bins{};
  constexpr int count = 160000;
  for (int i = 0; i < count; ++i) {
    const double u = random.uniform();
    REQUIRE(u >= 0.0);
    REQUIRE(u < 1.0);
    ++bins[static_cast<std::size_t>(u * 16.0)];
  }
  double chi_square = 0.0;  // 15 degrees of freedom: above 44.3 once in ten thousand seeds
  for (const int b : bins) chi_square += (b - 10000.0) * (b - 10000.0) / 10000.0;
  CHECK(chi_square < 44.3);
}

TEST_CASE("uniform integers are unbiased where the modulo is not", "[random]") {
  Random random(4);
  constexpr std::uint64_t n = 3ull << 62;  // a bare modulo would make the first third twice as likely
  int low = 0;
  for (int i = 0; i < 30000; ++i) {
    const std::uint64_t r = random.uniform_int(n);
    REQUIRE(r < n);
    low += r < (1ull << 62) ? 1 : 0;
  }
  CHECK(std::abs(low - 10000) < 400);  // 5 standard deviations
  CHECK(random.uniform_int(1) == 0);
  CHECK(random.uniform_int(0) == 0);
}

TEST_CASE("normal numbers have the moments and the tails of the normal law", "[random]") {
  Random random(5);
  constexpr int count = 400000;
  std::array<double, 5> moment{};
  int beyond = 0;
  for (int i = 0; i < count; ++i) {
    const double x = random.normal();
    double power = 1.0;
    for (double& m : moment) {
      m += power / count;
      power *= x;
    }
    beyond += std::abs(x) > 3.0 ? 1 : 0;
  }
  CHECK(std::abs(moment[1]) < 0.008);  // 5 standard deviations, each
  CHECK(std::abs(moment[2] - 1.0) < 0.0112);
  CHECK(std::abs(moment[3]) < 0.031);
  CHECK(std::abs(moment[4] - 3.0) < 0.078);
  CHECK(std::abs(beyond - 0.0026997961 * count) < 165);
}

TEST_CASE("streams of one seed are uncorrelated", "[random]") {
  Random a(6, 0), b(6, 1);
  constexpr int count = 100000;
  double product = 0.0;
  for (int i = 0; i < count; ++i) product += a.normal() * b.normal() / count;
  CHECK(std::abs(product) < 0.016);  // 5 standard deviations
}
