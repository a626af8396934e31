#include "core/spectrum/estimator.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <vector>

#include "core/random.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || !defined(__OPTIMIZE__)
#define SALTUS_SLOW_BUILD 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(undefined_behavior_sanitizer)
#define SALTUS_SLOW_BUILD 1
#endif
#endif

using namespace saltus;

namespace {

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

// The last value of every slot of the period by its own index, transformed term by term in long double.
struct Direct {
  int sections, period;
  std::map<std::int64_t, double> slot{};  // n mod L -> sample

  int samples() const { return sections * period; }
  void set(std::int64_t n, double y) { slot[((n % samples()) + samples()) % samples()] = y; }
  Complex line(int q) const {
    std::complex<long double> sum{};
    for (const auto& [n, y] : slot) {
      const auto j = static_cast<long double>((static_cast<std::int64_t>(q) * n) % samples());
      const long double angle = -2.0L * std::numbers::pi_v<long double> * j / samples();
      sum += static_cast<long double>(y) * std::complex<long double>{std::cos(angle), std::sin(angle)};
    }
    return {static_cast<double>(sum.real() / samples()), static_cast<double>(sum.imag() / samples())};
  }
};

template <class Estimator>
double worst(const Estimator& e, const Direct& direct, int channel = 0) {
  double error = 0.0;
  for (int k = 0; k < e.tones(); ++k) {
    for (int l = -e.harmonics(); l <= e.harmonics(); ++l) {
      const Complex y = direct.line(e.tone_line(k) + l * e.period());
      error = std::max(error, std::abs(e.line(k, l, channel) - y));
    }
  }
  return error;
}

using Small = HtfEstimator<11, 3, 2, 8, 12>;

}  // namespace

TEST_CASE("every cycle the estimate is the direct transform of the last period", "[estimator]") {
  struct Setting {
    int sections, period, harmonics;
    std::int64_t start;
    std::vector<int> lines;
  };
  const std::vector<Setting> settings{
      {8, 12, 3, 0, {1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 23}},  // a full pack and a broken one
      {6, 7, 2, 30, {1, 2, 10}},                            // starts inside a block
      {5, 9, 2, -5 * 9 * 4 + 5 * 3, {4, -2, 100}},          // before zero; lines of any sign and size
      {1, 12, 0, 7, {1, 5}},
      {8, 1, 3, 16, {0, 1}},
      {2, 2, 1, std::int64_t{1} << 61, {1}},
  };
  auto e = std::make_unique<Small>();
  for (const Setting& s : settings) {
    REQUIRE(e->configure(s.sections, s.period, s.lines, s.harmonics) == Status::ok);
    Direct first{s.sections, s.period}, second{s.sections, s.period};
    Random random(31);
    std::int64_t n = s.start;
    for (int cycle = 1; cycle <= 3 * s.period + 2; ++cycle) {
      for (int i = 0; i < s.sections; ++i, ++n) {
        const Small::Sample y{random.normal(), 100.0 + random.normal()};
        first.set(n, y[0]);
        second.set(n, y[1]);
        REQUIRE(e->next() == (n == s.start ? 0 : n));
        REQUIRE(e->push(n, y) == Status::ok);
        REQUIRE(e->cycle_completed() == (i + 1 == s.sections));
      }
      REQUIRE(e->valid() == (cycle >= s.period));
      REQUIRE(e->windows() == std::max(0, cycle - s.period + 1));
      if (!e->valid()) {
        CHECK(e->line(0, 0, 0) == Complex{});
        continue;
      }
      CHECK(e->holes() == 0);
      CHECK(worst(*e, first) < 1e-15);
      CHECK(worst(*e, second, 1) < 1e-13);
    }
  }
}

