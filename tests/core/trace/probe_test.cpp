#include "core/trace/probe.hpp"

#include <string>
#include <vector>

#include "sim/effects/candidates.hpp"
#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

using M = With<Hopper<>, effects::Viscous<hopper::Body>, effects::Quadratic<hopper::Leg>, effects::Cubic<hopper::Leg>>;
using P = Probe<M, 16>;

struct Experiment {
  std::vector<double> t, u;
  Course course(double h_max) const { return {t, u, 4, h_max}; }
};
Experiment experiment() {
  Experiment e;
  for (int i = 0; i < 4 + 3 * 32; ++i) {
    e.t.push_back((i - 4) / 32.0);
    e.u.push_back(0.4 * std::sin(0.7 * i) + (i % 5 == 0 ? 0.5 : 0.0));
  }
  return e;
}
Point<M> start() {
  Point<M> p;
  p.set(hopper::Flight{}, {1.8561810757, -1.9213776705, 0.0, 0.7061913262, 1.0822766979});
  return p;
}
P::Values values() {
  P::Values v{};
  std::size_t i = 0;
  const M m;
  visit_parameters(m, [&](auto, auto, double x) { v[i++] = x; });
  return v;
}
int index_of_name(std::string_view wanted) {
  int i = 0, found = -1;
  M m;
  visit_parameters(m, [&](std::string_view n, auto, double) { found = n == wanted && found < 0 ? i : found, ++i; });
  Wires<M> w;
  Wires<M>::visit(w, [&](std::string_view n, auto, double, int) { found = n == wanted && found < 0 ? i : found, ++i; });
  return found;
}
std::vector<double> outputs(const P::Values& v, const Point<M>& from, double h_max = 1.0 / 512) {
  const Experiment e = experiment();
  P probe(v, {});
  std::vector<double> y;
  REQUIRE(probe.run(e.course(h_max), from, [&](std::size_t, const auto& s) {
    y.push_back(s[0].value);
    y.push_back(s[1].value);
  }) == Status::ok);
  return y;
}
// The largest difference between a derivative and its finite difference, over the largest derivative.
double worst(const P::Values& at, int parameter, double step, bool one_sided = false) {
  const Experiment e = experiment();
  const std::array<int, 1> wanted{parameter};
  P probe(at, wanted);
  std::vector<double> gradient;
  probe.run(e.course(1.0 / 512), start(), [&](std::size_t, const auto& s) {
    gradient.push_back(s[0].gradient[P::largest_start]);
    gradient.push_back(s[1].gradient[P::largest_start]);
  });
  P::Values up = at, down = at;
  up[static_cast<std::size_t>(parameter)] += step;
  if (!one_sided) down[static_cast<std::size_t>(parameter)] -= step;
  const auto a = outputs(up, start()), b = outputs(down, start());
  double scale = 0.0, off = 0.0;
  for (std::size_t i = 0; i < gradient.size(); ++i) {
    scale = std::max(scale, std::abs(gradient[i]));
    off = std::max(off, std::abs(gradient[i] - (a[i] - b[i]) / (one_sided ? step : 2.0 * step)));
  }
  REQUIRE(scale > 0.0);
  return off / scale;
}

}  // namespace

TEST_CASE("signatures through events agree with finite differences, for parameters and effects") {
  for (const char* name : {"m", "M", "k", "b", "l0", "a", "g", "c", "k3"}) {
    CAPTURE(name);
    CHECK(worst(values(), index_of_name(name), 1e-5) < 1e-5);
  }
}

TEST_CASE("signatures of the wires agree with finite differences") {
  for (const char* name : {"input_gain", "input_bias", "sensor_gain", "sensor_bias", "clock_offset"}) {
    CAPTURE(name);
    CHECK(worst(values(), index_of_name(name), 1e-5) < 1e-5);
  }
  P::Values late = values();
  late[static_cast<std::size_t>(index_of_name("input_delay"))] = 0.007;
  late[static_cast<std::size_t>(index_of_name("sensor_delay"))] = 0.003;
  CHECK(worst(late, index_of_name("input_delay"), 1e-6) < 1e-4);
  CHECK(worst(late, index_of_name("sensor_delay"), 1e-6) < 1e-4);
  P::Values smooth = values();
  smooth[static_cast<std::size_t>(index_of_name("sensor_lag"))] = 0.01;
  CHECK(worst(smooth, index_of_name("sensor_lag"), 1e-6) < 1e-3);
}

