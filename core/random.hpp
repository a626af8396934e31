// A small seeded generator for stimuli, partitions and emulated noise: xoshiro256** (Blackman & Vigna 2018), its state
// drawn from SplitMix64. Only integer operations and +, -, *, /, sqrt are used, so every platform gives the same bits
// (with -ffp-contract=off); normal() brings its own logarithm because libm's differs between platforms.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace saltus {

class Random {
 public:
  // Equal (seed, stream) give equal numbers; different streams of one seed are independent for every practical use.
  constexpr explicit Random(std::uint64_t seed, std::uint64_t stream = 0) noexcept {
    std::uint64_t z = scramble(seed + golden) ^ scramble(~stream);
    for (std::uint64_t& word : state_) word = scramble(z += golden);
  }

  constexpr std::uint64_t bits() noexcept {
    const std::uint64_t out = rotate(state_[1] * 5, 7) * 9;
    const std::uint64_t t = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= t;
    state_[3] = rotate(state_[3], 45);
    return out;
  }

  // Uniform in [0, 1), on the grid 2^-53.
  constexpr double uniform() noexcept { return static_cast<double>(bits() >> 11) * 0x1p-53; }

  // Uniform in {0, ..., n - 1}, unbiased (by rejection); 0 when n = 0.
  constexpr std::uint64_t uniform_int(std::uint64_t n) noexcept {
    if (n == 0) return 0;
    const std::uint64_t surplus = (0 - n) % n;  // 2^64 mod n
    std::uint64_t r = bits();
    while (r < surplus) r = bits();
    return r % n;
  }

  // Normal, mean 0, variance 1 (Marsaglia's polar method; one of the pair is dropped so that no number is carried
  // over).
  double normal() noexcept {
    double x = 0.0, s = 0.0;
    do {
      x = 2.0 * uniform() - 1.0;
      const double y = 2.0 * uniform() - 1.0;
      s = x * x + y * y;
    } while (s >= 1.0 || s == 0.0);
    return x * std::sqrt(-2.0 * logarithm(s) / s);
  }

 private:
  static constexpr std::uint64_t golden = 0x9e3779b97f4a7c15;

  static constexpr std::uint64_t rotate(std::uint64_t x, int k) noexcept { return (x << k) | (x >> (64 - k)); }

  // The SplitMix64 finaliser: a bijection of 64 bits.
  static constexpr std::uint64_t scramble(std::uint64_t z) noexcept {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
    z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
    return z ^ (z >> 31);
  }

  // ln s, s > 0: s = m 2^e with m in [1/sqrt 2, sqrt 2), ln m = 2 artanh((m - 1) / (m + 1)) by its series.
  static double logarithm(double s) noexcept {
    int e = 0;
    double m = std::frexp(s, &e);
    if (m < 0.5 * std::numbers::sqrt2) {
      m *= 2.0;
      --e;
    }
    const double t = (m - 1.0) / (m + 1.0), t2 = t * t;
    double sum = 0.0;
    for (int odd = 21; odd >= 1; odd -= 2) sum = sum * t2 + 1.0 / odd;
    return e * std::numbers::ln2 + 2.0 * t * sum;
  }

  std::array<std::uint64_t, 4> state_{};
};

}  // namespace saltus
