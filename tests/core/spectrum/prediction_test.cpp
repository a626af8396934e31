#include "core/spectrum/prediction.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <vector>

#include "core/random.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;

namespace {

// A scalar periodic system x[n+1] = a[n] x[n] + b[n] u[n], y[n] = c[n] x[n] of N sections; its multiplier is the
// product of a, 0.09: settled to the last bit in 16 cycles.
constexpr int N = 4, P = 9, L = N * P;
constexpr std::array<double, N> a{0.9, -0.5, 1.25, -0.16}, b{1.0, 0.3, -0.7, 2.0}, c{0.5, -1.5, 1.0, 0.8};

// The steady response over a period, by running the recursion through 16 settling periods.
template <class T, class Input>
std::vector<T> simulate(const Input& u) {
  std::vector<T> y(L);
  T x{};
  for (int n = 0; n < 16 * L; ++n) {
    const auto s = static_cast<std::size_t>(n % N);
    y[static_cast<std::size_t>(n % L)] = c[s] * x;
    x = a[s] * x + b[s] * T(u(n % L));
  }
  return y;
}

std::complex<double> wave(int j) {
  const double angle = 2.0 * std::numbers::pi * (((j % L) + L) % L) / L;
  return {std::cos(angle), std::sin(angle)};
}

// H_m at line q as the definition has it: the system's answer to exp(2 pi i q n / L), at the line q + m P.
class MeasuredHtf {
 public:
  MeasuredHtf() {
    for (int q = 0; q < L; ++q) {
      const auto y = simulate<Complex>([&](int n) { return wave(q * n); });
      for (int m = 0; m < N; ++m) {
        Complex sum{};
        for (int n = 0; n < L; ++n) sum += y[static_cast<std::size_t>(n)] * wave(-(q + m * P) * n) / double{L};
        h_[at(m, q)] = sum;
      }
    }
  }
  Complex operator()(int m, std::int64_t q) const {
    REQUIRE(2 * q > -L);
    REQUIRE(2 * q <= L);
    return h_[at((m + N) % N, (q + L) % L)];
  }

 private:
  static std::size_t at(std::int64_t m, std::int64_t q) { return static_cast<std::size_t>(m * L + q); }

  std::array<Complex, static_cast<std::size_t>(N) * L> h_{};
};

const MeasuredHtf& htf() {
  static const MeasuredHtf measured;
  return measured;
}

}  // namespace

TEST_CASE("eq. 14 gives the steady response to any periodic input", "[prediction]") {
  Random random(11);
  std::vector<double> u(L), y(L);
  for (double& x : u) x = random.normal();
  static Prediction<64> prediction;
  REQUIRE(prediction.configure(N, P));
  REQUIRE(prediction.input(u));
  REQUIRE(prediction.respond(N / 2, htf()));
  REQUIRE(prediction.output(y));

  const auto truth = simulate<double>([&](int n) { return u[static_cast<std::size_t>(n)]; });
  for (std::size_t n = 0; n < L; ++n) CHECK(std::abs(y[n] - truth[n]) < 1e-12);
  for (int q = -L; q < L; ++q) {
    Complex U{}, Y{};
    for (int n = 0; n < L; ++n) {
      U += u[static_cast<std::size_t>(n)] * wave(-q * n) / double{L};
      Y += truth[static_cast<std::size_t>(n)] * wave(-q * n) / double{L};
    }
    CHECK(std::abs(prediction.input_line(q) - U) < 1e-14);
    CHECK(std::abs(prediction.output_line(q) - Y) < 1e-13);
  }
}