TEST_CASE("a cosine a cos(omega n + phi) reads (a/2) exp(i phi), wherever the record starts", "[estimator]") {
  constexpr int N = 8, P = 12;
  auto e = std::make_unique<Small>();
  constexpr std::array<int, 2> lines{7, 7 - 12};  // the second sees the first one's mirror image at -7 - 0 P
  Multisine<1> u(N * P);
  REQUIRE(u.add({7, 3.0, 0.8}));
  for (const std::int64_t start : {0, 3 * N, -5 * N}) {
    REQUIRE(e->configure(N, P, lines, 1) == Status::ok);
    for (std::int64_t n = start; n < start + std::int64_t{N} * P; ++n)
      REQUIRE(e->push(n, {u(n), 2.0 * u(n)}) == Status::ok);
    REQUIRE(e->valid());
    CHECK(std::abs(e->line(0, 0, 0) - std::polar(1.5, 0.8)) < 1e-15);
    CHECK(std::abs(e->line(0, 1, 0)) < 1e-15);
    CHECK(std::abs(e->line(1, 1, 0) - e->line(0, 0, 0)) < 1e-15);
    CHECK(std::abs(e->htf(0, 0, 1, u) - 2.0) < 1e-14);  // a known stimulus
    CHECK(std::abs(e->htf(0, 0, 1, 0) - 2.0) < 1e-14);  // a measured one
  }
}

TEST_CASE("the harmonic transfer functions of a periodic system come out of one experiment", "[estimator]") {
  // x[n+1] = a[n] x[n] + u[n], y = x: H_m(q) by simulating its answer to exp(2 pi i q n / L), settled to the last bit.
  constexpr int N = 4, P = 12, L = N * P;
  constexpr std::array<double, N> a{0.9, -0.5, 1.25, -0.16};
  auto e = std::make_unique<Small>();
  constexpr std::array<int, 5> lines{1, 10, 15, 20, 31};  // one of each class 1 ... 5
  Multisine<5> u(L);
  for (const int q : lines) REQUIRE(u.add({q, 0.1, 0.3 * q}));
  REQUIRE(e->configure(N, P, lines, 1) == Status::ok);
  double x = 0.0;
  for (int n = 0; n < 12 * L; ++n) {
    if (n >= 10 * L) e->push(n, {x, u(n)});
    x = a[static_cast<std::size_t>(n % N)] * x + u(n);
  }
  for (int k = 0; k < e->tones(); ++k) {
    const int q = e->tone_line(k);
    for (int m = -1; m <= 1; ++m) {
      Complex z{}, h{};
      for (int n = 0; n < 12 * L; ++n) {
        if (n >= 11 * L) h += z * std::polar(1.0, -2.0 * std::numbers::pi * (((q + m * P) * n) % L) / L) / double{L};
        z = a[static_cast<std::size_t>(n % N)] * z + std::polar(1.0, 2.0 * std::numbers::pi * (q * n % L) / L);
      }
      CHECK(std::abs(e->htf(k, m, 0, u) - h) < 1e-13);
      CHECK(std::abs(e->htf(k, m, 0, 1) - h) < 1e-13);
    }
  }
}

TEST_CASE("a missing sample keeps what its slot held a period ago, and is counted", "[estimator]") {
  constexpr int N = 6, P = 7, L = N * P;
  auto e = std::make_unique<Small>();
  constexpr std::array<int, 3> lines{1, 2, 10};
  REQUIRE(e->configure(N, P, lines, 2) == Status::ok);
  Direct direct{N, P};
  std::vector<int> state(L, 0);  // 0 hole, 1 kept, 2 fresh
  Random random(32);
  std::int64_t lost = 0;
  for (int n = 0; n < 5 * L; ++n) {
    const auto slot = static_cast<std::size_t>(n % L);
    const Small::Sample y{random.normal(), 0.0};
    const bool drop = n > 0 && random.uniform() < 0.3;
    if (drop) {
      ++lost;
      if (random.uniform() < 0.5) {
        REQUIRE(e->push_missing() == Status::missing);
      } else {
        REQUIRE(e->push(n, {y[0], random.uniform() < 0.5 ? not_a_number : -std::numeric_limits<double>::infinity()}) ==
                Status::missing);
      }
      if (state[slot] == 2) state[slot] = 1;
    } else {
      REQUIRE(e->push(n, y) == Status::ok);
      direct.set(n, y[0]);
      state[slot] = 2;
    }
    if (!e->cycle_completed()) continue;
    CHECK(e->holes() == std::count(state.begin(), state.end(), 0));
    CHECK(e->stale() == std::count(state.begin(), state.end(), 1));
    CHECK(e->missing() == lost);
    if (e->valid()) CHECK(worst(*e, direct) < 1e-15);
  }
  CHECK(e->holes() == 0);
  CHECK(e->stale() > 0);
}

