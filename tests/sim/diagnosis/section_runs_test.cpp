// Section maps of models beside those of walkers, made ones with a known truth and a real one.
#include "sim/diagnosis/section_runs.hpp"

#include <cmath>
#include <filesystem>
#include <numbers>

#include "sim/diagnosis/machines.hpp"
#include "sim/diagnosis/synthetic.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/walks.hpp"

using namespace saltus;
using namespace saltus::diagnosis;
using namespace saltus::test;

namespace {

struct Beside {
  Rhythm rhythm;
  RhythmBeside model;
};
Beside beside(const Record& record, const char* model, const std::vector<std::pair<std::string, double>>& changes,
              bool kinematic = false) {
  const auto machine = make_walker(model);
  REQUIRE(machine != nullptr);
  std::vector<double> values;
  REQUIRE(values_with(*machine, changes, values));
  RhythmOptions o;
  o.replicates = 100;
  o.kinematic = kinematic;
  rhythm::Layout layout;
  Beside b;
  b.rhythm = identify_rhythm(record, o, &layout);
  b.model = run_beside(layout, b.rhythm, *machine, values, o);
  return b;
}

}  // namespace

TEST_CASE("a model that is right has the walker's section maps, and the multipliers of its own limit cycle",
          "[section-runs]") {
  const Beside b = beside(walks_of(CompassGait<>{}, {}), "compass_gait", {});
  REQUIRE(b.rhythm.multipliers.size() == 3);
  REQUIRE(b.model.multipliers.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    const MultiplierBeside& m = b.model.multipliers[i];
    CAPTURE(m.model, m.sigma, m.measured, m.off);
    CHECK(std::abs(m.model - compass_gait_multipliers[i]) < 3.0 * m.sigma + 0.002);
    CHECK(m.sigma < 0.03);
    CHECK(m.off < 3.0);
  }
  REQUIRE(b.model.sections.size() == 4);
  for (const SectionBeside& s : b.model.sections) {
    CAPTURE(s.section, s.runs, s.lost, s.off, s.worst);
    CHECK(s.lost <= s.runs / 20);
    CHECK(s.off < 2.0);
    for (std::size_t c = 0; c < s.error.size(); ++c) {
      CAPTURE(c, s.error[c], s.bias[c], s.bias_sigma[c], s.scatter[c]);
      CHECK(s.error[c] < 0.05 * s.scatter[c]);
      CHECK(std::abs(s.bias[c]) < 4.0 * s.bias_sigma[c] + 1e-2 * s.scatter[c]);
    }
  }
}

TEST_CASE("a walk without its rates: the model starts at rates that a few samples ask for", "[section-runs]") {
  Walks w;
  w.dt = 0.002;
  w.sigma = 1e-7;
  w.experiments = 16;
  Record record = walks_of(CompassGait<>{}, w);
  record.outputs.resize(2);
  const Beside b = beside(record, "compass_gait", {});
  REQUIRE(b.model.multipliers.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    const MultiplierBeside& m = b.model.multipliers[i];
    CAPTURE(m.model, m.sigma, m.measured, m.off);
    CHECK(std::abs(m.model - compass_gait_multipliers[i]) < 3.0 * m.sigma + 0.005);
    CHECK(m.off < 3.0);
  }
}

TEST_CASE("a model with a wrong parameter is told by its maps and by what it predicts", "[section-runs]") {
  const Beside b = beside(walks_of(CompassGait<>{}, {}), "compass_gait", {{"a", 0.45}, {"b", 0.55}});
  double worst = 0.0, bias = 0.0;
  for (const SectionBeside& s : b.model.sections) {
    worst = std::max(worst, s.worst);
    for (std::size_t c = 0; c < s.bias.size(); ++c) bias = std::max(bias, std::abs(s.bias[c]) / s.bias_sigma[c]);
  }
  CHECK(worst > 4.0);
  CHECK(bias > 20.0);
  REQUIRE(!b.model.multipliers.empty());
  double off = 0.0;
  for (const MultiplierBeside& m : b.model.multipliers) off = std::max(off, m.off);
  CHECK(off > 4.0);
}

