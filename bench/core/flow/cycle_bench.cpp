// A free cycle of the hopper and of the kneed biped, from the limit cycle once around, by every method at hand on the
// same right-hand side, guards and resets. Each takes the coarsest of its settings whose error after the cycle, the
// largest of any coordinate, is below the one asked for; the label says both.
#include <benchmark/benchmark.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>

#include "core/orbit/orbit.hpp"
#include "sim/models/hopper.hpp"
#include "sim/models/kneed_biped.hpp"
#ifdef SALTUS_BENCH_ODEINT
#include <boost/numeric/odeint/stepper/generation.hpp>
#include <boost/numeric/odeint/stepper/runge_kutta4.hpp>
#include <boost/numeric/odeint/stepper/runge_kutta_dopri5.hpp>
#endif

namespace {

using namespace saltus;

// Where a cycle begins, and when it is over: after `span` seconds, or with the reset of the edge Last.
template <class M, class Last>
struct Cycle {
  using Model = M;
  M m;
  Point<M> start;
  double span = std::numeric_limits<double>::infinity();  // [s]

  template <class E>
  static constexpr bool ends_with = std::is_same_v<E, Last>;

  double error(const Point<M>& p) const {
    const Vec<max_dim<M>> d = orbit::difference(p, start);
    return p.chart == start.chart ? d.template lpNorm<Eigen::Infinity>() : std::numeric_limits<double>::infinity();
  }
};

struct Never {};
using HopperCycle = Cycle<Hopper<>, Never>;
using BipedCycle = Cycle<KneedBiped<>, kneed_biped::FootStrike>;

const HopperCycle& hopper_cycle() {
  static const HopperCycle cycle = [] {
    HopperCycle c;
    auto system = std::make_unique<LdtpOf<Hopper<>, 2>>();
    c.start = find_orbit<2>(c.m, timebase_of(c.m, 8192), ClockPhases{2}, *system).point[0];
    c.span = 1.0;
    return c;
  }();
  return cycle;
}

const BipedCycle& biped_cycle() {
  static const BipedCycle cycle = [] {
    using E = kneed_biped::FootStrike;
    BipedCycle c;
    auto system = std::make_unique<LdtpOf<KneedBiped<>, 1>>();
    const auto found = find_orbit<1>(c.m, timebase_of(c.m, 8192), AtEdge<E>{}, *system);
    c.start.set(E::to{}, c.m.reset(E{}, found.point[0].in(E::from{}), Input<KneedBiped<>>::Zero()));
    return c;
  }();
  return cycle;
}

// Ours, `steps` a second.
struct Saltus {
  double steps;
  static constexpr double coarsest = 8.0, finer = std::numbers::sqrt2, finest = 1e5;
  static double next(double s) { return std::ceil(s * finer); }
  static std::string text(double s) { return std::to_string(static_cast<int>(s)) + " steps a second"; }

  template <class World>
  void operator()(const World& w, Point<typename World::Model>& p) const {
    using M = typename World::Model;
    if constexpr (clocked<M>) {
      const Timebase base = timebase_of(w.m, static_cast<std::int64_t>(steps));
      Run<M> run;
      run.at = p;
      while (run.tick < base.per_turn) step(w.m, run, Input<M>::Zero(), base);
      p = run.at;
    } else {
      for (bool over = false; !over;) {
        const Passage r =
            advance(w.m, p, Input<M>::Zero(), 1.0 / steps, SectionWatch<AtEdge<kneed_biped::FootStrike>>{{}, 0});
        over = r.met || !usable(r.status);
      }
      using E = kneed_biped::FootStrike;
      p.set(E::to{}, w.m.reset(E{}, p.in(E::from{}), Input<M>::Zero()));
    }
  }
};

#ifdef SALTUS_BENCH_ODEINT
namespace odeint = boost::numeric::odeint;

// Runs legs of another library: `leg(f, guard, x, t, end)` moves x and t to the guard's fall through zero, or to the
// end, and says which.
template <class World, class Leg>
void by_legs(const World& w, Point<typename World::Model>& p, const Leg& leg) {
  using M = typename World::Model;
  const Input<M> u = Input<M>::Zero();
  double t = 0.0;
  bool over = false;
  while (!over) {
    visit_chart(p, [&](auto c) {
      using C = std::remove_cvref_t<decltype(c)>;
      constexpr int n = C::dim;
      using X = std::array<double, n>;
      using V = Eigen::Map<const Vec<n>>;
      const auto f = [&](const X& x, X& rate, double) {
        const Vec<n> v = w.m.flow(C{}, V(x.data()), u);
        for (int i = 0; i < n; ++i) rate[static_cast<std::size_t>(i)] = v[i];
      };
      visit_each(typename M::Edges{}, [&](auto e) {
        using E = decltype(e);
        if constexpr (std::is_same_v<typename E::from, C>) {  // the only one of its chart
          const auto guard = [&](const X& x) { return w.m.guard(e, Vec<n>(V(x.data())), u); };
          X x;
          for (int i = 0; i < n; ++i) x[static_cast<std::size_t>(i)] = p.x[i];
          if (leg(f, guard, x, t, w.span)) {
            p.set(typename E::to{}, w.m.reset(e, Vec<n>(V(x.data())), u));
            over = World::template ends_with<E>;
          } else {
            p.set(c, Vec<n>(V(x.data())));
            over = true;
          }
        }
      });
    });
  }
}

// Fixed steps, events by halving the step and integrating again.
struct OdeintRk4 {
  double steps;
  static constexpr double coarsest = 8.0, finest = 1e5;
  static double next(double s) { return std::ceil(s * std::numbers::sqrt2); }
  static std::string text(double s) { return Saltus::text(s); }