TEST_CASE("a baseline makes holes neutral", "[estimator]") {
  constexpr int N = 4, P = 6;
  auto e = std::make_unique<Small>();
  constexpr std::array<int, 1> lines{1};
  REQUIRE(e->configure(N, P, lines, 1) == Status::ok);
  const std::array<Small::Sample, N> orbit{{{5.0, -1.0}, {7.0, -2.0}, {-3.0, 4.0}, {1.0, 9.0}}};
  REQUIRE(e->set_baseline(orbit) == Status::ok);
  e->push(0, orbit[0]);
  for (int n = 1; n < N * P; ++n) {
    n % 5 == 0 ? e->push_missing() : e->push(n, orbit[static_cast<std::size_t>(n % N)]);
  }
  REQUIRE(e->valid());
  CHECK(e->holes() == 4);
  for (int l = -1; l <= 1; ++l) {
    CHECK(e->line(0, l, 0) == Complex{});
    CHECK(e->line(0, l, 1) == Complex{});
  }
  CHECK(e->periods() == 0);  // a window with holes enters no mean
  CHECK(e->set_baseline(std::span(orbit).first(3)) == Status::failed);
}

TEST_CASE("an index that repeats, skips or jumps is detected", "[estimator]") {
  constexpr int N = 4, P = 6, L = N * P;
  auto e = std::make_unique<Small>();
  constexpr std::array<int, 2> lines{1, 2};
  REQUIRE(e->configure(N, P, lines, 1) == Status::ok);
  Random random(33);
  Direct direct{N, P};
  const auto push = [&](std::int64_t n) {
    const Small::Sample y{random.normal(), random.normal()};
    const Status status = e->push(n, y);
    if (status != Status::missing || e->next() == n + 1) direct.set(n, y[0]);
    return status;
  };
  for (int n = 0; n < 2 * L; ++n) REQUIRE(push(n) == Status::ok);

  CHECK(e->push(2 * L - 1, {1e9, 1e9}) == Status::missing);  // a duplicate
  CHECK(e->push(2 * L - N, {1e9, 1e9}) == Status::missing);  // a late one
  CHECK(e->late() == 2);
  CHECK_FALSE(e->cycle_completed());
  CHECK(worst(*e, direct) < 1e-15);

  CHECK(push(2 * L + N) == Status::missing);  // a whole cycle skipped: filled in
  CHECK(e->cycle_completed());
  CHECK(e->missing() == N);
  CHECK(e->stale() == N);
  for (int n = 2 * L + N + 1; n < 2 * L + 2 * N; ++n) REQUIRE(push(n) == Status::ok);
  CHECK(e->valid());
  CHECK(worst(*e, direct) < 1e-15);

  const std::int64_t periods = e->periods();
  for (const std::int64_t start : {std::int64_t{5 * L + 2}, std::int64_t{-1000003}, std::int64_t{1} << 62}) {
    CHECK(push(start) == Status::failed);  // a jump: the window starts anew, in mid-cycle
    CHECK_FALSE(e->valid());
    CHECK(e->holes() == L);
    CHECK(e->periods() == periods);
  }
  CHECK(e->jumps() == 3);
  CHECK(e->push(std::numeric_limits<std::int64_t>::max(), {}) == Status::failed);  // ignored
  CHECK(e->push(std::numeric_limits<std::int64_t>::min(), {}) == Status::failed);
  CHECK(e->next() == (std::int64_t{1} << 62) + 1);

  CHECK(push(2) == Status::failed);
  int cycles = 0;
  for (int n = 3; !e->valid(); ++n) {
    REQUIRE(push(n) == Status::ok);
    cycles += e->cycle_completed() ? 1 : 0;
  }
  CHECK(cycles == P + 1);  // the cycle entered in its middle does not count
  CHECK(e->holes() == 0);
  CHECK(e->stale() == 0);
  CHECK(worst(*e, direct) < 1e-15);
  CHECK(e->periods() == periods + 1);
}

