// A cycle of the hopper: the tick, beside a hand-written integrator that bisects by re-integration.
#include <benchmark/benchmark.h>

#include <cmath>

#include "core/flow/advance.hpp"
#include "core/flow/rk8.hpp"
#include "sim/models/hopper.hpp"

namespace {

using namespace saltus;

// Free run; counts cycles, two events each.
void cycle(benchmark::State& state) {
  const Hopper<> m;
  const Timebase base = timebase_of(m, state.range(0));
  Run<Hopper<>> run;
  run.at = start_of(m);
  const Input<Hopper<>> u = Input<Hopper<>>::Zero();
  for (auto _ : state) {
    for (std::int64_t i = 0; i < base.per_turn; ++i) benchmark::DoNotOptimize(step(m, run, u, base));
  }
  state.counters["per_tick"] = benchmark::Counter(static_cast<double>(state.iterations() * base.per_turn),
                                                  benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
  state.SetLabel(run.ledger[Status::ok] == run.tick ? "ok" : "trouble");
}
BENCHMARK(cycle)->Name("hopper, a cycle of so many ticks | saltus")->Arg(64)->Arg(256)->Arg(512);

// The same physics on plain arrays with libm, no library: what one would write for this model alone.
struct Plain {
  double x[5] = {1.8561810757180, -1.9213776705096, 0.0, 0.7061913261653, 1.0822766978996};
  bool flight = true;

  static void rate(const double* x, double* f, bool flight) {
    const double leg = 10.0 * (2.0 - (x[0] - (flight ? x[3] : 0.0))) + 20.0 * std::sin(x[2]);
    f[0] = x[1];
    f[1] = leg / 2.0 - 2.0;
    f[2] = 2.0 * std::numbers::pi;
    f[3] = flight ? x[4] : 0.0;
    f[4] = flight ? -(leg + 5.0 * x[4]) - 2.0 : 0.0;
  }
  static void rk(const double* x, double* y, double h, bool flight) {
    double a[5], b[5], c[5], d[5], z[5];
    rate(x, a, flight);
    for (int i = 0; i < 5; ++i) z[i] = x[i] + 0.5 * h * a[i];
    rate(z, b, flight);
    for (int i = 0; i < 5; ++i) z[i] = x[i] + 0.5 * h * b[i];
    rate(z, c, flight);
    for (int i = 0; i < 5; ++i) z[i] = x[i] + h * c[i];
    rate(z, d, flight);
    for (int i = 0; i < 5; ++i) y[i] = x[i] + h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]);
  }
  static double guard(const double* x, bool flight) {
    return flight ? x[3] : 10.0 * (2.0 - x[0]) + 20.0 * std::sin(x[2]) + 2.0;
  }
  void tick(double h) {
    while (h > 0.0) {
      double y[5];
      rk(x, y, h, flight);
      const bool was_inside = guard(x, flight) > 1e-12;
      if (!was_inside || guard(y, flight) > 0.0) {
        for (int i = 0; i < 5; ++i) x[i] = y[i];
        return;
      }
      double lo = 0.0, hi = h;
      for (int i = 0; i < 52; ++i) {
        const double mid = 0.5 * (lo + hi);
        rk(x, y, mid, flight);
        (guard(y, flight) > 0.0 ? lo : hi) = mid;
      }
      rk(x, y, hi, flight);
      for (int i = 0; i < 5; ++i) x[i] = y[i];
      x[3] = x[4] = 0.0;
      flight = !flight;
      h -= hi;
    }
  }
};

void plain_cycle(benchmark::State& state) {
  Plain p;
  const double h = 1.0 / static_cast<double>(state.range(0));
  for (auto _ : state) {
    for (std::int64_t i = 0; i < state.range(0); ++i) p.tick(h);
    p.x[2] = 0.0;
    benchmark::DoNotOptimize(p.x[0]);
  }
}
BENCHMARK(plain_cycle)
    ->Name("hopper, a cycle of so many ticks | hand-written, bisection by re-integration")
    ->Arg(64)
    ->Arg(256)
    ->Arg(512);

// A tick in which the foot comes down, and one of the same length before it: the difference is the event.
constexpr double tick = 1.0 / 512.0;  // [s]

struct Landing {
  Point<Hopper<>> before, at;  // a tick before the one with the touchdown, and at its start
  Landing() {
    const Hopper<> m;
    at = start_of(m);
    for (bool landed = false; !landed;) {
      Point<Hopper<>> next = at;
      landed = advance(m, next, Input<Hopper<>>::Zero(), tick).events > 0;
      if (landed) break;
      before = at;
      at = next;
    }
  }
};

template <class Method, bool touchdown>
void one_tick(benchmark::State& state) {
  const Hopper<> m;
  const Landing landing;
  for (auto _ : state) {
    Point<Hopper<>> p = touchdown ? landing.at : landing.before;
    benchmark::DoNotOptimize(advance<Method>(m, p, Input<Hopper<>>::Zero(), tick));
  }
}
BENCHMARK(one_tick<Rk4, true>)->Name("a tick of the hopper with a touchdown | saltus");
BENCHMARK(one_tick<Rk4, false>)->Name("a tick of the hopper with a touchdown | without one");
BENCHMARK(one_tick<Rk8, true>)->Name("a tick of the hopper with a touchdown | saltus rk8");
BENCHMARK(one_tick<Rk8, false>)->Name("a tick of the hopper with a touchdown | saltus rk8, without one");

void plain_touchdown(benchmark::State& state) {
  const Landing landing;
  Plain start;
  for (int i = 0; i < 5; ++i) start.x[i] = landing.at.x[i];
  for (auto _ : state) {
    Plain p = start;
    p.tick(tick);
    benchmark::DoNotOptimize(p.x[0]);
  }
}
BENCHMARK(plain_touchdown)->Name("a tick of the hopper with a touchdown | hand-written, bisection by re-integration");

}  // namespace