TEST_CASE("a run that begins in mid-motion sees at once what sensors that lag, or are late, have seen by then") {
  const Experiment e = experiment();
  for (const char* wire : {"sensor_lag", "sensor_delay"}) {
    P::Values v = values();
    v[static_cast<std::size_t>(index_of_name(wire))] = 0.007;
    std::vector<double> whole;
    P from_start(v, {});
    from_start.run(e.course(1.0 / 512), start(), [&](std::size_t, const auto& s) {
      whole.push_back(s[0].value);
      whole.push_back(s[1].value);
    });
    for (const std::size_t k : {34u, 36u, 38u, 53u, 55u, 60u}) {  // in flight, three samples or more from an event
      CAPTURE(wire, k);
      P until(values(), {});
      const Course before{std::span(e.t).first(k + 1), std::span(e.u).first(k + 1), 4, 1.0 / 512};
      until.run(before, start(), [](std::size_t, const auto&) {});
      P then(v, {});
      std::vector<double> y;
      then.run(Course{e.t, e.u, k, 1.0 / 512}, until.at(), [&](std::size_t, const auto& s) {
        y.push_back(s[0].value);
        y.push_back(s[1].value);
      });
      CHECK(std::abs(y[0] - whole[2 * (k - 4)]) < 2e-6);
      CHECK(std::abs(y[1] - whole[2 * (k - 4) + 1]) <
            5e-5);  // [m/s] an input's step is a sample back: exp(-31 / 7) left
    }
  }
}

TEST_CASE("a small lag and a small delay are one thing to first order, and so they are at zero") {
  const Experiment e = experiment();
  const std::array<int, 2> wanted{index_of_name("input_delay"), index_of_name("input_lag")};
  P probe(values(), wanted);
  probe.run(e.course(1.0 / 128), start(), [&](std::size_t, const auto& s) {
    CHECK(s[0].gradient[P::largest_start] == s[0].gradient[P::largest_start + 1]);
  });
}

TEST_CASE("a lag of the input is the exact response of a first-order filter") {
  // Against the same input played through the filter by hand, in steps so fine that holding them is exact enough.
  const double lag = 0.02;
  Experiment e = experiment();
  P::Values v = values();
  v[static_cast<std::size_t>(index_of_name("input_lag"))] = lag;
  const auto lagged = outputs(v, start());
  Experiment fine;
  constexpr int parts = 64;
  double state = e.u[0];
  for (std::size_t i = 0; i < e.t.size(); ++i) {
    for (int k = 0; k < parts; ++k) {
      const double h = 1.0 / 32 / parts, next = e.u[i] + (state - e.u[i]) * std::exp(-h / lag);
      fine.t.push_back(e.t[i] + k * h);
      fine.u.push_back(e.u[i] + (state - e.u[i]) * (1.0 - std::exp(-h / lag)) * lag / h);  // the mean over the step
      state = next;
    }
  }
  P probe(values(), {});
  std::vector<double> y;
  const Course course{fine.t, fine.u, 4 * parts, 1.0 / 512};
  probe.run(course, start(), [&](std::size_t i, const auto& s) {
    if (i % parts == 0) {
      y.push_back(s[0].value);
      y.push_back(s[1].value);
    }
  });
  REQUIRE(y.size() == lagged.size());
  for (std::size_t i = 0; i < y.size(); ++i) CHECK(std::abs(y[i] - lagged[i]) < 2e-6);
}

TEST_CASE("values without derivatives are the same values, of moved and of smoothed wires too") {
  const Experiment e = experiment();
  const std::string wire = GENERATE("", "sensor_delay", "sensor_lag", "input_delay", "input_lag");
  CAPTURE(wire);
  P::Values v = values();
  v[static_cast<std::size_t>(index_of_name("c"))] = 0.1;
  if (!wire.empty()) v[static_cast<std::size_t>(index_of_name(wire))] = 0.07;  // [s] two samples and a bit
  std::vector<double> with_gradient, without;
  P a(v, {}), b(v, {});
  a.run(e.course(1.0 / 64), start(), [&](std::size_t, const auto& s) { with_gradient.push_back(s[0].value); });
  b.run(
      e.course(1.0 / 64), start(), [&](std::size_t, const auto& s) { without.push_back(s[0].value); }, false);
  CHECK(with_gradient.size() == e.t.size() - 4);
  CHECK(with_gradient == without);
}
