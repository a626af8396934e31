// The hopper's limit cycle with its linearisation on 32 sections, both families: exact, along the flow, and by central
// differences of the maps between sections, at about the best step for them. The label says how far those are off.
#include "core/orbit/orbit.hpp"

#include <benchmark/benchmark.h>

#include <cmath>
#include <cstdio>

#include "sim/models/hopper.hpp"

namespace {

using namespace saltus;

constexpr int sections = 32;
using System = LdtpOf<Hopper<>, sections>;

struct World {
  Hopper<> m;
  Timebase base;
  System system;
  Orbit<Hopper<>, sections> orbit;

  template <class Family>
  World(const Family& family, std::int64_t ticks) : base(timebase_of(m, ticks)) {
    orbit = find_orbit<sections>(m, base, family, system);
    base.sets_clock = Family::on_grid;
  }
  Run<Hopper<>> start() const {
    Run<Hopper<>> run;
    run.at = orbit.point[0];
    return run;
  }
};

// With its derivatives, or the 32 maps from one section to the next alone.
template <class Family, bool linearised>
void cycle(benchmark::State& state) {
  const Family family{sections};
  static World w(family, state.range(0));
  w = World(family, state.range(0));
  static Orbit<Hopper<>, sections> again;
  for (auto _ : state) {
    auto run = w.start();
    benchmark::DoNotOptimize(trace_cycle(w.m, w.base, family, run, again, linearised ? &w.system : nullptr));
  }
}
BENCHMARK(cycle<ClockPhases, true>)->Name("a linearised cycle, clock phases | saltus, exact")->Arg(64)->Arg(512);
BENCHMARK(cycle<KinematicPhases, true>)
    ->Name("a linearised cycle, kinematic phases | saltus, exact")
    ->Arg(64)
    ->Arg(512);
BENCHMARK(cycle<ClockPhases, false>)->Name("a linearised cycle, clock phases | its 32 maps alone")->Arg(64)->Arg(512);
BENCHMARK(cycle<KinematicPhases, false>)
    ->Name("a linearised cycle, kinematic phases | its 32 maps alone")
    ->Arg(64)
    ->Arg(512);

// Every coordinate of every section, and the input, to either side. Clock phases alone: to end on another section the
// runs would have to find it.
void central_differences(benchmark::State& state) {
  using M = Hopper<>;
  const ClockPhases family{sections};
  static World w(family, state.range(0));
  w = World(family, state.range(0));
  const std::int64_t ticks = w.base.per_turn / sections;
  constexpr double d = 1e-5;
  static System rough;
  const auto differences = [&] {
    for (int n = 0; n < sections; ++n) {
      const auto i = static_cast<std::size_t>(n);
      const Point<M>& from = w.orbit.point[i];
      const Point<M>& to = w.orbit.point[(i + 1) % sections];
      const auto in = tangent_of(family, n, w.m, from, Input<M>::Zero());
      const auto out = tangent_of(family, (n + 1) % sections, w.m, to, Input<M>::Zero());
      const auto after = [&](int coordinate, double by) {
        Run<M> run;
        run.at = from;
        run.tick = n * ticks;
        Input<M> u = Input<M>::Zero();
        if (coordinate < 0) {
          u[0] = by;
        } else {
          run.at.x[in.coordinate(coordinate)] += by;
        }
        for (std::int64_t k = 0; k < ticks; ++k) step(w.m, run, u, w.base);
        return run.at.x;
      };
      rough.dim[i] = in.dim;
      for (int j = -1; j < in.dim; ++j) {
        const auto slope = ((after(j, d) - after(j, -d)) / (2.0 * d)).eval();
        for (int k = 0; k < out.dim; ++k) (j < 0 ? rough.B[i](k, 0) : rough.A[i](k, j)) = slope[out.coordinate(k)];
      }
    }
  };
  for (auto _ : state) {
    differences();
    benchmark::ClobberMemory();
  }
  double off = 0.0;
  for (int n = 0; n < sections; ++n) {
    const auto i = static_cast<std::size_t>(n);
    const int rows = w.system.dim[(i + 1) % sections], cols = w.system.dim[i];
    off = std::fmax(off, (rough.A[i] - w.system.A[i]).topLeftCorner(rows, cols).cwiseAbs().maxCoeff());
  }
  char label[48];
  std::snprintf(label, sizeof label, "off by %.1e at most", off);
  state.SetLabel(label);
}
BENCHMARK(central_differences)
    ->Name("a linearised cycle, clock phases | central differences of its maps")
    ->Arg(64)
    ->Arg(512);

}  // namespace
