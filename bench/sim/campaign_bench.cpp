// The paper's whole campaign, isochrons: 80 experiments of 84 cycles, stimulus, simulation, estimation of 620 lines.
#include "sim/campaign.hpp"

#include <benchmark/benchmark.h>

#include "sim/models/hopper.hpp"

namespace {

using namespace saltus;

void campaign(benchmark::State& state) {
  PlanOptions o;
  o.subsets = 80;
  const Plan plan = make_plan(o);
  CampaignOptions c;
  c.settle = 20;
  c.ticks = state.range(0);
  c.harmonics = 1;
  for (auto _ : state) {
    benchmark::DoNotOptimize(run_campaign(Hopper<>{}, ClockPhases{32}, plan, c, nullptr, {}));
  }
}
BENCHMARK(campaign)->Name("the paper's campaign")->Arg(64)->Arg(512)->Unit(benchmark::kMillisecond);

}  // namespace
