// The bouncing ball: its impacts are passed at once, so that what shifts them bends every way to the truth.
#include <cmath>
#include <string>

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

}  // namespace

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