TEST_CASE("a leg let go on its bench: by the kinematic phase its decay, and that of a model that lacks the friction",
          "[section-runs][kinematic]") {
  constexpr double friction = 0.0015, inertia = 0.00432, stiffness = 0.7 * 9.81 * 0.0448, dt = 0.005;
  const auto machine = make_walker("leg_bench");
  std::vector<double> values;
  REQUIRE(values_with(*machine, {{"viscous_damper@hip", friction}}, values));
  Random random(7);
  Record r;
  r.name = "released";
  r.inputs = {{"u", "V", {}}};
  r.outputs = {{"angle", "rad", {}}};
  for (int e = 0; e < 12; ++e) {
    std::vector<double> t, u(1200, 0.0);
    for (std::size_t n = 0; n < u.size(); ++n) t.push_back(static_cast<double>(n) * dt);
    const Response y = machine->values_only(values, Course{t, u, 0, 0.5 * dt},
                                            diagnosis::Start{0, {0.1 + 0.1 * random.uniform(), 0.0}});
    REQUIRE(usable(y.status));
    for (std::size_t n = 0; n < u.size(); ++n) {
      r.experiment.push_back(e);
      r.t.push_back(t[n]);
      r.inputs[0].values.push_back(0.0);
      r.outputs[0].values.push_back(y.y[n] + 5e-5 * random.normal());
    }
  }
  // Small swings: the share of their size that a turn leaves, in closed form.
  const double fade = friction / (2.0 * inertia), rate = std::sqrt(stiffness / inertia - fade * fade);
  const double truth = std::exp(-fade * 2.0 * std::numbers::pi / rate);
  const Beside right = beside(r, "leg_bench", {{"viscous_damper@hip", friction}}, true);
  REQUIRE(right.rhythm.multipliers.size() == 1);
  REQUIRE(right.model.multipliers.size() == 1);
  CAPTURE(truth, right.rhythm.multipliers[0].value, right.model.multipliers[0].model, right.model.multipliers[0].off);
  CHECK(std::abs(right.rhythm.multipliers[0].value.real() - truth) < 0.01);
  CHECK(std::abs(right.model.multipliers[0].model.real() - truth) < 0.01);
  CHECK(right.model.multipliers[0].off < 3.0);
  for (const SectionBeside& s : right.model.sections) {
    CHECK(s.lost == 0);
    CHECK(s.off < 3.0);
  }
  const Beside free = beside(r, "leg_bench", {}, true);
  REQUIRE(free.model.multipliers.size() == 1);
  CHECK(std::abs(free.model.multipliers[0].model - 1.0) < 0.01);
  CHECK(free.model.multipliers[0].off > 10.0);
}

TEST_CASE("the walking robot: friction known from the bench takes the hip's bias within a step, none that of an impact",
          "[section-runs][measured]") {
  const Record walk = read_record(std::filesystem::path(SALTUS_TEST_DATA "/measured/compass-gait-walking.csv"));
  const Beside plain = beside(walk, "compass_gait_robot", {});
  const Beside rubbed =
      beside(walk, "compass_gait_robot", {{"viscous_damper@hip", 0.00111}, {"coulomb_friction@hip", 0.00665}});
  REQUIRE(plain.rhythm.coordinates[1].first == "hip'");
  const auto bias = [](const Beside& b, std::size_t section) {
    const SectionBeside& s = b.model.sections[section];
    return std::abs(s.bias[1]) / s.bias_sigma[1];
  };
  for (const std::size_t section : {4u, 5u}) {  // the inner leg stands
    CHECK(bias(plain, section) > 4.0);
    CHECK(bias(rubbed, section) < 3.0);
    CHECK(rubbed.model.sections[section].error[1] < plain.model.sections[section].error[1]);
  }
  CHECK(rubbed.model.sections[3].off > 3.0);  // the outer leg's last, across the impact
  CHECK(bias(rubbed, 3) > 4.0);
  for (const SectionBeside& s : rubbed.model.sections) CHECK(s.runs >= 25);
}

TEST_CASE("the leg on its bench: with the friction that was found there the model keeps as much of a swing as the leg",
          "[section-runs][kinematic][measured]") {
  const Record bench = read_record(std::filesystem::path(SALTUS_TEST_DATA "/measured/leg-bench.csv"));
  const Beside plain = beside(bench, "leg_bench", {}, true);
  const Beside rubbed =
      beside(bench, "leg_bench", {{"viscous_damper@hip", 0.00111}, {"coulomb_friction@hip", 0.00665}}, true);
  REQUIRE(plain.model.multipliers.size() == 1);
  REQUIRE(rubbed.model.multipliers.size() == 1);
  const MultiplierBeside &without = plain.model.multipliers[0], &with = rubbed.model.multipliers[0];
  CAPTURE(without.model, without.off, with.model, with.measured, with.off);
  CHECK(plain.rhythm.multipliers[0].high < 1.0);
  CHECK(without.model.real() > 1.0);  // the motor drives it
  CHECK(without.off > 10.0);
  CHECK(std::abs(with.model - with.measured) < 0.03);
  CHECK(with.off < without.off / 3.0);
}
