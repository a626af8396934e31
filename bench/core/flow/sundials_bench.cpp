// The cycles of cycle_bench.cpp by SUNDIALS CVODE with its own root finding: Adams with fixed-point iteration, BDF with
// Newton's and a dense matrix. Each takes the loosest tolerance whose error after the cycle is below the one asked for.
// Debian's library is compiled without optimisation (-O0), which makes it three to four times slower than its source at
// -O3: the label says which build is meant, as the CMake of this folder found it.
#ifdef SALTUS_BENCH_SUNDIALS
#include <benchmark/benchmark.h>
#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_context.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#include <cstdio>
#include <memory>
#include <string>
#include <tuple>

#include "cycles.hpp"

namespace {

using namespace saltus;

enum class Method { adams, bdf };
enum class End { event, time, failure };

sundials::Context& context() {
  static sundials::Context c;
  return c;
}

// CVODE for one chart of a model, from which one edge leads.
template <class M, class E>
class Leg {
 public:
  using C = typename E::from;
  static constexpr int n = C::dim;
  using V = Eigen::Map<const Vec<n>>;

  Leg(const M& m, Method method) : m_(m), x_(N_VNew_Serial(n, context())) {
    cvode_ = CVodeCreate(method == Method::adams ? CV_ADAMS : CV_BDF, context());
    const auto rate = [](sunrealtype, N_Vector x, N_Vector xdot, void* self) {
      const Vec<n> f = static_cast<Leg*>(self)->m_.flow(C{}, V(NV_DATA_S(x)), Input<M>::Zero());
      for (int i = 0; i < n; ++i) NV_Ith_S(xdot, i) = f[i];
      return 0;
    };
    const auto guard = [](sunrealtype, N_Vector x, sunrealtype* g, void* self) {
      *g = static_cast<Leg*>(self)->m_.guard(E{}, Vec<n>(V(NV_DATA_S(x))), Input<M>::Zero());
      return 0;
    };
    N_VConst(0.0, x_);
    CVodeInit(cvode_, rate, 0.0, x_);
    CVodeSetUserData(cvode_, this);
    CVodeRootInit(cvode_, 1, guard);
    int falling = -1;
    CVodeSetRootDirection(cvode_, &falling);
    CVodeSetMaxNumSteps(cvode_, 1000000);
    if (method == Method::adams) {
      fixed_point_ = SUNNonlinSol_FixedPoint(x_, 0, context());
      CVodeSetNonlinearSolver(cvode_, fixed_point_);
    } else {
      matrix_ = SUNDenseMatrix(n, n, context());
      linear_ = SUNLinSol_Dense(x_, matrix_, context());
      CVodeSStolerances(cvode_, 1e-6, 1e-6);
      CVodeSetLinearSolver(cvode_, linear_, matrix_);
    }
  }
  ~Leg() {
    CVodeFree(&cvode_);
    if (fixed_point_ != nullptr) SUNNonlinSolFree(fixed_point_);
    if (linear_ != nullptr) SUNLinSolFree(linear_);
    if (matrix_ != nullptr) SUNMatDestroy(matrix_);
    N_VDestroy(x_);
  }
  Leg(const Leg&) = delete;
  Leg& operator=(const Leg&) = delete;

  // From time t to the edge, or to `end`; x is then there.
  End operator()(Vec<n>& x, double& t, double end, double tolerance) {
    for (int i = 0; i < n; ++i) NV_Ith_S(x_, i) = x[i];
    CVodeReInit(cvode_, t, x_);
    CVodeSStolerances(cvode_, tolerance, tolerance);
    CVodeSetStopTime(cvode_, end);
    const int flag = CVode(cvode_, end, x_, &t, CV_NORMAL);
    x = V(NV_DATA_S(x_));
    return flag == CV_ROOT_RETURN ? End::event : flag < 0 ? End::failure : End::time;
  }

 private:
  M m_;
  N_Vector x_;
  void* cvode_ = nullptr;
  SUNNonlinearSolver fixed_point_ = nullptr;
  SUNMatrix matrix_ = nullptr;
  SUNLinearSolver linear_ = nullptr;
};

template <class M, class... Es>
auto make_legs(const M& m, Method method, List<Es...>) {
  return std::make_tuple(std::make_unique<Leg<M, Es>>(m, method)...);
}

// The cycle from p; false where the library gives up.
template <class M, class Last, class Legs>
bool run(const Cycle<M, Last>& cycle, Legs& legs, Point<M>& p, double tolerance) {
  double t = 0.0;
  bool moved = false, over = false, good = true;
  const auto take = [&]<class E>(Leg<M, E>& leg) {
    using C = typename E::from;
    if (moved || over || p.chart != index_of<C>(typename M::Charts{})) return;
    moved = true;
    Vec<C::dim> x = p.in(C{});
    switch (leg(x, t, cycle.span, tolerance)) {
      case End::event:
        p.set(typename E::to{}, cycle.m.reset(E{}, x, Input<M>::Zero()));
        over = std::is_same_v<E, Last>;
        break;
      case End::time:
        p.set(C{}, x);
        over = true;
        break;
      case End::failure:
        good = false;
    }
  };
  while (!over && good) {
    moved = false;
    std::apply([&](auto&... leg) { (take(*leg), ...); }, legs);
  }
  return good;
}

template <class M, class Last>
void measure(benchmark::State& state, const Cycle<M, Last>& cycle, double wanted, Method method) {
  auto legs = make_legs(cycle.m, method, typename M::Edges{});
  double tolerance = 1e-3, error = std::numeric_limits<double>::infinity();
  for (;; tolerance *= 0.5) {
    Point<M> p = cycle.start;
    const bool good = run(cycle, legs, p, tolerance);
    error = good ? cycle.error(p) : std::numeric_limits<double>::infinity();
    if (error <= wanted) break;
    if (tolerance < 1e-15) return state.SkipWithError("does not reach the error");
  }
  for (auto _ : state) {
    Point<M> p = cycle.start;
    run(cycle, legs, p, tolerance);
    benchmark::DoNotOptimize(p);
  }
  char label[96];
  std::snprintf(label, sizeof label, "tolerance %.1e, error %.1e; library built %s", tolerance, error,
                SALTUS_BENCH_SUNDIALS);
  state.SetLabel(label);
}

template <class World>
void add(const std::string& name, const World& (*world)()) {
  for (const double wanted : {1e-6, 1e-9}) {
    char asked[16];
    std::snprintf(asked, sizeof asked, "%.0e", wanted);
    for (const Method method : {Method::adams, Method::bdf}) {
      const std::string who = method == Method::adams ? "CVODE Adams" : "CVODE BDF";
      benchmark::RegisterBenchmark((name + ", a cycle to " + asked + " | " + who).c_str(),
                                   [=](benchmark::State& s) { measure(s, world(), wanted, method); });
    }
  }
}

[[maybe_unused]] const bool added = [] {
  add("hopper", hopper_cycle);
  add("kneed biped", biped_cycle);
  return true;
}();

}  // namespace
#endif
