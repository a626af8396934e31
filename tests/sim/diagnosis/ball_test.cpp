// The bouncing ball: its impacts are passed at once, so that what shifts them bends every way to the truth.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "tests/support/records.hpp"

using namespace saltus;
using namespace saltus::diagnosis;
using namespace saltus::test;

namespace {

Campaign bounces() {
  Campaign c;
  c.experiments = 4;
  c.period = 32;
  c.amplitude = 1.5e-3;
  c.noise = {1e-4, 1e-3};
  return c;
}

Record bounced(const Values& truth, std::uint64_t seed, const Campaign& c = bounces()) {
  return emulated("bouncing_ball", truth, seed, c);
}

// This one alone, and as large as it is.
void found(const Diagnosis& d, const std::string& effect, double size) {
  CAPTURE(effect, size, name(d.verdict));
  CHECK(d.verdict == Verdict::effect_found);
  REQUIRE(d.effects.size() == 1);
  CHECK(d.effects[0].name == effect);
  const double error = (d.effects[0].high - d.effects[0].low) / 4.0;
  CAPTURE(d.effects[0].value, error);
  CHECK(std::abs(d.effects[0].value - size) < 4.0 * error);
}

// The ball under a held input that a first-order lag smooths, in closed form between impacts; row by row (y, v).
std::vector<double> exactly(const std::vector<double>& t, const std::vector<double>& u, double lag, double y,
                            double v) {
  constexpr double m = 0.5, g = 9.81, A = 0.112, e = 0.8, omega = 2.0 * std::numbers::pi;
  std::vector<double> rows{y, v};
  double acts = u[0];  // [N]
  for (std::size_t i = 0; i + 1 < t.size(); ++i) {
    double now = t[i];
    const auto go = [&](double d, double& y1, double& v1, double& acts1) {  // by d seconds
      const double off = acts - u[i], gone = lag * -std::expm1(-d / lag), a = u[i] / m - g;
      y1 = y + v * d + 0.5 * a * d * d + off * lag / m * (d - gone);
      v1 = v + a * d + off / m * gone;
      acts1 = u[i] + off * std::exp(-d / lag);
    };
    const auto above = [&](double d) {
      double y1, v1, acts1;
      go(d, y1, v1, acts1);
      return y1 - A * std::sin(omega * (now + d));
    };
    if (above(t[i + 1] - now) < 0.0) {
      double low = 0.0, high = t[i + 1] - now;
      for (int k = 0; k < 60; ++k) (above(0.5 * (low + high)) < 0.0 ? high : low) = 0.5 * (low + high);
      go(high, y, v, acts);
      now += high;
      const double table = A * omega * std::cos(omega * now);
      v = table + e * (table - v);
    }
    go(t[i + 1] - now, y, v, acts);
    rows.insert(rows.end(), {y, v});
  }
  return rows;
}

}  // namespace

TEST_CASE("an impact under an input that lags is where the closed form has it") {
  constexpr double y = 0.5472647592, v = -3.8356020482, size = 0.01;  // [m] [m/s] [N]
  std::vector<double> t, u;
  for (int i = 0; i < 4 * 32; ++i) {
    t.push_back(i / 32.0);
    u.push_back(i % 3 == 0 ? size : i % 5 == 0 ? -size : 0.0);
  }
  const double most = size / 0.5 / 32.0;  // [m/s] what the input makes of a velocity from one sample to the next
  for (const double lag : {0.005, 0.018, 0.0205, 0.2}) {
    const auto expected = exactly(t, u, lag, y, v);
    const auto got = outputs_of("bouncing_ball", {{"input_lag", lag}}, t, u, 1.0 / 32, {0, {y, v, 0.0}});
    REQUIRE(got.size() == expected.size());
    double off = 0.0;
    for (std::size_t i = 0; i < got.size(); ++i) off = std::max(off, std::abs(got[i] - expected[i]));
    CAPTURE(lag, off / most);
    CHECK(off < 0.005 * most);
  }
}

TEST_CASE("a clock set off, along whose valley the declared parameters bend, is followed to its end", "[diagnose]") {
  for (const double offset : {-0.005, -0.003, 0.008})
    found(judged(bounced({{"clock_offset", offset}}, 31)), "clock_offset", offset);
}

TEST_CASE("a large lag of the input asks for finer steps than the declared model, and is one effect as large as it is",
          "[diagnose]") {
  Campaign c = bounces();
  c.experiments = 3;
  c.period = 16;
  c.amplitude = 3e-3;
  found(judged(bounced({{"input_lag", 0.2}}, 32, c)), "input_lag", 0.2);
}

TEST_CASE("an impact across a section from where it was declared is neither refused nor a lack", "[diagnose]") {
  for (const double e : {0.7865, 0.787, 0.7875}) {
    const Diagnosis d = judged(bounced({{"e", e}}, 33));
    CAPTURE(e, name(d.verdict));
    CHECK(d.verdict == Verdict::parameters_only);
    for (const ParameterRow& p : d.parameters) {
      if (p.name == "e") CHECK(std::abs(p.refitted - e) < 4.0 * p.refitted_error);
    }
  }
}

TEST_CASE("an effect that carries the impact across a section is found, not refused", "[diagnose]") {
  found(judged(bounced({{"quadratic_drag@body", 0.01}}, 34)), "quadratic_drag@body", 0.01);
  found(judged(bounced({{"clock_offset", 0.015}}, 35)), "clock_offset", 0.015);
}

TEST_CASE("an input of the other sign is refused, for no parameters within their tolerances mend it", "[diagnose]") {
  Record r = bounced({{"e", 0.795}}, 36);
  for (double& u : r.inputs[0].values) u = -u;
  refused(r, "reverse the sign");
}
