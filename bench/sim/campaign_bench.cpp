// The paper's whole campaign, isochrons: the limit cycle, 80 experiments of 84 cycles, stimulus, simulation, estimation
// of 620 lines; on one processor and on two.
#include "sim/campaign.hpp"

#include <benchmark/benchmark.h>

#include "sim/models/hopper.hpp"

namespace {

using namespace saltus;

void campaign(benchmark::State& state, int ticks, int jobs) {
  PlanOptions o;
  o.subsets = 80;
  const Plan plan = make_plan(o);
  CampaignOptions c;
  c.settle = 20;
  c.ticks = ticks;
  c.harmonics = 1;
  c.jobs = jobs;
  for (auto _ : state) {
    benchmark::DoNotOptimize(run_campaign(Hopper<>{}, ClockPhases{32}, plan, c, nullptr, {}));
  }
}

[[maybe_unused]] const bool added = [] {
  for (const int ticks : {64, 512}) {
    const std::string work = "the paper's campaign, " + std::to_string(ticks) + " ticks a cycle | ";
    for (const int jobs : {1, 2}) {
      benchmark::RegisterBenchmark((work + (jobs == 1 ? "one processor" : "two")).c_str(), campaign, ticks, jobs)
          ->UseRealTime()
          ->Unit(benchmark::kMillisecond);
    }
  }
  return true;
}();

}  // namespace
