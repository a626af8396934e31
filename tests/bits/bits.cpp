// Prints one line a figure, its name and a hash of its bits. The same source gives the same lines whatever compiled it
// and whatever it runs on: tests/bits/compare holds them side by side. Knows core, the models and puts().
#include <array>
#include <bit>
#include <cstdint>
#include <cstdio>
#include <string_view>

#include "core/flow/lanes.hpp"
#include "core/flow/rk8.hpp"
#include "core/orbit/orbit.hpp"
#include "core/spectrum/estimator.hpp"
#include "core/spectrum/htf.hpp"
#include "sim/models/hopper.hpp"
#include "sim/models/kneed_biped.hpp"
#ifdef SALTUS_BITS_MULTIPLIERS
#include "core/orbit/multipliers.hpp"
#endif

namespace {

using namespace saltus;

// FNV-1a over the bytes of numbers, least significant first.
class Hash {
 public:
  void add(double x) noexcept {
    const auto bits = std::bit_cast<std::uint64_t>(x);
    for (int i = 0; i < 64; i += 8) sum_ = (sum_ ^ (bits >> i & 0xff)) * 0x100000001b3;
  }
  void add(const Complex& z) noexcept {
    add(z.real());
    add(z.imag());
  }
  template <class Derived>
  void add(const Eigen::MatrixBase<Derived>& m) noexcept {
    for (int j = 0; j < m.cols(); ++j) {
      for (int i = 0; i < m.rows(); ++i) add(m(i, j));
    }
  }

  void print(std::string_view name) const noexcept {
    std::array<char, 64> line{};
    std::size_t n = 0;
    for (const char c : name) line[n++] = c;
    line[n++] = ' ';
    for (int shift = 60; shift >= 0; shift -= 4) line[n++] = "0123456789abcdef"[sum_ >> shift & 15];
    std::puts(line.data());
  }

