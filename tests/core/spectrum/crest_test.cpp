#include "core/spectrum/crest.hpp"

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "core/spectrum/lines.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;

namespace {

// The band-limited signal by its definition, at 24 points a sample: an independent look between the samples.
template <int K>
double crest_by_definition(const Multisine<K>& u) {
  const int points = 24 * u.samples();
  double peak = 0.0, square = 0.0;
  for (int n = 0; n < points; ++n) {
    double x = 0.0;
    for (int k = 0; k < u.tones(); ++k) {
      const auto turn = static_cast<double>(static_cast<std::int64_t>(u.tone(k).line) * n % points) / points;
      x += u.tone(k).amplitude * std::cos(2.0 * std::numbers::pi * turn + u.tone(k).phase);
    }
    peak = std::max(peak, std::abs(x));
    square += x * x;
  }
  return peak / std::sqrt(square / points);
}

Multisine<31> member(int which, std::uint64_t seed) {
  static Partition<1024> plan;
  REQUIRE(optimal_partition(639, 64, plan));
  std::array<int, 31> lines{};
  const int n = plan.collect(which, lines);
  REQUIRE(n == 31);
  Multisine<31> u(2048);
  for (int k = 0; k < n; ++k) REQUIRE(u.add({lines[static_cast<std::size_t>(k)], 0.01, 0.0}));
  Random random(seed);
  u.randomise_phases(random);
  return u;
}

CrestReduction<31, 8192> reduction;

}  // namespace

TEST_CASE("the crest factor falls by a third, between the samples too, and the lines stay", "[crest]") {
  REQUIRE(reduction.configure(2048, 4));
  double random_phases = 0.0, flat = 0.0;
  for (const int which : {0, 7, 13}) {
    const Multisine<31> before = member(which, 40 + static_cast<std::uint64_t>(which));
    Multisine<31> u = before;
    Random random(5);
    reduction.reduce(u, random);
    random_phases += crest_by_definition(before) / 3.0;
    flat += crest_by_definition(u) / 3.0;
    REQUIRE(u.tones() == before.tones());
    for (int k = 0; k < u.tones(); ++k) {
      CHECK(u.tone(k).line == before.tone(k).line);
      CHECK(u.tone(k).amplitude == before.tone(k).amplitude);
      CHECK((u.tone(k).phase >= 0.0 && u.tone(k).phase < 2.0 * std::numbers::pi));
      for (int j = 0; j < k; ++j) CHECK(compatible(u.tone(j).line, u.tone(k).line, 64));
    }
  }
  CHECK(flat < 0.7 * random_phases);
}

TEST_CASE("it allocates nothing, and equal seeds give equal bits", "[crest]") {
  REQUIRE(reduction.configure(2048, 4));
  Multisine<31> a = member(3, 9), b = a;
  Random first(2), second(2);
  const test::AllocationCount allocated;
  const double reached = reduction.reduce(a, first, 1);
  CHECK(allocated() == 0);
  CHECK(reduction.reduce(b, second, 1) == reached);
  for (int k = 0; k < a.tones(); ++k) CHECK(a.tone(k).phase == b.tone(k).phase);
}

TEST_CASE("one tone keeps its crest factor, two reach what they can", "[crest]") {
  REQUIRE(reduction.configure(256, 16));
  Multisine<31> one(256);
  REQUIRE(one.add({5, 2.0, 0.4}));
  Random random(1);
  CHECK(std::abs(reduction.reduce(one, random) - std::numbers::sqrt2) < 1e-3);
  // cos x + cos 3x: at phase 0 they add up to a peak of 2; the least is 1.5396 = max of |cos x - cos 3x|, crest factor
  // 1.5396.
  Multisine<31> two(256);
  REQUIRE(two.add({4, 1.0, 0.1}));
  REQUIRE(two.add({12, 1.0, 0.0}));
  CHECK(std::abs(reduction.reduce(two, random, 3) - 8.0 / (3.0 * std::numbers::sqrt3)) < 5e-3);
}

TEST_CASE("what does not fit or is silent is refused", "[crest]") {
  CHECK_FALSE(reduction.configure(2048, 5));
  CHECK_FALSE(reduction.configure(0, 4));
  CHECK_FALSE(reduction.configure(64, 0));
  REQUIRE(reduction.configure(64, 4));
  Multisine<31> other(32), silent(64);
  Random random(1);
  CHECK(reduction.reduce(other, random) == 0.0);
  CHECK(reduction.reduce(silent, random) == 0.0);
}
