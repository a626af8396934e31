// Records that no clock paces: made ones with a known truth, and the real machines.
#include <algorithm>
#include <cmath>

#include "core/random.hpp"
#include "sim/diagnosis/diagnosis.hpp"
#include "sim/diagnosis/json.hpp"
#include "sim/diagnosis/stretches.hpp"
#include "sim/diagnosis/synthetic.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/records.hpp"
#include "tests/support/walks.hpp"

using namespace saltus;
using namespace saltus::diagnosis;
using namespace saltus::test;

namespace {

Record measured(const char* file) { return read_record(std::filesystem::path(SALTUS_TEST_DATA "/measured") / file); }

// The rows of some experiments.
Record part(const Record& r, int first, int last) {
  Record p = r;
  std::size_t n = 0;
  for (std::size_t i = 0; i < r.rows(); ++i) {
    if (r.experiment[i] < first || r.experiment[i] > last) continue;
    p.experiment[n] = r.experiment[i];
    p.t[n] = r.t[i];
    if (!r.cycle.empty()) p.cycle[n] = r.cycle[i];
    if (!r.chart.empty()) p.chart[n] = r.chart[i];
    for (std::size_t c = 0; c < r.inputs.size(); ++c) p.inputs[c].values[n] = r.inputs[c].values[i];
    for (std::size_t c = 0; c < r.outputs.size(); ++c) p.outputs[c].values[n] = r.outputs[c].values[i];
    ++n;
  }
  p.experiment.resize(n);
  p.t.resize(n);
  if (!r.cycle.empty()) p.cycle.resize(n);
  if (!r.chart.empty()) p.chart.resize(n);
  for (auto& c : p.inputs) c.values.resize(n);
  for (auto& c : p.outputs) c.values.resize(n);
  return p;
}

// A leg on a bench, driven by two tones, with what it has beside its model; time stamps jitter.
Record bench(const Values& truth, double seconds, std::uint64_t seed) {
  Random random(seed);
  std::vector<double> t, u;
  double now = 0.0;
  while (now < seconds) {
    t.push_back(now);
    u.push_back(3.0 * std::sin(5.0 * now) + 2.5 * std::sin(8.1 * now + 1.0));
    now += 0.005 * (1.0 + 0.05 * (2.0 * random.uniform() - 1.0));
  }
  Record r;
  r.name = "bench";
  r.model = "leg_bench";
  r.inputs = {{"u", "V", u}};
  r.outputs = {{"angle", "rad", {}}};
  r.t = t;
  r.experiment.assign(t.size(), 0);
  for (const double v : outputs_of("leg_bench", truth, t, u, 0.0025, diagnosis::Start{0, {0.6, 0.0}}))
    r.outputs[0].values.push_back(v + 1e-3 * random.normal());
  return r;
}

const Finding* found(const Diagnosis& d, const std::string& name) {
  const auto it = std::find_if(d.effects.begin(), d.effects.end(), [&](const Finding& f) { return f.name == name; });
  return it == d.effects.end() ? nullptr : &*it;
}
double degrees(double rad) { return rad * 57.295779513082323; }
const FreeRun& longest(const Diagnosis& d, const std::string& data) {
  const FreeRun* best = nullptr;
  for (const FreeRun& f : d.self_paced.runs) {
    if (f.data == data && (best == nullptr || f.horizon > best->horizon)) best = &f;
  }
  REQUIRE(best != nullptr);
  return *best;
}

}  // namespace

TEST_CASE("a walk is cut at its impacts, and what rings around them is left out", "[self-paced]") {
  const auto m = make_machine("compass_gait_robot");
  const Record r = measured("compass-gait-walking.csv");
  const Stretches s = cut_into_stretches(r, *m, {});
  CHECK(s.ringing == 980);  // seven rows on either side of seventy steps
  for (std::size_t k = 0; k < s.origin.size(); ++k) {
    const Segment& g = s.data.segments[k];
    const std::size_t rows = g.t.size() - g.first;
    for (std::size_t i = s.origin[k].row - 7; i < s.origin[k].row + rows + 7; ++i) {
      REQUIRE(r.cycle[i] == s.origin[k].cycle);
      REQUIRE(r.experiment[i] == s.origin[k].experiment);
    }
    CHECK(g.guess.chart == (r.chart_names[static_cast<std::size_t>(r.chart[s.origin[k].row])] == "outer" ? 0 : 1));
  }
}

TEST_CASE("a bench without friction, its time stamps jittering: nothing is invented", "[self-paced]") {
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const Diagnosis d = judged(bench({}, 24.0, seed));
    CAPTURE(seed, name(d.verdict));
    CHECK((d.verdict == Verdict::no_discrepancy || d.verdict == Verdict::parameters_only));
    CHECK(d.effects.empty());
    CHECK(d.heldout.after < 1.3);
  }
}