 private:
  std::uint64_t sum_ = 0xcbf29ce484222325;
};

constexpr int sections = 32, period = 16, tones = 7, ticks = 64;  // of the campaign
constexpr std::int64_t length = sections * period;

void elementary() {
  Hash h;
  Random random(1);
  for (const double largest : {1.0, 10.0, 1e4, 1e9, 1e20}) {
    for (int i = 0; i < 2000; ++i) {
      const double x = largest * (2.0 * random.uniform() - 1.0);
      h.add(saltus::sin(x));
      h.add(saltus::cos(x));
      h.add(double{saltus::cos(static_cast<float>(x))});
    }
  }
  h.print("sine and cosine");
  Hash e;
  for (int i = 0; i < 10000; ++i) {
    const double x = 200.0 * random.uniform() - 100.0;
    e.add(saltus::exp(x));
    e.add(saltus::tanh(0.1 * x));
  }
  e.print("exp and tanh");
}

Multisine<tones> stimulus() {
  Multisine<tones> u(length);
  for (int k = 0; k < tones; ++k) {
    if (!u.add({k + 1 + k % 3 * period, 0.002, 0.0})) std::puts("stimulus: no room");
  }
  Random random(2);
  u.randomise_phases(random);
  return u;
}

template <class Method, class M>
void long_run(const M& m, int per_turn, int count, std::string_view name) {
  Hash h;
  const Timebase base = timebase_of(m, per_turn);
  const Multisine<tones> push = stimulus();
  Run<M> run;
  run.at = start_of(m);
  Input<M> u = Input<M>::Zero();
  for (int i = 0; i < count; ++i) {
    if constexpr (input_count < M >> 0) {
      if (i % (per_turn / sections) == 0) u[0] = push(i / (per_turn / sections));
    }
    h.add(static_cast<double>(step<Method>(m, run, u, base).status));
    h.add(run.at.x);
  }
  h.print(name);
}

// Hoppers of different springs.
template <int W>
void side_by_side(int per_turn, int count, std::string_view name) {
  using M = Hopper<>;
  std::array<M, static_cast<std::size_t>(W)> models;
  for (std::size_t l = 0; l < models.size(); ++l) models[l].k += 0.1 * static_cast<double>(l);
  LaneRuns<M, W> lanes(models);
  Run<M> start;
  start.at = start_of(models[0]);
  for (int l = 0; l < W; ++l) lanes.set(l, start);
  const Timebase base = timebase_of(models[0], per_turn);
  const Multisine<tones> push = stimulus();
  typename LaneRuns<M, W>::U u;
  Hash h;
  for (int i = 0; i < count; ++i) {
    for (int l = 0; l < W; ++l) u[0].set(l, push(i + 11 * l));
    lanes.step(u, base);
    for (int l = 0; l < W; ++l) {
      h.add(static_cast<double>(lanes.status(l)));
      h.add(lanes.run(l).at.x);
    }
  }
  h.print(name);
}

LdtpOf<Hopper<>, sections> linear;
Orbit<Hopper<>, sections> cycle;

void limit_cycle() {
  const Hopper<> m;
  cycle = find_orbit<sections>(m, timebase_of(m, ticks), ClockPhases{sections}, linear);
  Hash orbit;
  orbit.add(static_cast<double>(cycle.status));
  for (const auto& p : cycle.point) orbit.add(p.x);
  for (const auto& y : cycle.output) orbit.add(y);
  for (int i = 0; i < cycle.events; ++i) orbit.add(cycle.event[static_cast<std::size_t>(i)].t);
  orbit.print("hopper: orbit");
  Hash system;
  for (std::size_t n = 0; n < sections; ++n) {
    system.add(linear.A[n]);
    system.add(linear.B[n]);
  }
  system.add(linear.monodromy(0));
  system.print("hopper: linearised");
#ifdef SALTUS_BITS_MULTIPLIERS
  Hash spectrum;
  for (const Complex& z : multipliers<section_dim<Hopper<>>>(linear.monodromy(0))) spectrum.add(z);
  spectrum.print("hopper: multipliers");
#endif
  Hash exact;
  for (int q = 1; q < 4 * period; q += 5) {
    for (const auto& h : htf(linear, 2.0 * std::numbers::pi * q / static_cast<double>(length)).h) exact.add(h);
  }
  exact.print("hopper: exact HTF");
}

// Settles for a stimulus period, listens for two.
template <class T>
void campaign(std::string_view state, std::string_view transfer) {
  static HtfEstimator<tones, 3, 2, sections, period, T> estimator;
  const Hopper<> m;
  const Timebase base = timebase_of(m, ticks);
  const Multisine<tones> push = stimulus();
  std::array<int, tones> lines{};
  for (int k = 0; k < tones; ++k) lines[static_cast<std::size_t>(k)] = push.tone(k).line;
  if (estimator.configure(sections, period, lines, 3) != Status::ok) std::puts("estimator: no room");
  Run<Hopper<>> run;
  run.at = cycle.point[0];
  for (std::int64_t n = 0; n < 3 * length; ++n) {
    const auto y = output_at(m, run.at, Input<Hopper<>>::Zero());
    if (n >= length && estimator.push(n, {y[0], y[1]}) != Status::ok) std::puts("estimator: a sample was refused");
    const Input<Hopper<>> u(push(n));
    for (int i = 0; i < ticks / sections; ++i) step(m, run, u, base);
  }
  Hash sums, ratios;
  for (int k = 0; k < tones; ++k) {
    for (int l = -3; l <= 3; ++l) {
      for (int c = 0; c < 2; ++c) {
        sums.add(estimator.line(k, l, c));
        sums.add(estimator.mean(k, l, c));
        sums.add(estimator.variance(k, l, c));
        ratios.add(estimator.htf(k, l, c, push));
      }
    }
  }
  sums.print(state);
  ratios.print(transfer);
}

}  // namespace

int main() {
  elementary();
  limit_cycle();
  campaign<double>("estimator", "hopper: identified HTF");
  campaign<float>("estimator of floats", "hopper: identified HTF, floats");
  long_run<Rk4>(Hopper<>{}, 512, 100000, "hopper: 1e5 ticks");
  long_run<Rk4>(KneedBiped<>{}, 512, 100000, "kneed biped: 1e5 ticks");
  side_by_side<4>(64, 10000, "hopper: four in lanes, 1e4 ticks");
  long_run<Rk8>(Hopper<>{}, 32, 10000, "hopper: 1e4 ticks, order eight");
  long_run<Rk8>(KneedBiped<>{}, 32, 10000, "kneed biped: 1e4 ticks, order eight");
}
