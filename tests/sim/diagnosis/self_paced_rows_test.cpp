// Records that no clock paces as they come: rows lost, too short, little moving; and laws that must make sense.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/random.hpp"
#include "sim/diagnosis/spikes.hpp"
#include "sim/diagnosis/stretches.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/records.hpp"

using namespace saltus;
using namespace saltus::diagnosis;
using namespace saltus::test;

namespace {

// A leg on a bench, driven by two tones, with what it has beside its model. Of its rows the share `lost` is missing.
Record leg(const Values& truth, double seconds, double lost, std::uint64_t seed) {
  Random random(seed);
  std::vector<double> t, u;
  for (int i = 0; i < static_cast<int>(std::lround(seconds / 0.005)); ++i) {
    const double now = 0.005 * i;
    t.push_back(now);
    u.push_back(3.0 * std::sin(5.0 * now) + 2.5 * std::sin(8.1 * now + 1.0));
  }
  const auto y = outputs_of("leg_bench", truth, t, u, 0.0025, Start{0, {0.6, 0.0}});
  Record r;
  r.name = "leg";
  r.model = "leg_bench";
  r.inputs = {{"u", "V", {}}};
  r.outputs = {{"angle", "rad", {}}};
  for (std::size_t i = 0; i < t.size(); ++i) {
    const double noise = 1e-3 * random.normal();
    if (random.uniform() < lost) continue;
    r.experiment.push_back(0);
    r.t.push_back(t[i]);
    r.inputs[0].values.push_back(u[i]);
    r.outputs[0].values.push_back(y[i] + noise);
  }
  return r;
}

double value_of(const Diagnosis& d, const std::string& name) {
  for (const Finding& f : d.effects) {
    if (f.name == name) return f.value;
  }
  return std::nan("");
}

}  // namespace

TEST_CASE("a tenth of the rows lost: the stretches stay whole and the frictions are the same", "[self-paced]") {
  const Record r = leg({{"viscous_damper@hip", 0.0015}, {"coulomb_friction@hip", 0.006}}, 24.0, 0.1, 7);
  const Stretches s = cut_into_stretches(r, *make_machine("leg_bench"), {});
  CHECK(s.origin.size() <= 13);
  CHECK(s.origin.back().end > 23.5);
  const Diagnosis d = judged(r);
  CHECK(d.verdict == Verdict::effect_found);
  CHECK(d.effects.size() == 2);
  CHECK(std::abs(value_of(d, "viscous_damper@hip") - 0.0015) < 3e-4);
  CHECK(std::abs(value_of(d, "coulomb_friction@hip") - 0.006) < 6e-4);
  CHECK_FALSE(d.self_paced.runs.empty());
}

TEST_CASE("four seconds are enough to say how well a model with what was found elsewhere predicts", "[self-paced]") {
  Options o;
  o.set = {{"viscous_damper@hip", 0.0015}, {"coulomb_friction@hip", 0.006}};
  const Diagnosis with = judged(leg(o.set, 4.2, 0.0, 8), o), without = judged(leg(o.set, 4.2, 0.0, 8));
  CHECK(with.effects.empty());
  CHECK((with.verdict == Verdict::no_discrepancy || with.verdict == Verdict::parameters_only));
  REQUIRE_FALSE(with.self_paced.runs.empty());
  REQUIRE_FALSE(without.self_paced.runs.empty());
  CHECK(with.self_paced.runs.front().before[0] < 0.01);  // [rad], never fitted
  CHECK(without.self_paced.runs.front().before[0] > 0.03);
}

TEST_CASE("dry friction and a constant torque are not called a friction that pushes one way", "[self-paced]") {
  const Diagnosis d = judged(leg({{"coulomb_friction@hip", 0.004}, {"constant_force@hip", 0.008}}, 24.0, 0.0, 9));
  CHECK(d.verdict == Verdict::effect_found);
  CHECK(std::abs(value_of(d, "coulomb_friction@hip") - 0.004) < 4e-4);
  CHECK(std::isnan(value_of(d, "asymmetric_coulomb@hip")));
  const double torque = value_of(d, "constant_force@hip"), bias = value_of(d, "input_bias");
  CHECK((std::abs(torque - 0.008) < 8e-4 || std::abs(bias * 0.0182 - 0.008) < 8e-4));
}

TEST_CASE("single values far from their neighbours are left out and counted, and unsay nothing", "[self-paced]") {
  Record r = leg({{"viscous_damper@hip", 0.0015}, {"coulomb_friction@hip", 0.006}}, 24.0, 0.0, 7);
  std::vector<std::size_t> struck;
  Random random(11);
  for (std::size_t i = 60; i + 60 < r.rows(); i += 40 + static_cast<std::size_t>(40.0 * random.uniform())) {
    r.outputs[0].values[i] += (random.uniform() < 0.5 ? -1.0 : 1.0) * (0.05 + 0.8 * random.uniform());
    struck.push_back(i);
  }
  Record clean = r;
  CHECK(take_out_spikes(clean) == struck.size());
  for (const std::size_t i : struck) CHECK(std::isnan(clean.outputs[0].values[i]));
  const Diagnosis d = judged(r);
  CHECK(d.quality.outliers == struck.size());
  CHECK(d.quality.missing == 0);
  CHECK(d.verdict == Verdict::effect_found);
  CHECK(std::abs(value_of(d, "viscous_damper@hip") - 0.0015) < 3e-4);
  CHECK(std::abs(value_of(d, "coulomb_friction@hip") - 0.006) < 6e-4);
  CHECK(d.heldout.after < 1.1);
}

TEST_CASE("values far from their neighbours' residual are left out, also next to one another", "[self-paced]") {
  const std::vector<Eigen::Index> struck{20, 21, 57, 60, 93};
  Data data;
  data.noise = Eigen::VectorXd::Constant(1, 0.1);
  data.segments.resize(2);
  std::vector<Eigen::VectorXd> residual(2, Eigen::VectorXd(120));
  Random random(5);
  for (std::size_t k = 0; k < 2; ++k) {
    data.segments[k].count = Eigen::VectorXd::Ones(120);
    for (Eigen::Index i = 0; i < 120; ++i)  // a model's own error is smooth, and much larger
      residual[k][i] = 30.0 * std::sin(0.03 * static_cast<double>(i)) + 0.1 * random.normal();
  }
  for (const Eigen::Index i : struck) residual[1][i] += 12.0;
  CHECK(leave_out_far(data, {0, 1}, residual) == struck.size());
  CHECK(data.segments[0].count.minCoeff() == 1.0);
  for (const Eigen::Index i : struck) CHECK(data.segments[1].count[i] == 0.0);
  CHECK(data.segments[1].count.sum() == 115.0);
}

TEST_CASE("a step, a turn counted anew and an end are no spikes", "[self-paced]") {
  Record r = leg({}, 4.0, 0.0, 3);
  auto& y = r.outputs[0].values;
  for (std::size_t i = 300; i < y.size(); ++i) y[i] += 1.0;
  y[120] -= 2.0 * std::numbers::pi;
  y.front() += 1.0;
  CHECK(take_out_spikes(r) == 0);
}