TEST_CASE("a bench with both frictions: both are found, sized, and predict", "[self-paced]") {
  const Diagnosis d = judged(bench({{"viscous_damper@hip", 0.0015}, {"coulomb_friction@hip", 0.006}}, 24.0, 4));
  CHECK(d.verdict == Verdict::effect_found);
  REQUIRE(d.effects.size() == 2);
  const Finding* viscous = found(d, "viscous_damper@hip");
  const Finding* coulomb = found(d, "coulomb_friction@hip");
  REQUIRE(viscous != nullptr);
  REQUIRE(coulomb != nullptr);
  CHECK(std::abs(viscous->value - 0.0015) < 3e-4);
  CHECK(std::abs(coulomb->value - 0.006) < 6e-4);
  CHECK(d.heldout.after < 1.5);
  CHECK(d.heldout.refit > 5.0);
}

TEST_CASE("a bench whose motor gives a constant torque besides: found, with its exact twin named", "[self-paced]") {
  const Diagnosis d = judged(bench({{"constant_force@hip", 0.01}}, 24.0, 5));
  CHECK(d.verdict == Verdict::effect_found);
  REQUIRE(d.effects.size() == 1);
  CHECK((d.effects[0].name == "constant_force@hip" || d.effects[0].name == "input_bias"));
  REQUIRE(d.effects[0].ties.size() == 1);
  CHECK((d.effects[0].ties[0] == "constant_force@hip" || d.effects[0].ties[0] == "input_bias"));
  REQUIRE(!d.rivals.empty());
  CHECK(std::abs(d.rivals[0].predicted - 1.0) < 1e-3);
}

TEST_CASE("a bench that is only heavier than declared: its parameters, and no cause", "[self-paced]") {
  const Diagnosis d = judged(bench({{"com", 0.0448 * 1.06}}, 24.0, 6));
  CHECK(d.verdict == Verdict::parameters_only);
  CHECK(d.effects.empty());
  CHECK(d.heldout.after < 1.3);
}

TEST_CASE("the leg bench: fitted on the first half, the chirp is predicted with friction and not without",
          "[self-paced][measured]") {
  Options o;
  o.holdout_share = 0.5;
  const Diagnosis d = judged(measured("leg-bench.csv"), o);
  CHECK(d.verdict == Verdict::effect_found);
  REQUIRE(found(d, "viscous_damper@hip") != nullptr);
  REQUIRE(found(d, "coulomb_friction@hip") != nullptr);
  CHECK(found(d, "quadratic_drag@hip") == nullptr);
  CHECK(d.effects.size() == 2);
  const FreeRun& f = longest(d, "held out");
  CHECK(f.horizon > 30.0);
  CHECK(degrees(f.refit[0]) > 30.0);
  CHECK(degrees(f.after[0]) < 1.6);
  for (const ParameterRow& p : d.parameters) {
    if (p.name == "motor_constant") CHECK(std::abs(p.with_effect / 0.0182 - 1.0) < 0.05);
  }
  const auto j = to_json(d);
  CHECK(j["self_paced"]["free_runs"].size() >= 2);
}

TEST_CASE("walking: friction at the hip predicts experiments not fitted, and the stance stays unexplained",
          "[self-paced][measured]") {
  Options o;  // all of the candidates take half a minute
  o.candidates = {"coulomb_friction@hip", "viscous_damper@hip"};
  const Diagnosis d = judged(measured("compass-gait-walking.csv"), o);
  CHECK(d.verdict == Verdict::effect_found);
  CHECK((found(d, "coulomb_friction@hip") != nullptr || found(d, "viscous_damper@hip") != nullptr));
  const FreeRun& f = d.self_paced.runs.front();
  CHECK(f.data == "held out");
  CHECK(std::abs(f.horizon - 0.2) < 1e-9);
  CHECK(degrees(f.end_before[0]) > 1.0);
  CHECK(degrees(f.end_after[0]) < 0.5);
  CHECK(f.after[1] > 0.6 * f.refit[1]);
  bool said = false;
  for (const std::string& line : d.story) said = said || line.find("stance hardly improves") != std::string::npos;
  CHECK(said);
}

