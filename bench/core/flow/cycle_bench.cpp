// A free cycle of the hopper and of the kneed biped, from the limit cycle once around, by every method at hand on the
// same right-hand side, guards and resets. Each takes the coarsest of its settings whose error after the cycle, the
// largest of any coordinate, is below the one asked for; the label says both.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>

#include "core/flow/rk8.hpp"
#include "cycles.hpp"
#ifdef SALTUS_BENCH_ODEINT
#include <boost/numeric/odeint/stepper/generation.hpp>
#include <boost/numeric/odeint/stepper/runge_kutta4.hpp>
#include <boost/numeric/odeint/stepper/runge_kutta_dopri5.hpp>
#endif
#ifdef SALTUS_BENCH_GSL
#include <gsl/gsl_errno.h>
#include <gsl/gsl_odeiv2.h>
#endif

namespace {

using namespace saltus;

// Ours, `steps` a second, tried at errors a quarter apart, of order eight a half.
template <class Method>
struct Saltus {
  double steps;
  static constexpr double coarsest = Method::long_steps ? 4.0 : 8.0, finest = 1e5;
  static constexpr double finer = Method::long_steps ? 1.0905 : std::numbers::sqrt2;
  static double next(double s) { return std::ceil(s * finer); }
  static std::string text(double s) { return std::to_string(static_cast<int>(s)) + " steps a second"; }

