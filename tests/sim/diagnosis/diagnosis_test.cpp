#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/diagnosis/diagnosis.hpp"
#include "sim/diagnosis/json.hpp"
#include "sim/diagnosis/synthetic.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/records.hpp"

using namespace saltus;
using namespace saltus::diagnosis;
using namespace saltus::test;

namespace {

// A short campaign on the emulated hopper: enough for effects some ten times their detection limits.
Campaign short_campaign() {
  Campaign c;
  c.experiments = 3;
  c.period = 16;
  c.settle = 20;
  c.tones = 6;
  c.noise = {1e-3, 6e-3};
  return c;
}
// As many cycles as effects need that change the motion a great deal.
Campaign longer_campaign() {
  Campaign c;
  c.experiments = 4;
  c.period = 32;
  c.settle = 24;
  c.noise = {1e-3, 6e-3};
  return c;
}

Record made(const Values& truth, std::uint64_t seed, const Campaign& c = short_campaign()) {
  return emulated("hopper", truth, seed, c);
}

}  // namespace

TEST_CASE("nothing wrong: no discrepancy, with detection limits", "[diagnose]") {
  const Diagnosis d = judged(made({}, 11));
  CHECK(d.verdict == Verdict::no_discrepancy);
  CHECK(d.effects.empty());
  CHECK(std::abs(d.heldout.after - 1.0) < 0.05);
  int limits = 0;
  for (const CandidateRow& c : d.candidates) limits += c.limit > 0.0;
  CHECK(limits > 10);
}

TEST_CASE("wrong parameters only: corrected, and no effect invented", "[diagnose]") {
  const Diagnosis d = judged(made({{"k", 10.25}, {"b", 4.9}}, 12));
  CHECK(d.verdict == Verdict::parameters_only);
  CHECK(d.effects.empty());
  for (const ParameterRow& p : d.parameters) {
    if (p.name == "k") CHECK(std::abs(p.refitted - 10.25) < 4.0 * p.refitted_error);
    if (p.name == "b") CHECK(std::abs(p.refitted - 4.9) < 4.0 * p.refitted_error);
  }
}

TEST_CASE("one effect: its name, its size, and an error that falls to the noise on held-out data", "[diagnose]") {
  const Diagnosis d = judged(made({{"quadratic_drag@body", 0.1}}, 13));
  CHECK(d.verdict == Verdict::effect_found);
  REQUIRE(d.effects.size() == 1);
  CHECK(d.effects[0].name == "quadratic_drag@body");
  CHECK(std::abs(d.effects[0].value - 0.1) < 0.015);
  CHECK(d.heldout.after < 1.1);
  CHECK(d.heldout.before > 1.5);
  const auto j = to_json(d);
  CHECK(j["verdict"] == "effect_found");
  CHECK(j["effects"][0]["ci95"].size() == 2);
  CHECK(j["error"]["rms"]["y_M"]["unit"] == "m");
}

TEST_CASE("a large delay of the sensors, which the parameters imitate when they are refitted first, is one effect",
          "[diagnose]") {
  Campaign c;
  c.experiments = 3;
  c.period = 32;
  c.settle = 24;
  c.noise = {1e-3, 6e-3};
  const Diagnosis d = judged(made({{"sensor_delay", 0.0077}}, 1001, c));
  CAPTURE(name(d.verdict));
  CHECK((d.verdict == Verdict::effect_found || d.verdict == Verdict::ambiguous));
  REQUIRE(d.effects.size() == 1);  // not an input's delay and a clock set off, which together are the same
  CHECK(d.effects[0].name == "sensor_delay");
  CHECK(std::abs(d.effects[0].value - 0.0077) < 5e-4);
  double refitted = 0.0;  // without it
  for (const ParameterRow& p : d.parameters) {
    if (p.tolerance > 0.0) refitted = std::max(refitted, std::abs(p.refitted - p.declared) / p.tolerance);
  }
  CHECK(refitted > 4.0);
  for (const ParameterRow& p : d.parameters) {
    if (p.tolerance > 0.0) CHECK(std::abs(p.with_effect - p.declared) < 4.0 * p.tolerance);
  }
}

