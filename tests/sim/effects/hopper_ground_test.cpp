#include <array>
#include <cmath>
#include <numbers>

#include "sim/diagnosis/machine.hpp"
#include "sim/diagnosis/synthetic.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;
using namespace saltus::diagnosis;

namespace {

// The hopper's equations written out once more, with short steps of Heun's method and an event where a step ends on the
// far side: slow, first order at events, and nothing in common with the kernels.
struct Slow {
  double restitution = 0.0, compliance = 0.0;
  double y = 1.8561810757, v = -1.9213776705, foot = 0.7061913262, foot_v = 1.0822766979;
  bool standing = false;

  double leg(double t, double body, double lower) const {
    return 10.0 * (2.0 - (body - lower)) + 20.0 * std::sin(2.0 * std::numbers::pi * t);
  }
  std::array<double, 4> rate(double t, const std::array<double, 4>& x) const {
    const double force = leg(t, x[0], standing ? 0.0 : x[2]);
    if (standing) return {x[1], force / 2.0 - 2.0, 0.0, 0.0};
    double below = -force - 2.0 - 5.0 * x[3];
    if (compliance > 0.0 && in_ground) {
      below = -force - 2.0 - x[2] / compliance - 6.0 / std::sqrt(compliance) * x[3];
    }
    return {x[1], force / 2.0 - 2.0, x[3], below};
  }
  bool in_ground = false;

  void step(double t, double h) {
    std::array<double, 4> x{y, v, foot, foot_v}, a = rate(t, x), middle{};
    for (std::size_t i = 0; i < 4; ++i) middle[i] = x[i] + h * a[i];
    const auto b = rate(t + h, middle);
    for (std::size_t i = 0; i < 4; ++i) x[i] += 0.5 * h * (a[i] + b[i]);
    y = x[0], v = x[1], foot = x[2], foot_v = x[3];
    if (standing) {
      foot = foot_v = 0.0;
      if (leg(t + h, y, 0.0) + 2.0 <= 0.0) standing = false;
    } else if (in_ground) {
      in_ground = -foot / compliance - 6.0 / std::sqrt(compliance) * foot_v > 0.0;
    } else if (foot <= 0.0 && foot_v < 0.0) {
      if (compliance > 0.0) {
        in_ground = true;
      } else if (-restitution * foot_v > 2e-3) {
        foot_v *= -restitution;
        foot = 0.0;
      } else {
        standing = true;
        foot = foot_v = 0.0;
      }
    }
  }
};

// The body's height at whole turns, by the model with its candidates.
std::vector<double> heights(const std::string& coefficient, double value, int turns) {
  const auto m = make_machine("hopper");
  std::vector<double> values, t, u, r;
  REQUIRE(values_with(*m, {{coefficient, value}}, values));
  for (int i = 0; i <= 32 * turns; ++i) {
    t.push_back(i / 32.0);
    u.push_back(0.0);
  }
  const Slow start;
  const auto y = m->values_only(values, {t, u, 0, 1.0 / 512.0}, {0, {start.y, start.v, 0.0, start.foot, start.foot_v}});
  REQUIRE(usable(y.status));
  for (int n = 1; n <= turns; ++n) r.push_back(y.y[static_cast<std::size_t>(64 * n)]);
  return r;
}

void agrees(Slow slow, const std::vector<double>& height, double tolerance) {
  constexpr double h = 5e-6;
  std::size_t turn = 0;
  const auto steps = static_cast<std::int64_t>(std::llround(static_cast<double>(height.size()) / h));
  for (std::int64_t n = 0; n < steps; ++n) {
    slow.step(static_cast<double>(n) * h, h);
    if ((n + 1) % 200000 != 0) continue;
    INFO("turn " << turn + 1);
    CHECK(std::abs(slow.y - height[turn]) < tolerance);
    ++turn;
  }
}

}  // namespace

TEST_CASE("hopper on ground: an elastic foot hops until it stays, however short the hops are") {
  for (const double e : {0.02, 0.05, 0.15, 0.3}) {
    INFO("restitution " << e);
    Slow slow;
    slow.restitution = e;
    agrees(slow, heights("restitution", e, 3), 2e-4);
  }
  // What it does is much larger than that tolerance.
  CHECK(std::abs(heights("restitution", 0.3, 3)[2] - heights("restitution", 0.0, 3)[2]) > 5e-3);
}

TEST_CASE("hopper on ground: a foot sinks into compliant ground and is released by it") {
  for (const double c : {1e-4, 1e-3}) {
    INFO("compliance " << c);
    Slow slow;
    slow.compliance = c;
    agrees(slow, heights("compliant_ground", c, 3), 2e-4);
  }
  CHECK(std::abs(heights("compliant_ground", 1e-3, 3)[2] - heights("compliant_ground", 0.0, 3)[2]) > 1e-3);
}
