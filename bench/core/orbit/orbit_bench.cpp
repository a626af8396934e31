// The limit cycle of the hopper with its exact linearisation on 32 sections, both families.
#include "core/orbit/orbit.hpp"

#include <benchmark/benchmark.h>

#include "sim/models/hopper.hpp"

namespace {

using namespace saltus;

template <class Family>
void linearised_cycle(benchmark::State& state) {
  const Hopper<> m;
  static LdtpOf<Hopper<>, 32> system;
  const Family family{32};
  Timebase base = timebase_of(m, state.range(0));
  const auto orbit = find_orbit<32>(m, base, family, system);
  base.sets_clock = Family::on_grid;
  static Orbit<Hopper<>, 32> again;
  for (auto _ : state) {
    Run<Hopper<>> run;
    run.at = orbit.point[0];
    benchmark::DoNotOptimize(trace_cycle(m, base, family, run, again, &system));
  }
}
BENCHMARK(linearised_cycle<ClockPhases>)->Name("hopper/linearised cycle, clock phases")->Arg(64)->Arg(512);
BENCHMARK(linearised_cycle<KinematicPhases>)->Name("hopper/linearised cycle, kinematic phases")->Arg(64)->Arg(512);

}  // namespace