TEST_CASE("the closed form for a stimulus gives the same response, at any sample and line", "[prediction]") {
  Multisine<3> u(L);
  REQUIRE(u.add({2, 1.0, 0.4}));
  REQUIRE(u.add({13, 0.3, -1.0}));
  REQUIRE(u.add({P, 0.5, 2.0}));  // on the pumping frequency, where it meets its own mirror image
  const auto truth = simulate<double>([&](int n) { return u(n); });

  static SteadyResponse<3, 8> response;
  REQUIRE(response.configure(u, N, N / 2, htf()));
  for (int n = -L; n < 2 * L; ++n) {
    CHECK(std::abs(response(n) - truth[static_cast<std::size_t>((n + L) % L)]) < 1e-12);
  }
  CHECK(response(7) == response(7 + (std::int64_t{1} << 50) * L));
  for (int q = -L; q < L; ++q) {
    Complex Y{};
    for (int n = 0; n < L; ++n) Y += truth[static_cast<std::size_t>(n)] * wave(-q * n) / double{L};
    CHECK(std::abs(predict_line(q, u, N, P, N / 2, htf()) - Y) < 1e-13);
  }
}

TEST_CASE("fewer harmonics keep those terms of the sum and no other", "[prediction]") {
  Multisine<1> u(L);
  REQUIRE(u.add({2, 1.0, 0.4}));
  for (int m = -2; m <= 2; ++m) {
    const Complex y = predict_line(2 + m * P, u, N, P, 1, htf());
    const Complex expected = std::abs(m) <= 1 ? htf()(m, 2) * u.spectrum(2) : Complex{};
    CHECK(std::abs(y - expected) < 1e-15);
  }
}

TEST_CASE("an odd number of sections, one section, one cycle", "[prediction]") {
  static Prediction<64> prediction;
  for (const auto& [sections, period] : {std::array{5, 6}, std::array{1, 12}, std::array{12, 1}}) {
    const int length = sections * period;
    Random random(12);
    std::vector<double> u(static_cast<std::size_t>(length)), y(u.size());
    for (double& x : u) x = random.normal();
    REQUIRE(prediction.configure(sections, period));
    REQUIRE(prediction.input(u));
    REQUIRE(prediction.respond(0, [&](int, std::int64_t q) {  // a pure delay of one sample
      const double angle = -2.0 * std::numbers::pi * static_cast<double>(q) / length;
      return Complex{std::cos(angle), std::sin(angle)};
    }));
    REQUIRE(prediction.output(y));
    for (std::size_t n = 0; n < u.size(); ++n) CHECK(std::abs(y[n] - u[(n + u.size() - 1) % u.size()]) < 1e-13);
  }
}

TEST_CASE("set-ups that do not fit are refused", "[prediction]") {
  static Prediction<64> prediction;
  CHECK_FALSE(prediction.configure(4, 17));
  CHECK_FALSE(prediction.configure(0, 4));
  CHECK_FALSE(prediction.configure(4, -1));
  REQUIRE(prediction.configure(N, P));
  std::vector<double> wrong(L + 1);
  CHECK_FALSE(prediction.input(wrong));
  CHECK_FALSE(prediction.output(wrong));
  CHECK_FALSE(prediction.respond(3, htf()));
  CHECK_FALSE(prediction.respond(-1, htf()));

  Multisine<3> u(L);
  static SteadyResponse<3, 8> response;
  CHECK_FALSE(response.configure(u, 9, 1, htf()));
  CHECK_FALSE(response.configure(u, 5, 1, htf()));
  CHECK_FALSE(response.configure(u, N, 3, htf()));
}

TEST_CASE("predicting allocates nothing", "[prediction]") {
  static Prediction<64> prediction;
  static SteadyResponse<3, 8> response;
  Multisine<3> stimulus(L);
  REQUIRE(stimulus.add({2, 1.0, 0.4}));
  std::vector<double> u(L), y(L);
  const auto unit = [](int m, std::int64_t) { return Complex(m == 0 ? 1.0 : 0.0); };
  const test::AllocationCount allocated;
  bool done = prediction.configure(N, P) && prediction.input(u) && prediction.respond(2, unit) && prediction.output(y);
  done = done && response.configure(stimulus, N, 2, unit);
  const double sample = response(3);
  const std::int64_t count = allocated();
  CHECK(count == 0);
  CHECK(done);
  CHECK(std::abs(sample - stimulus(3)) < 1e-15);
}
