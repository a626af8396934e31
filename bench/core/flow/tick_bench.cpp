// One tick of a control loop: take u, run the hopper over a section interval with the event that may lie in it, update
// 93 lines of both outputs. Every tick is timed; the counters are quantiles [ns]. The clock's own time is in all of
// them, and alone in the empty loop; the far tail is the machine's.
#include <benchmark/benchmark.h>

#include <memory>
#include <vector>

#include "bench/quantiles.hpp"
#include "core/flow/advance.hpp"
#include "core/spectrum/estimator.hpp"
#include "sim/models/hopper.hpp"

namespace {

using namespace saltus;
constexpr int sections = 32, period = 64, tones = 31;

void tick(benchmark::State& state) {
  const Hopper<> m;
  const Timebase base = timebase_of(m, sections);
  const auto e = std::make_unique<HtfEstimator<tones, 1, 2, sections, period>>();
  std::array<int, tones> lines{};
  Multisine<tones> stimulus(sections * period);
  for (int k = 0; k < tones; ++k) {
    lines[static_cast<std::size_t>(k)] = k + 1;
    if (!stimulus.add({k + 1, 0.005, 1.3 * k * k})) state.SkipWithError("capacities");
  }
  if (e->configure(sections, period, lines, 1) != Status::ok) state.SkipWithError("capacities");
  std::vector<double> u(sections * period);
  for (std::size_t n = 0; n < u.size(); ++n) u[n] = stimulus(static_cast<std::int64_t>(n));
  Run<Hopper<>> run;
  run.at = start_of(m);
  Status worst = Status::ok;
  const auto work = [&](std::int64_t n) {
    const Input<Hopper<>> held(u[static_cast<std::size_t>(n) % u.size()]);
    worst = worse(worst, step(m, run, held, base).status);
    const auto y = output_at(m, run.at, held);
    benchmark::DoNotOptimize(e->push(n, {y[0], y[1]}));
  };
  for (std::int64_t n = 0; n < 4 * sections * period; ++n) work(n);
  e->restart();
  for (std::int64_t n = 0; n < 4 * sections * period; ++n) work(n);
  time_each(state, [&](std::int64_t n) { work(n + 4 * sections * period); });
  state.SetLabel(std::string(name(worst)));
}
BENCHMARK(tick)->Name("a tick, 93 lines of 2 signals | saltus");

void empty(benchmark::State& state) {
  time_each(state, [](std::int64_t) {});
}
BENCHMARK(empty)->Name("a tick, 93 lines of 2 signals | empty loop");

}  // namespace