TEST_CASE("restart forgets every sample and count", "[estimator]") {
  constexpr int N = 4, P = 6, L = N * P;
  auto used = std::make_unique<Small>(), fresh = std::make_unique<Small>();
  constexpr std::array<int, 2> lines{1, 2};
  REQUIRE(used->configure(N, P, lines, 1) == Status::ok);
  REQUIRE(fresh->configure(N, P, lines, 1) == Status::ok);
  Random random(34);
  for (int n = 0; n < 2 * L + 7; ++n) used->push(n, {1e8 * random.normal(), not_a_number});
  for (int n = 2 * L + 7; n < 4 * L; ++n) used->push(n, {1e8 * random.normal(), 1.0});
  used->restart();
  CHECK_FALSE(used->valid());
  CHECK(used->missing() == 0);
  CHECK(used->periods() == 0);
  CHECK(used->push_missing() == Status::missing);  // before the first sample: counted, no slot to skip
  for (int n = 9 * L; n < 10 * L; ++n) {
    const Small::Sample y{random.normal(), random.normal()};
    used->push(n, y);
    fresh->push(n, y);
  }
  REQUIRE(used->valid());
  for (int k = 0; k < 2; ++k) {
    for (int l = -1; l <= 1; ++l) {
      CHECK(used->line(k, l, 0) == fresh->line(k, l, 0));  // the same bits
      CHECK(used->line(k, l, 1) == fresh->line(k, l, 1));
    }
  }
}

TEST_CASE("mean and variance run over disjoint periods", "[estimator]") {
  constexpr int N = 4, P = 6, L = N * P, R = 9;
  auto e = std::make_unique<Small>();
  constexpr std::array<int, 2> lines{1, 8};
  REQUIRE(e->configure(N, P, lines, 1) == Status::ok);
  Random random(35);
  std::array<Direct, R> period{};
  for (Direct& d : period) d = {N, P};
  for (int n = 0; n < R * L; ++n) {
    CHECK(e->periods() == n / L);
    const double y = 3.0 + random.normal();
    period[static_cast<std::size_t>(n / L)].set(n, y);
    e->push(n, {y, y});
    if (n < 2 * L - 1) CHECK(e->variance(0, 0, 0) == 0.0);
  }
  CHECK(e->periods() == R);
  for (int k = 0; k < 2; ++k) {
    for (int l = -1; l <= 1; ++l) {
      const int q = lines[static_cast<std::size_t>(k)] + l * P;
      Complex mean{};
      double variance = 0.0;
      for (const Direct& d : period) mean += d.line(q) / double{R};
      for (const Direct& d : period) variance += std::norm(d.line(q) - mean) / (R - 1);
      CHECK(std::abs(e->mean(k, l, 1) - mean) < 1e-15);
      CHECK(std::abs(e->variance(k, l, 1) - variance) < 1e-15);
    }
  }
}

