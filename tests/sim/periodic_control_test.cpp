#include "core/spectrum/periodic_control.hpp"

#include <cmath>
#include <memory>

#include "core/orbit/orbit.hpp"
#include "core/spectrum/htf.hpp"
#include "sim/models/hopper_orbit.hpp"
#include "sim/realisation.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;

namespace {

constexpr int sections = 32;

}  // namespace

TEST_CASE("a scalar system: the regulator of the textbook", "[control]") {
  // x+ = 1.2 x + u, q = r = 1: p = q + a^2 p - a^2 p^2 / (r + p), the positive root of p^2 - a^2 p - 1.
  Ldtp<1, 1, 1, 2> system;
  system.dim = {1, 1};
  for (std::size_t n = 0; n < 2; ++n) {
    system.A[n](0, 0) = 1.2;
    system.B[n](0, 0) = 1.0;
    system.C[n](0, 0) = 1.0;
    system.D[n](0, 0) = 0.0;
  }
  PeriodicController<1, 1, 1, 2> controller;
  REQUIRE(controller.design(system, {}) == Status::ok);
  const double p = 0.5 * (1.44 + std::sqrt(1.44 * 1.44 + 4.0));
  for (int n = 0; n < 2; ++n) {
    CHECK(std::abs(controller.gain(n)(0, 0) - 1.2 * p / (1.0 + p)) < 1e-8);
    // The filter's Riccati equation is its transpose: s in the place of p.
    CHECK(std::abs(controller.filter(n)(0, 0) - p / (1.0 + p)) < 1e-8);
  }
  system.B[0](0, 0) = system.B[1](0, 0) = 0.0;  // unstable and out of reach
  CHECK(controller.design(system, {}) == Status::failed);
}

TEST_CASE("the hopper, pushed off its cycle, comes back faster under the model identified from its HTFs", "[control]") {
  const Hopper<> m;
  const ClockPhases family{sections};
  const Timebase base = timebase_of(m, 512);
  LdtpOf<Hopper<>, sections> exact;
  const auto orbit = find_orbit<sections>(m, base, family, exact);
  REQUIRE(orbit.status == Status::ok);
  HtfTable t;
  t.sections = sections;
  t.outputs = 2;
  for (int q = 1; q < 160; ++q) {
    const double omega = 2.0 * std::numbers::pi * q / 512;
    const auto h = htf(exact, omega);
    Eigen::MatrixXcd value(sections, 2);
    for (int k = 0; k < sections; ++k) value.row(k) = h(k).col(0).transpose();
    t.omega.push_back(omega);
    t.value.push_back(value);
    t.sigma.emplace_back(Eigen::MatrixXd::Zero(sections, 2));
  }
  Ldtp<4, 1, 2, sections> model;
  REQUIRE(copy_to(realise(t).model, model));
  ControlWeights<1, 2> weights;
  weights.output = Vec<2>(1e4, 1e2).asDiagonal();
  weights.noise = Vec<2>(1e-6, 3.6e-5).asDiagonal();
  PeriodicController<4, 1, 2, sections> controller;
  REQUIRE(controller.design(model, weights) == Status::ok);

  const auto left_after = [&](bool controlled, int cycles) {
    controller.reset();
    Run<Hopper<>> run;
    run.at = orbit.point[0];
    run.at.x[0] += 0.02;
    double square = 0.0;
    std::int64_t allocated = 0;
    for (int n = 0; n < cycles * sections; ++n) {
      const int section = n % sections;
      const auto s = static_cast<std::size_t>(section);
      const Vec<2> y = output_at(m, run.at, Input<Hopper<>>(Input<Hopper<>>::Zero())) - orbit.output[s];
      const test::AllocationCount count;
      const Vec<1> u = controller.step(section, y);
      allocated += count();
      if (n >= (cycles - 1) * sections) square += y[0] * y[0];
      REQUIRE(usable(to_next_section(m, run, section, Input<Hopper<>>(controlled ? u[0] : 0.0), base, family,
                                     [](const Point<Hopper<>>&, const Passage&) {})));
    }
    CHECK(allocated == 0);
    return std::sqrt(square / sections);
  };
  const double free_fall = left_after(false, 4), held = left_after(true, 4);
  INFO(free_fall << " " << held);
  CHECK(held < 0.1 * free_fall);
}