TEST_CASE("a foot that bounces leads to other gaits: its restitution is found where the cost has many hollows",
          "[diagnose]") {
  Options o;
  o.candidates = {"restitution"};
  const auto seed = GENERATE(1002, 1003, 12009);  // an experiment or two of each end in a gait of their own
  CAPTURE(seed);
  const Diagnosis d = judged(made({{"restitution", 0.2374}}, static_cast<std::uint64_t>(seed), longer_campaign()), o);
  CHECK(d.verdict == Verdict::effect_found);
  REQUIRE(d.effects.size() == 1);
  CHECK(std::abs(d.effects[0].value - 0.2374) < 1e-3);
  CHECK(d.heldout.refit > 1.3);
  CHECK(d.heldout.after < 1.05);
}

TEST_CASE("a gait that does not repeat: the first repeat of each stimulus tells what their mean cannot", "[diagnose]") {
  Options o;
  o.candidates = {"restitution"};
  const Diagnosis d = judged(made({{"restitution", 0.25}}, 3, longer_campaign()), o);
  CHECK(d.repeats == 1);  // so their mean was not explained
  CHECK_FALSE(d.noise_measured);
  REQUIRE(d.noise.size() == 2);
  CHECK(d.noise[0] == Approx(1e-3).epsilon(0.1));
  CHECK(d.noise[1] == Approx(6e-3).epsilon(0.1));
  CHECK(d.verdict == Verdict::effect_found);
  REQUIRE(d.effects.size() == 1);
  CHECK(std::abs(d.effects[0].value - 0.25) < 2e-3);
  CHECK(d.heldout.refit > 3.0);
  CHECK(d.heldout.after < 1.05);
}

TEST_CASE("what only the mean cycle shows could be any force that repeats with it", "[diagnose]") {
  Campaign c = longer_campaign();
  const Diagnosis moved = judged(made({{"quadratic_drag@body", 0.03}}, 4, c));
  CHECK(moved.verdict == Verdict::effect_found);
  REQUIRE(moved.effects.size() == 1);
  CHECK(moved.effects[0].ties.empty());
  c.amplitude = 1e-3;  // a response that drowns in the noise
  const Diagnosis unmoved = judged(made({{"quadratic_drag@body", 0.03}}, 4, c));
  CHECK(unmoved.verdict == Verdict::ambiguous);
  REQUIRE(unmoved.effects.size() == 1);
  CHECK(unmoved.effects[0].ties.back() == "periodic_force");
  CHECK(unmoved.separate.find("times the amplitude") != std::string::npos);
}

TEST_CASE("a force that repeats with the cycle is found with its phase, or tied with what is nearly one",
          "[diagnose]") {
  const double size = 0.6, phase = 0.1, angle = 2.0 * std::numbers::pi * phase;
  Options o;
  o.candidates = {"clock_offset", "viscous_drag", "quadratic_drag", "input_delay", "periodic_force"};
  int alone = 0, held = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    CAPTURE(seed);
    const Diagnosis d = judged(
        made({{"periodic_force@body", size * std::cos(angle)}, {"periodic_force@body/2", size * std::sin(angle)}}, seed,
             longer_campaign()),
        o);
    REQUIRE(d.effects.size() == 1);
    const Finding& f = d.effects[0];
    if (f.name != "periodic_force@body") {  // another phase of the clock moves the cycle much the same
      CHECK(f.name == "clock_offset");
      CHECK(std::count(f.ties.begin(), f.ties.end(), "periodic_force@body") == 1);
      continue;
    }
    ++alone;
    held += f.low < size && size < f.high;
    const bool tied = std::count(f.ties.begin(), f.ties.end(), "clock_offset") == 1;
    CHECK(d.verdict == (tied ? Verdict::ambiguous : Verdict::effect_found));
    CHECK(f.unit == "N");
    CHECK(std::abs(f.phase - phase) < 0.03);
    CHECK(d.heldout.after < 1.02);
  }
  CHECK(alone >= 3);
  CHECK(held >= alone - 1);
}

TEST_CASE("a bump of force that repeats with the cycle is no cosine", "[diagnose]") {
  const Diagnosis d = judged(made({{"force_profile@body/5", 0.6}}, 1, longer_campaign()));
  CHECK(d.verdict == Verdict::unexplained);
  CHECK(d.effects.empty());
}

