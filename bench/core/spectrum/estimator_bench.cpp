// K lines of one signal over a sliding window of 2048 samples, N = 32 a cycle, P = 64 cycles: what a sample costs, by
// the streaming estimator and by others. All but the table and Goertzel's recurrence give every line of the latest
// window after each cycle; those two only sum, and never slide.
#include "core/spectrum/estimator.hpp"

#include <benchmark/benchmark.h>

#include <memory>
#include <vector>

#ifdef SALTUS_BENCH_FFTW
#include <fftw3.h>
#endif

namespace {

using namespace saltus;
constexpr int sections = 32, period = 64, length = sections * period;

std::vector<double> signal() {
  Random random(1);
  std::vector<double> y(length);
  for (double& v : y) v = random.normal();
  return y;
}

// Tones q on both sides of half the pumping frequency, and their harmonics: K of them.
struct Bins {
  int tones, harmonics;
  int count() const { return tones * (2 * harmonics + 1); }
  int tone(int k) const { return k < 31 ? k + 1 : k + 2; }
};

// An iteration is a cycle.
void report(benchmark::State& state, const Bins& bins) {
  const double samples = static_cast<double>(state.iterations()) * sections;
  state.counters["per_bin"] =
      benchmark::Counter(samples * bins.count(), benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

template <int Tones, int Harmonics, class T>
void estimator(benchmark::State& state) {
  const Bins bins{Tones, Harmonics};
  const auto e = std::make_unique<HtfEstimator<Tones, Harmonics, 1, sections, period, T>>();
  std::array<int, Tones> lines{};
  for (int k = 0; k < Tones; ++k) lines[static_cast<std::size_t>(k)] = bins.tone(k);
  if (e->configure(sections, period, lines, Harmonics) != Status::ok) state.SkipWithError("capacities");
  const std::vector<double> y = signal();
  std::int64_t n = 0;
  for (; n < 2 * length; ++n) e->push(n, {y[static_cast<std::size_t>(n % length)]});
  for (auto _ : state) {
    for (int i = 0; i < sections; ++i, ++n) {
      benchmark::DoNotOptimize(e->push(n, {y[static_cast<std::size_t>(n % length)]}));
    }
  }
  report(state, bins);
}

template <int Tones, int Harmonics>
void table(benchmark::State& state) {
  const Bins bins{Tones, Harmonics};
  static Twiddles<length> w;
  if (!w.configure(length)) state.SkipWithError("capacities");
  std::vector<Complex> sum(static_cast<std::size_t>(bins.count()));
  const std::vector<double> y = signal();
  std::int64_t n = 0;
  for (auto _ : state) {
    for (int s = 0; s < sections; ++s, ++n) {
      const double sample = y[static_cast<std::size_t>(n % length)];
      std::size_t i = 0;
      for (int k = 0; k < Tones; ++k) {
        for (int l = -Harmonics; l <= Harmonics; ++l) sum[i++] += sample * w(bins.tone(k) + l * period, n);
      }
    }
    benchmark::DoNotOptimize(sum.data());
    benchmark::ClobberMemory();
  }
  report(state, bins);
}

// Goertzel's recurrence over a cycle at a time, all bins side by side.
template <int Tones, int Harmonics>
void goertzel(benchmark::State& state) {
  const Bins bins{Tones, Harmonics};
  const auto count = static_cast<std::size_t>(bins.count());
  std::vector<double> c(count), s1(count), s2(count);
  std::size_t i = 0;
  for (int k = 0; k < Tones; ++k) {
    for (int l = -Harmonics; l <= Harmonics; ++l)
      c[i++] = 2.0 * root_of_unity(bins.tone(k) + l * period, length).real();
  }
  const std::vector<double> y = signal();
  std::size_t n = 0;
  for (auto _ : state) {
    std::fill(s1.begin(), s1.end(), 0.0);
    std::fill(s2.begin(), s2.end(), 0.0);
    for (int s = 0; s < sections; s += 2, n = (n + 2) % length) {
      for (std::size_t k = 0; k < count; ++k) {
        s2[k] = y[n] + c[k] * s1[k] - s2[k];
        s1[k] = y[n + 1] + c[k] * s2[k] - s1[k];
      }
    }
    benchmark::DoNotOptimize(s1.data());
    benchmark::ClobberMemory();
  }
  report(state, bins);
}

#ifdef SALTUS_BENCH_FFTW
template <int Tones, int Harmonics>
void fftw(benchmark::State& state) {
  std::vector<double> y = signal();
  std::vector<Complex> lines(length / 2 + 1);
  const fftw_plan plan =
      fftw_plan_dft_r2c_1d(length, y.data(), reinterpret_cast<fftw_complex*>(lines.data()), FFTW_MEASURE);
  y = signal();
  for (auto _ : state) {
    fftw_execute(plan);
    benchmark::DoNotOptimize(lines.data());
    benchmark::ClobberMemory();
  }
  fftw_destroy_plan(plan);
  report(state, Bins{Tones, Harmonics});
}
#endif

template <int Tones, int Harmonics>
void add() {
  const std::string work = "streaming, K = " + std::to_string(Bins{Tones, Harmonics}.count()) + ", a cycle | ";
  const auto method = [&](const char* who, auto f) { benchmark::RegisterBenchmark((work + who).c_str(), f); };
  method("saltus", estimator<Tones, Harmonics, double>);
  method("saltus, single precision", estimator<Tones, Harmonics, float>);
#ifdef SALTUS_BENCH_FFTW
  method("FFTW, whole window", fftw<Tones, Harmonics>);
#endif
  method("Goertzel, does not slide", goertzel<Tones, Harmonics>);
  method("table multiply-accumulate, does not slide", table<Tones, Harmonics>);
}

[[maybe_unused]] const bool added = [] {
  add<16, 1>();
  add<31, 1>();
  add<62, 1>();
  add<31, 16>();
  return true;
}();

}  // namespace