  template <class World>
  void operator()(const World& w, Point<typename World::Model>& p) const {
    using M = typename World::Model;
    if constexpr (clocked<M>) {
      const Timebase base = timebase_of(w.m, static_cast<std::int64_t>(steps));
      Run<M> run;
      run.at = p;
      while (run.tick < base.per_turn) step<Method>(w.m, run, Input<M>::Zero(), base);
      p = run.at;
    } else {
      for (bool over = false; !over;) {
        const SectionWatch<AtEdge<kneed_biped::FootStrike>> watch{{}, 0};
        const Passage r = advance<Method>(w.m, p, Input<M>::Zero(), 1.0 / steps, watch);
        over = r.met || !usable(r.status);
      }
      using E = kneed_biped::FootStrike;
      p.set(E::to{}, w.m.reset(E{}, p.in(E::from{}), Input<M>::Zero()));
    }
  }
};

#if defined SALTUS_BENCH_ODEINT || defined SALTUS_BENCH_GSL
std::string tolerance_as_text(double s) {
  char t[48];
  std::snprintf(t, sizeof t, "tolerance %.1e", s);
  return t;
}

// Where `above`(t), true at lo, is no longer so.
double halve(int times, double lo, double hi, const auto& above) {
  for (int i = 0; i < times; ++i) {
    const double mid = 0.5 * (lo + hi);
    (above(mid) ? lo : hi) = mid;
  }
  return hi;
}

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

#endif

#ifdef SALTUS_BENCH_ODEINT
namespace odeint = boost::numeric::odeint;

// Fixed steps, events by halving the step and integrating again.
struct OdeintRk4 {
  double steps;
  static constexpr double coarsest = 8.0, finest = 1e5;
  static double next(double s) { return std::ceil(s * std::numbers::sqrt2); }
  static std::string text(double s) { return Saltus<Rk4>::text(s); }

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
          const double lived = halve(52, 0.0, h, [&](double mid) {
            method.do_step(f, x, t, y, mid);
            return guard(y) > 0.0;
          });
          method.do_step(f, x, t, y, lived);
          x = y;
          t += lived;
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
  static std::string text(double s) { return tolerance_as_text(s); }

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
        const double now = last ? end : method.current_time();
        X y;
        method.calc_state(now, y);
        const double g = guard(y);
        if (armed && !(g > 0.0)) {
          t = halve(52, method.previous_time(), now, [&](double mid) {
            method.calc_state(mid, y);
            return guard(y) > 0.0;
          });
          method.calc_state(t, x);
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

#ifdef SALTUS_BENCH_GSL
// Error-controlled steps of order eight; events by halving on the step's cubic, then by Newton's method on steps taken
// again. The workspaces are kept.
template <std::size_t N>
struct GslWorkspace {
  gsl_odeiv2_step* step = gsl_odeiv2_step_alloc(gsl_odeiv2_step_rk8pd, N);
  gsl_odeiv2_control* control = gsl_odeiv2_control_y_new(1.0, 1.0);
  gsl_odeiv2_evolve* evolve = gsl_odeiv2_evolve_alloc(N);
  GslWorkspace() = default;
  GslWorkspace(const GslWorkspace&) = delete;
  GslWorkspace& operator=(const GslWorkspace&) = delete;
  ~GslWorkspace() {
    gsl_odeiv2_evolve_free(evolve);
    gsl_odeiv2_control_free(control);
    gsl_odeiv2_step_free(step);
  }
};

struct GslRk8pd {
  double tolerance;
  static constexpr double coarsest = 1e-3, finest = 1e15;
  static double next(double s) { return 0.5 * s; }
  static std::string text(double s) { return tolerance_as_text(s); }

  template <class World>
  void operator()(const World& w, Point<typename World::Model>& p) const {
    double h = 0.05;  // carried on from leg to leg
    by_legs(w, p, [&](const auto& f, const auto& guard, auto& x, double& t, double end) {
      using X = std::remove_reference_t<decltype(x)>;
      using F = std::remove_cvref_t<decltype(f)>;
      constexpr std::size_t n = std::tuple_size_v<X>;
      static GslWorkspace<n> work;
      gsl_odeiv2_control_init(work.control, tolerance, tolerance, 1.0, 0.0);
      gsl_odeiv2_evolve_reset(work.evolve);
      gsl_odeiv2_step_reset(work.step);
      gsl_odeiv2_system system{};
      system.function = [](double at, const double* y, double* rate, void* closure) {
        X state, its_rate;
        std::copy_n(y, n, state.begin());
        (*static_cast<const F*>(closure))(state, its_rate, at);
        std::copy_n(its_rate.begin(), n, rate);
        return static_cast<int>(GSL_SUCCESS);
      };
      system.dimension = n;
      system.params = const_cast<void*>(static_cast<const void*>(&f));
      bool armed = guard(x) > 1e-12;
      while (t < end) {
        const X x0 = x;
        const double t0 = t;
        gsl_odeiv2_evolve_apply(work.evolve, work.control, work.step, &system, &t, end, &h, x.data());
        const double g = guard(x);
        if (armed && !(g > 0.0)) {
          const double length = t - t0;
          X f0, f1, y, rate, error;
          std::copy_n(work.evolve->dydt_in, n, f0.begin());
          std::copy_n(work.evolve->dydt_out, n, f1.begin());
          double lived = length * halve(20, 0.0, 1.0, [&](double s) {
            const double r = 1.0 - s;
            for (std::size_t k = 0; k < n; ++k) {
              y[k] = r * r * (1.0 + 2.0 * s) * x0[k] + s * s * (1.0 + 2.0 * r) * x[k] +
                     length * s * r * (r * f0[k] - s * f1[k]);
            }
            return guard(y) > 0.0;
          });
          for (int i = 0; i < 8; ++i) {
            y = x0;
            gsl_odeiv2_step_apply(work.step, t0, lived, y.data(), error.data(), f0.data(), rate.data(), &system);
            constexpr double moment = 1e-7;
            X soon;
            for (std::size_t k = 0; k < n; ++k) soon[k] = y[k] + moment * rate[k];
            const double slope = (guard(soon) - guard(y)) / moment, off = -guard(y) / slope;
            if (std::abs(off) < 1e-7) {  // the rest is straight
              for (std::size_t k = 0; k < n; ++k) y[k] += off * rate[k];
              lived += off;
              break;
            }
            lived += off;
          }
          x = y;
          t = t0 + lived;
          return true;
        }
        armed = g > 0.0;
      }
      return false;
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
    method("saltus", Saltus<Rk4>{});
    method("saltus rk8", Saltus<Rk8>{});
#ifdef SALTUS_BENCH_ODEINT
    method("odeint rk4, bisection", OdeintRk4{});
    method("odeint dopri5, dense output", OdeintDopri5{});
#endif
#ifdef SALTUS_BENCH_GSL
    method("gsl rk8pd, cubic and newton", GslRk8pd{});
#endif
  }
}

[[maybe_unused]] const bool added = [] {
  add("hopper", hopper_cycle);
  add("kneed biped", biped_cycle);
  return true;
}();

}  // namespace
