// The streaming estimator, per sample: 31 tones, both outputs, N = 32, P = 64; beside a table multiply-accumulate that
// only sums and never slides.
#include "core/spectrum/estimator.hpp"

#include <benchmark/benchmark.h>

#include <memory>

namespace {

using namespace saltus;
constexpr int tones = 31, sections = 32, period = 64;

void estimator(benchmark::State& state) {
  const auto harmonics = static_cast<int>(state.range(0));
  const auto e = std::make_unique<HtfEstimator<tones, 3, 2, sections, period>>();
  std::array<int, tones> lines{};
  for (int k = 0; k < tones; ++k) lines[static_cast<std::size_t>(k)] = k + 1;
  if (e->configure(sections, period, lines, harmonics) != Status::ok) state.SkipWithError("capacities");
  Random random(1);
  std::int64_t n = 0;
  for (; n < 2 * sections * period; ++n) benchmark::DoNotOptimize(e->push(n, {random.uniform(), random.uniform()}));
  for (auto _ : state) {
    benchmark::DoNotOptimize(e->push(n++, {1.0, 2.0}));
  }
  const double bins = tones * (2.0 * harmonics + 1.0) * 2.0;
  state.counters["per_bin"] = benchmark::Counter(static_cast<double>(state.iterations()) * bins,
                                                 benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}
BENCHMARK(estimator)->Name("estimator/push")->Arg(0)->Arg(1)->Arg(3);

void table(benchmark::State& state) {
  const auto harmonics = static_cast<int>(state.range(0));
  static Twiddles<sections * period> w;
  if (!w.configure(sections * period)) state.SkipWithError("capacities");
  static std::array<Complex, tones * 7 * 2> sum{};
  std::int64_t n = 0;
  for (auto _ : state) {
    std::size_t i = 0;
    for (int k = 1; k <= tones; ++k) {
      for (int l = -harmonics; l <= harmonics; ++l) {
        const Complex z = w(k + l * period, n);
        sum[i++] += z;
        sum[i++] += 2.0 * z;
      }
    }
    ++n;
    benchmark::DoNotOptimize(sum);
  }
  const double bins = tones * (2.0 * harmonics + 1.0) * 2.0;
  state.counters["per_bin"] = benchmark::Counter(static_cast<double>(state.iterations()) * bins,
                                                 benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}
BENCHMARK(table)->Name("table multiply-accumulate")->Arg(0)->Arg(1)->Arg(3);

}  // namespace