TEST_CASE("a bump of force on the foot shows from the limit that is said, and is no friction beside a g far off",
          "[diagnose]") {
  Campaign c = longer_campaign();
  c.stimuli = 7;
  const Diagnosis none = judged(made({}, 1, c));
  REQUIRE(none.verdict == Verdict::no_discrepancy);
  const std::string knot = "force_profile@foot/5";
  double limit = 0.0;
  for (const Profile& p : none.profiles) {
    for (std::size_t i = 0; i < p.knots.size(); ++i) {
      if (p.knots[i] == knot) limit = p.limit[i];
    }
  }
  REQUIRE(limit > 0.0);
  const Diagnosis below = judged(made({{knot, 0.2 * limit}}, 5007, c)),
                  above = judged(made({{knot, 3.0 * limit}}, 5007, c));
  CHECK(below.effects.empty());
  CHECK(below.verdict != Verdict::unexplained);
  CHECK((above.verdict == Verdict::unexplained || above.verdict == Verdict::ambiguous));
  for (const Finding& f : above.effects) {
    CAPTURE(f.name);
    CHECK(std::any_of(f.ties.begin(), f.ties.end(), [](const auto& t) { return t.starts_with("periodic_force"); }));
  }
}

TEST_CASE("noise as slow as the motion is no correction of a parameter", "[diagnose]") {
  Campaign c = short_campaign();
  c.colour = 0.9;
  int corrected = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    const Diagnosis d = judged(made({}, seed, c));
    CHECK(d.effects.empty());
    corrected += d.verdict != Verdict::no_discrepancy;
  }
  CHECK(corrected <= 1);
}

TEST_CASE("a random force that no record holds is no lack of the model, and hides no large one", "[diagnose]") {
  Campaign c = short_campaign();
  int claimed = 0;
  for (const double force : {0.05, 0.3}) {  // [N]
    c.process = force;
    for (std::uint64_t seed = 1; seed <= 8; ++seed) {
      const Diagnosis d = judged(made({}, seed, c));
      CAPTURE(force, seed, name(d.verdict));
      claimed += d.verdict != Verdict::no_discrepancy;
    }
  }
  CHECK(claimed <= 1);

  c.process = 0.05;
  const Diagnosis d = judged(made({{"quadratic_drag@body", 0.2}}, 9, c));
  REQUIRE(d.effects.size() == 1);
  CHECK(d.effects[0].name == "quadratic_drag@body");
  CHECK(d.effects[0].low < 0.2);
  CHECK(d.effects[0].high > 0.2);
}

TEST_CASE("what a bouncing foot would be seen by is no straight line, and as much as the fits say", "[diagnose]") {
  Options o;
  o.candidates = {"restitution"};
  Campaign c = longer_campaign();
  c.stimuli = 5;
  const Diagnosis none = judged(made({}, 1, c), o);
  REQUIRE(none.verdict == Verdict::no_discrepancy);
  REQUIRE(none.candidates.size() == 1);
  const auto& curve = none.candidates[0].clarity;
  REQUIRE(curve.size() > 3);
  for (std::size_t i = 1; i < curve.size(); ++i) CHECK(curve[i].size > curve[i - 1].size);
  const double limit_z = none.threshold + power_95, limit = none.candidates[0].limit;
  CHECK(limit == size_seen(curve, limit_z));
  CHECK(size_seen(curve, 3.0 * limit_z) < 2.0 * limit);  // of a straight line 3
  CHECK(size_seen(curve, 1e9) != size_seen(curve, 1e9));

  // Measured, and refitted: the squares that it takes away are those of its standard errors, but for what parameters
  // imitate that move as far as they must and not along their slopes.
  const double size = size_seen(curve, 3.0 * limit_z);
  const Diagnosis d = judged(made({{"restitution", size}}, 2, c), o);
  REQUIRE(d.effects.size() == 1);
  CHECK(d.effects[0].low < size);
  CHECK(d.effects[0].high > size);
  CHECK(std::sqrt(d.chi2_refit - d.chi2_after) == Approx(3.0 * limit_z).epsilon(0.3));
  CHECK(judged(made({{"restitution", 0.4 * limit}}, 3, c), o).effects.empty());
}

