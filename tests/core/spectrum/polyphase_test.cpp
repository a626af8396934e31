#include "core/spectrum/polyphase.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <numbers>
#include <vector>

#include "core/random.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

constexpr int N = 5, P = 6, L = N * P, H = 2;
using Sums = Polyphase<11, 3, 1, 8, 8, double>;
constexpr std::array<int, 10> tones{1, 2, 4, 5, 7, -8, 13, 14, 21, 3};

// Runs `samples` through the sums, window sliding over a ring, and returns the lines of the last whole cycle.
Sums::Lines run(const std::vector<double>& samples) {
  auto sums = std::make_unique<Sums>();
  sums->configure(N, P, tones, H);
  Sums::Lines lines{};
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto in_period = static_cast<int>(i % L);
    const double leaving = i < L ? 0.0 : samples[i - L];
    sums->slide(in_period / N, in_period % N, {samples[i]}, {leaving});
    sums->transform(in_period % N, lines);
  }
  return lines;
}

}  // namespace

TEST_CASE("polyphase sums are the Fourier sums of the last period, wherever in the block it ends", "[polyphase]") {
  Random random(21);
  std::vector<double> y;
  for (int cycle = 1; cycle <= 3 * P; ++cycle) {
    for (int n = 0; n < N; ++n) y.push_back(random.normal());
    const Sums::Lines lines = run(y);
    for (int k = 0; k < static_cast<int>(tones.size()); ++k) {
      for (int l = -H; l <= H; ++l) {
        std::complex<long double> direct{};
        const int q = tones[static_cast<std::size_t>(k)] + l * P;
        for (std::size_t i = y.size() < L ? 0 : y.size() - L; i < y.size(); ++i) {
          const int j = q * static_cast<int>(i) % L;
          const long double angle = -2.0L * std::numbers::pi_v<long double> * static_cast<long double>(j) / L;
          direct += static_cast<long double>(y[i]) * std::complex<long double>{std::cos(angle), std::sin(angle)};
        }
        const auto& pack = lines[Sums::bin(k, l, 0)];
        const auto lane = static_cast<std::size_t>(k) % Sums::lanes;
        CHECK(std::abs(pack.re[lane] - static_cast<double>(direct.real())) < 2e-14);
        CHECK(std::abs(pack.im[lane] - static_cast<double>(direct.imag())) < 2e-14);
      }
    }
  }
}

TEST_CASE("nothing of the past remains: the block under way and the one before decide every bit", "[polyphase]") {
  Random random(22);
  std::vector<double> recent, all;
  for (int i = 0; i < L + 4 * N; ++i) recent.push_back(1e-6 * random.normal());
  for (int i = 0; i < 5 * L; ++i) all.push_back(1e6 * random.normal());
  all.insert(all.end(), recent.begin(), recent.end());
  const Sums::Lines young = run(recent), old = run(all);
  for (std::size_t i = 0; i < young.size(); ++i) {
    CHECK(young[i].re == old[i].re);
    CHECK(young[i].im == old[i].im);
  }
}