  template <class World>
  void operator()(const World& w, Point<typename World::Model>& p) const {
    by_legs(w, p, [&](const auto& f, const auto& guard, auto& x, double& t, double end) {
      odeint::runge_kutta4<std::remove_reference_t<decltype(x)>> method;
      bool armed = guard(x) > 1e-12;
      while (t < end) {
        const double h = std::fmin(1.0 / steps, end - t);
        auto y = x;
        method.do_step(f, x, t, y, h);
        const double g = guard(y);
        if (armed && !(g > 0.0)) {
          double lo = 0.0, hi = h;
          for (int i = 0; i < 52; ++i) {
            const double mid = 0.5 * (lo + hi);
            method.do_step(f, x, t, y, mid);
            (guard(y) > 0.0 ? lo : hi) = mid;
          }
          method.do_step(f, x, t, y, hi);
          x = y;
          t += hi;
          return true;
        }
        armed = g > 0.0;
        x = y;
        t = h < 1.0 / steps ? end : t + h;
      }
      return false;
    });
  }
};

// Error-controlled steps, events by halving on the dense output.
struct OdeintDopri5 {
  double tolerance;
  static constexpr double coarsest = 1e-3, finest = 1e15;
  static double next(double s) { return 0.5 * s; }
  static std::string text(double s) {
    char t[48];
    std::snprintf(t, sizeof t, "tolerance %.1e", s);
    return t;
  }

  template <class World>
  void operator()(const World& w, Point<typename World::Model>& p) const {
    by_legs(w, p, [&](const auto& f, const auto& guard, auto& x, double& t, double end) {
      using X = std::remove_reference_t<decltype(x)>;
      auto method = odeint::make_dense_output(tolerance, tolerance, odeint::runge_kutta_dopri5<X>());
      method.initialize(x, t, 0.01);
      bool armed = guard(x) > 1e-12;
      for (;;) {
        method.do_step(f);
        const bool last = method.current_time() >= end;
        double hi = last ? end : method.current_time();
        X y;
        method.calc_state(hi, y);
        const double g = guard(y);
        if (armed && !(g > 0.0)) {
          double lo = method.previous_time();
          for (int i = 0; i < 52; ++i) {
            const double mid = 0.5 * (lo + hi);
            method.calc_state(mid, y);
            (guard(y) > 0.0 ? lo : hi) = mid;
          }
          method.calc_state(hi, x);
          t = hi;
          return true;
        }
        if (last) {
          x = y;
          t = end;
          return false;
        }
        armed = g > 0.0;
      }
    });
  }
};
#endif

template <class Method, class World>
void measure(benchmark::State& state, const World& w, double wanted) {
  double setting = Method::coarsest, error = std::numeric_limits<double>::infinity();
  for (;; setting = Method::next(setting)) {
    Point<typename World::Model> p = w.start;
    Method{setting}(w, p);
    error = w.error(p);
    if (error <= wanted) break;
    if (setting > Method::finest || setting < 1e-15) {
      state.SkipWithError("does not reach the error");
      return;
    }
  }
  for (auto _ : state) {
    Point<typename World::Model> p = w.start;
    Method{setting}(w, p);
    benchmark::DoNotOptimize(p);
  }
  char label[96];
  std::snprintf(label, sizeof label, "%s, error %.1e", Method::text(setting).c_str(), error);
  state.SetLabel(label);
}

template <class World>
void add(const std::string& name, const World& (*world)()) {
  for (const double wanted : {1e-6, 1e-9}) {
    char asked[16];
    std::snprintf(asked, sizeof asked, "%.0e", wanted);
    const std::string work = name + ", a cycle to " + asked + " | ";
    const auto method = [&](const char* who, auto m) {
      benchmark::RegisterBenchmark((work + who).c_str(),
                                   [=](benchmark::State& s) { measure<decltype(m)>(s, world(), wanted); });
    };
    method("saltus", Saltus{});
#ifdef SALTUS_BENCH_ODEINT
    method("odeint rk4, bisection", OdeintRk4{});
    method("odeint dopri5, dense output", OdeintDopri5{});
#endif
  }
}

[[maybe_unused]] const bool added = [] {
  add("hopper", hopper_cycle);
  add("kneed biped", biped_cycle);
  return true;
}();

}  // namespace