TEST_CASE("a ground a hundred times softer than what is looked for first, which mass and drag imitate", "[diagnose]") {
  Options o;
  o.candidates = {"compliant_ground", "viscous_drag@body"};
  const Diagnosis d = judged(made({{"compliant_ground", 0.03}}, 16), o);
  CHECK(d.verdict == Verdict::effect_found);
  REQUIRE(d.effects.size() == 1);
  CHECK(d.effects[0].name == "compliant_ground");
  CHECK(std::abs(d.effects[0].value - 0.03) < 1e-3);
}

// The curvature at a hollow of its own said 0.0003 to 0.0005 m/N.
TEST_CASE("a soft ground whose cost is no parabola: the interval holds the truth", "[diagnose]") {
  const double truth = 0.0011153;
  const Diagnosis d = judged(made({{"compliant_ground", truth}}, 1006, longer_campaign()));
  CHECK(d.verdict == Verdict::effect_found);
  REQUIRE(d.effects.size() == 1);
  const Finding& f = d.effects[0];
  CHECK(f.name == "compliant_ground");
  CAPTURE(f.value, f.low, f.high);
  CHECK(f.low < truth);
  CHECK(f.high > truth);
  CHECK(f.high - f.low > 5e-4);
}

TEST_CASE("two effects that carry the parameters far off when they are refitted first: both, and no third",
          "[diagnose]") {
  const Diagnosis d =
      judged(made({{"cubic_stiffness@leg", 0.54}, {"sensor_gain@v_M", 0.00133}}, 6002, longer_campaign()));
  REQUIRE(d.effects.size() == 2);
  for (const Finding& f : d.effects) {
    CAPTURE(f.name, f.value, f.low, f.high);
    if (f.name == "cubic_stiffness@leg") {
      CHECK(f.low < 0.54);
      CHECK(f.high > 0.54);
    } else {  // of the two gains only their ratio is told
      CHECK((f.name == "sensor_gain@v_M" || f.name == "sensor_gain@y_M"));
      CHECK(f.ties.size() == 1);
      CHECK(std::abs(std::abs(f.value) - 0.00133) < 2e-4);
    }
  }
  CHECK(d.heldout.refit > 1.03);
  CHECK(d.heldout.after < 1.02);
}

TEST_CASE("sensors that lag by a whole section are not taken for a clock that is shifted", "[diagnose]") {
  Options o;
  o.candidates = {"sensor_lag", "input_lag"};
  const Diagnosis d = judged(made({{"sensor_lag", 0.03}}, 17, longer_campaign()), o);
  REQUIRE(d.effects.size() == 1);
  CHECK(d.effects[0].name == "sensor_lag");
  CHECK(std::abs(d.effects[0].value - 0.03) < 1.5e-3);
}

TEST_CASE("a little more than noise beside a large effect is said, and does not unsay it", "[diagnose]") {
  Options o;
  o.candidates = {"viscous_damper@leg", "quadratic_drag@body", "cubic_stiffness@leg"};
  const Diagnosis d = judged(made({{"viscous_damper@leg", 1.0}, {"force_profile@leg/5", 0.3}}, 18), o);
  CHECK(d.verdict == Verdict::effect_found);
  REQUIRE(d.effects.size() == 1);
  CHECK(d.effects[0].name == "viscous_damper@leg");
  CHECK(std::abs(d.effects[0].value - 1.0) < 0.05);
  bool said = false;
  for (const std::string& note : d.notes) said = said || note.find("What is left is more than noise") == 0;
  CHECK(said);
}

TEST_CASE("a friction that holds its port still for good ends a run with a status, not the day", "[diagnose]") {
  const auto m = make_machine("hopper");
  std::vector<double> values;
  REQUIRE(values_with(*m, {{"coulomb_friction@foot", 20.0}}, values));
  std::vector<double> t, u(320, 0.0);
  for (int i = 0; i < 320; ++i) t.push_back(i / 32.0);
  const Response r = m->values_only(values, Course{t, u, 0, 1.0 / 64.0}, Start{0, {2.0, 0.0, 0.0, 0.3, 0.0}});
  CHECK(r.status == Status::failed);
}