TEST_CASE("three experiments of the walk: of two frictions as likely it is the one that runs free better",
          "[self-paced][measured]") {
  Options o;
  o.candidates = {"coulomb_friction@hip", "viscous_damper@hip"};
  const Diagnosis d = judged(part(measured("compass-gait-walking.csv"), 5, 7), o);
  CHECK(d.verdict == Verdict::effect_found);  // the viscous one makes free runs worse than none
  REQUIRE(d.effects.size() == 1);
  CHECK(d.effects[0].name == "coulomb_friction@hip");
  const FreeRun& f = d.self_paced.runs.front();
  CHECK(f.data == "held out");
  CHECK(f.after[0] < 0.9 * f.refit[0]);
  bool said = false;
  for (const diagnosis::Step& t : d.self_paced.steps)
    said = said || (t.taken && t.instead == "viscous_damper@hip" && t.free_run < 0.9);
  CHECK(said);
}

TEST_CASE("a walk whose hip was recorded with the other sign: no cause is claimed beside parameters far off",
          "[self-paced][measured]") {
  Record r = part(measured("compass-gait-walking.csv"), 0, 2);
  const auto hip = std::find_if(r.outputs.begin(), r.outputs.end(), [](const auto& c) { return c.name == "hip"; });
  REQUIRE(hip != r.outputs.end());
  for (double& v : hip->values) v = -v;
  const Diagnosis d = judged(r);
  CHECK(d.verdict == Verdict::unexplained);
  CHECK(d.effects.empty());
  CHECK(std::any_of(d.notes.begin(), d.notes.end(),
                    [](const std::string& n) { return n.find("of other sign") != std::string::npos; }));
}

TEST_CASE("a walk measured by an encoder that is not linear: what is left is small, and still no noise",
          "[self-paced]") {
  Walks w;
  w.experiments = 8;
  w.sigma = 1e-3;
  for (const double curved : {0.0, 0.08}) {  // [1/rad]
    CAPTURE(curved);
    Record r = walks_of(CompassGait<>{}, w);
    for (double& v : r.outputs[0].values) v += curved * v * v;
    const Diagnosis d = judged(r);
    CHECK(d.heldout.refit < 1.5);
    CHECK(d.verdict == (curved > 0.0 ? Verdict::unexplained : Verdict::no_discrepancy));
  }
}

TEST_CASE("friction of the bench, declared on the walker: nothing of the kind is missing any more",
          "[self-paced][measured]") {
  Options o;
  o.holdout = 1;
  o.candidates = {"coulomb_friction@hip", "viscous_damper@hip"};
  o.set = {{"viscous_damper@hip", 0.00116}, {"coulomb_friction@hip", 0.0064}};
  const Diagnosis d = judged(part(measured("compass-gait-walking.csv"), 6, 7), o);
  for (const Finding& f : d.effects) {
    CAPTURE(f.name);
    CHECK(f.name.find("friction") == std::string::npos);
    CHECK(f.name.find("viscous") == std::string::npos);
  }
  CHECK(degrees(d.self_paced.runs.front().end_before[0]) < 1.0);  // against 1.3 to 1.6 without
}

TEST_CASE(
    "the pendulum: frictions and the motor's gain predict swings that were not fitted, and who touched it is no cause",
    "[self-paced][measured]") {
  for (const double holdout : {-1.0, 0.2}) {
    Options o;
    o.holdout_share = holdout;
    const Diagnosis d = judged(measured("pendulum-swing-up.csv"), o);
    CAPTURE(holdout);
    CHECK(d.verdict == Verdict::effect_found);
    const Finding* coulomb = found(d, "coulomb_friction@joint");
    const Finding* viscous = found(d, "viscous_drag@joint");
    REQUIRE(coulomb != nullptr);
    REQUIRE(viscous != nullptr);
    CHECK(d.effects.size() == 2);
    CHECK(std::abs(coulomb->value - 0.115) < 0.03);
    CHECK(std::abs(viscous->value - 0.0116) < 0.003);
    for (const ParameterRow& p : d.parameters) {  // inertia and weight stay what they were declared
      if (p.tolerance > 0.0) CHECK(std::abs(p.with_effect - p.declared) < 2.5 * p.tolerance);
    }
    bool swung_up = false;
    for (const FreeRun& f : d.self_paced.runs) {
      if (f.data != "fitted") continue;
      CHECK(f.unstable > 0);  // those through the upright
      REQUIRE(!f.begin.empty());
      CHECK(f.begin[0] < 0.1);
      const std::size_t ny = f.after.size();
      CHECK(degrees(f.each[0][0]) > 100.0);
      CHECK(degrees(f.each[2 * ny][0]) < 1.5);
      swung_up = true;
    }
    CHECK(swung_up);
    CHECK(d.heldout.after < 0.8 * d.heldout.refit);
    bool touched = false;
    for (const std::string& note : d.notes) touched = touched || note.find("touched") != std::string::npos;
    CHECK(touched);
  }
}