TEST_CASE("set-ups that do not fit are refused and change nothing", "[estimator]") {
  auto e = std::make_unique<Small>();
  CHECK(e->push(0, {}) == Status::failed);
  CHECK(e->push_missing() == Status::failed);
  CHECK_FALSE(e->valid());
  CHECK(e->set_baseline({}) == Status::failed);

  constexpr std::array<int, 2> lines{1, 2};
  constexpr std::array<int, 12> many{};
  REQUIRE(e->configure(4, 6, lines, 1) == Status::ok);
  for (int n = 0; n < 24; ++n) e->push(n, {1.0, 1.0});
  CHECK(e->configure(9, 6, lines, 1) == Status::failed);
  CHECK(e->configure(0, 6, lines, 1) == Status::failed);
  CHECK(e->configure(4, 13, lines, 1) == Status::failed);
  CHECK(e->configure(4, 0, lines, 1) == Status::failed);
  CHECK(e->configure(4, 6, lines, 4) == Status::failed);
  CHECK(e->configure(4, 6, lines, -1) == Status::failed);
  CHECK(e->configure(4, 6, many, 1) == Status::failed);
  CHECK(e->configure(4, 6, {}, 1) == Status::failed);
  CHECK(e->valid());
  CHECK(e->samples() == 24);
}

TEST_CASE("nothing drifts in a hundred million samples", "[estimator]") {
#ifdef SALTUS_SLOW_BUILD
  constexpr std::int64_t count = 1'000'000;
#else
  constexpr std::int64_t count = 100'000'000;
#endif
  constexpr int N = 4, P = 6, L = N * P;
  constexpr std::array<int, 1> lines{1};
  std::vector<double> noise(9973);  // no multiple of the period: every window differs
  Random random(36);
  for (double& y : noise) y = random.normal();
  const auto y = [&](std::int64_t n) { return noise[static_cast<std::size_t>(n % 9973)]; };

  HtfEstimator<1, 1, 1, N, P> old, young;
  HtfEstimator<1, 1, 1, N, P, float> old_single, young_single;
  const std::int64_t end = count / N * N + std::int64_t{3} * N;  // in the middle of a block
  const auto run = [&](auto& e, std::int64_t from) {
    REQUIRE(e.configure(N, P, lines, 1) == Status::ok);
    std::size_t i = static_cast<std::size_t>(from % 9973);
    bool ok = true;
    for (std::int64_t n = from; n < end; ++n) {
      ok = e.push(n, {noise[i]}) == Status::ok && ok;
      if (++i == noise.size()) i = 0;
    }
    CHECK(ok);
  };
  run(old, 0);
  run(old_single, end - count / 10 / N * N);
  run(young, (end / L - 1) * L);  // the block under way and the one before
  run(young_single, (end / L - 1) * L);
  CHECK(old.windows() == end / N - P + 1);
  Direct direct{N, P};
  for (std::int64_t n = end - L; n < end; ++n) direct.set(n, y(n));
  for (int l = -1; l <= 1; ++l) {
    const Complex truth = direct.line(1 + l * P);
    CHECK(old.line(0, l, 0) == young.line(0, l, 0));  // to the last bit
    CHECK(old_single.line(0, l, 0) == young_single.line(0, l, 0));
    CHECK(std::abs(old.line(0, l, 0) - truth) < 1e-14 * std::abs(truth));
    CHECK(std::abs(old_single.line(0, l, 0) - truth) < 2e-6 * std::abs(truth));
  }
}

TEST_CASE("setting up, pushing and reading allocate nothing", "[estimator]") {
  constexpr int N = 4, P = 6;
  static Small e;
  constexpr std::array<int, 2> lines{1, 2};
  constexpr std::array<Small::Sample, N> baseline{};
  Multisine<2> u(N * P);
  REQUIRE(u.add({1, 1.0, 0.0}));
  const test::AllocationCount allocated;
  bool ok = e.configure(N, P, lines, 1) == Status::ok && e.set_baseline(baseline) == Status::ok;
  Complex sum{};
  for (int n = 0; n < 5 * N * P; ++n) {
    e.push(n + (n > 50 ? 2 : 0) + (n > 80 ? 1000 : 0), {u(n), n % 7 == 0 ? not_a_number : 1.0});
    if (e.cycle_completed()) sum += e.htf(0, 1, 0, u) + e.mean(0, 0, 0) + e.variance(0, 0, 0);
  }
  const std::int64_t count = allocated();
  CHECK(count == 0);
  CHECK(ok);
  CHECK(std::isfinite(std::abs(sum)));
}