TEST_CASE("an effect of no library: unexplained, not the nearest name", "[diagnose]") {
  const Diagnosis d = judged(made({{"force_profile@leg/5", 1.5}, {"force_profile@leg/12", -1.0}}, 14));
  CHECK(d.verdict == Verdict::unexplained);
  CHECK(d.effects.empty());
  CHECK(d.where.known);
}

TEST_CASE("a sensor's bias is said to be unidentifiable while the rest length is free", "[diagnose]") {
  const Diagnosis d = judged(made({{"sensor_bias@y_M", 0.02}}, 15));
  CHECK(d.effects.empty());
  CHECK(d.verdict == Verdict::parameters_only);
  bool said = false;
  for (const CandidateRow& c : d.candidates) {
    if (c.name == "sensor_bias@y_M") said = c.remark.find("unidentifiable while l0 is free") != std::string::npos;
  }
  CHECK(said);
}

TEST_CASE("records that are not of this machine are refused with the reason", "[diagnose]") {
  const Record good = made({}, 16);
  Record r = good;
  for (double& v : r.outputs[0].values) v *= 1000.0;
  refused(r, "another unit");
  r = good;
  std::swap(r.outputs[0].values, r.outputs[1].values);
  refused(r, "swap the two columns");
  r = good;
  for (double& u : r.inputs[0].values) u = -u;
  refused(r, "reverse the sign of the column");
  r = good;
  for (double& u : r.inputs[0].values) u *= 1000.0;
  refused(r, "multiply the column by 0.001 to have it in N");
  r = good;
  r.outputs[1].name = "v";
  refused(r, "no output 'v_M'");
  r = good;
  r.outputs[0].unit = "mm";
  refused(r, "is in mm");
  r = good;
  for (double& t : r.t) t += 0.3;
  refused(r, "t must be 0");
  r = good;
  r.settle_cycles = 83;
  refused(r, "whole cycles after settling");
  r = good;
  r.sections_per_cycle.reset();
  refused(r, "paced by a clock");
  // Measured values six sections late.
  r = good;
  for (auto& o : r.outputs) std::rotate(o.values.begin(), o.values.begin() + 6, o.values.end());
  refused(r, "clock is shifted");
}

TEST_CASE("drops, outliers and coarse sensors do not change the verdict, and are counted", "[diagnose]") {
  Campaign c = short_campaign();
  c.drop = 0.005;
  c.outliers = 0.001;
  c.quantum = {1e-3, 5e-3};
  const Diagnosis d = judged(made({{"quadratic_drag@body", 0.1}}, 17, c));
  REQUIRE(d.effects.size() == 1);
  CHECK(d.effects[0].name == "quadratic_drag@body");
  CHECK(d.quality.missing > 0);
  CHECK(d.quality.outliers > 0);
}

TEST_CASE("steps far coarser than the noise: nothing is invented, and an effect keeps its name and size",
          "[diagnose]") {
  Campaign c = short_campaign();
  c.quantum = {1e-2, 6e-2};  // ten times the noise: repeats agree where they are wrong
  const Diagnosis none = judged(made({}, 18, c));
  CHECK(none.verdict == Verdict::no_discrepancy);
  CHECK(std::abs(none.all.before - 1.0) < 0.1);
  const Diagnosis d = judged(made({{"viscous_damper@leg", 0.3}}, 19, c));
  CHECK(d.verdict == Verdict::effect_found);
  REQUIRE(d.effects.size() == 1);
  CHECK(d.effects[0].name == "viscous_damper@leg");
  CHECK(std::abs(d.effects[0].value - 0.3) < d.effects[0].high - d.effects[0].low);  // four standard errors
  CHECK(d.effects[0].high - d.effects[0].low < 0.15);
}

TEST_CASE("an output that was not recorded is not compared, and the others still tell the effect", "[diagnose]") {
  Record r = made({{"quadratic_drag@body", 0.05}}, 31);
  r.outputs.pop_back();
  const Diagnosis d = judged(r);
  REQUIRE(d.effects.size() == 1);
  CHECK(d.effects[0].name == "quadratic_drag@body");
  CHECK(d.effects[0].low < 0.05);
  CHECK(0.05 < d.effects[0].high);
  REQUIRE(d.output_names == std::vector<std::string>{"y_M"});
  CHECK(d.notes.back().find("no v_M") != std::string::npos);
}
