// The paper's whole campaign, isochrons: the limit cycle, 80 experiments of 84 cycles, stimulus, simulation, estimation
// of 620 lines; by the plain route, experiment by experiment, and in lanes; on one processor and on two.
#include "sim/campaign.hpp"

#include <benchmark/benchmark.h>

#include "sim/models/hopper.hpp"

namespace {

using namespace saltus;

void campaign(benchmark::State& state, int ticks, int jobs, bool lanes) {
  PlanOptions o;
  o.subsets = 80;
  const Plan plan = make_plan(o);
  CampaignOptions c;
  c.settle = 20;
  c.ticks = ticks;
  c.harmonics = 1;
  c.jobs = jobs;
  c.lanes = lanes;
  for (auto _ : state) {
    benchmark::DoNotOptimize(run_campaign(Hopper<>{}, ClockPhases{32}, plan, c, nullptr, {}));
  }
}

[[maybe_unused]] const bool added = [] {
  for (const int ticks : {64, 512}) {
    const std::string work = "the paper's campaign, " + std::to_string(ticks) + " ticks a cycle | ";
    const auto add = [&](const char* who, int jobs, bool lanes) {
      benchmark::RegisterBenchmark((work + who).c_str(), campaign, ticks, jobs, lanes)
          ->UseRealTime()
          ->Unit(benchmark::kMillisecond);
    };
    add("one processor", 1, true);
    add("two", 2, true);
    add("plain route, one processor", 1, false);
    add("plain route, two", 2, false);
  }
  return true;
}();

}  // namespace
