// Walkers that no clock paces, emulated whole, with impacts; diagnosed step by step, from all outputs or from some.
#include <algorithm>
#include <cmath>

#include "core/flow/advance.hpp"
#include "core/random.hpp"
#include "sim/diagnosis/diagnosis.hpp"
#include "sim/effects/force_laws.hpp"
#include "sim/models/compass_gait.hpp"
#include "sim/models/kneed_biped.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;
using namespace saltus::diagnosis;

namespace {

// Four walks of three steps each, begun with rates up to 3 % off the gait's, at 100 Hz; noise [rad], ten times as much
// [rad/s]. A step ends at the last edge.
template <class M>
Record walks(const M& m, std::string_view name, std::uint64_t seed, double noise) {
  constexpr double dt = 0.01;  // [s]
  constexpr int most = 3;
  Record r;
  r.name = "walks";
  r.model = std::string(name);
  for (const auto& q : M::outputs) r.outputs.push_back({std::string(q.name), std::string(q.unit), {}});
  visit_each(typename M::Charts{}, [&](auto c) { r.chart_names.emplace_back(type_name<decltype(c)>()); });
  Random random(seed);
  const Input<M> u = Input<M>::Zero();
  for (int e = 0; e < 4; ++e) {
    Point<M> p = start_of(m);
    for (int i = dim_of(p) / 2; i < dim_of(p); ++i) p.x[i] *= 1.0 + 0.03 * (2.0 * random.uniform() - 1.0);
    int steps = 0;
    for (int row = 0; steps < most && row < 2000; ++row) {
      const Output<M> y = output_at(m, p, u);
      r.experiment.push_back(e);
      r.cycle.push_back(steps);
      r.chart.push_back(p.chart);
      r.t.push_back(dt * row);
      for (std::size_t j = 0; j < r.outputs.size(); ++j) {
        const double sigma = noise * (r.outputs[j].unit == "rad" ? 1.0 : 10.0);
        r.outputs[j].values.push_back(y[static_cast<int>(j)] + sigma * random.normal());
      }
      for (int part = 0; part < 8; ++part) {
        const Passage passed = advance(m, p, u, dt / 8.0);
        REQUIRE(usable(passed.status));
        for (int k = 0; k < passed.events; ++k) {
          if (passed.event[static_cast<std::size_t>(k)].edge == M::Edges::size - 1) ++steps;
        }
      }
    }
    REQUIRE(steps == most);
  }
  return r;
}

// The same without the outputs that are rates.
Record angles_of(Record r) {
  std::erase_if(r.outputs, [](const saltus::Channel& c) { return c.unit != "rad"; });
  return r;
}

Diagnosis concluded(const Record& r) {
  const auto m = make_machine(r.model);
  REQUIRE(m != nullptr);
  return diagnose(r, *m, {});
}

void check_one(const Diagnosis& d, const std::string& name, double truth) {
  INFO(d.story[1]);
  REQUIRE(d.effects.size() == 1);
  CHECK(d.effects[0].name == name);
  CHECK(d.effects[0].low < truth);
  CHECK(truth < d.effects[0].high);
  CHECK(std::abs(d.effects[0].value - truth) < 0.1 * truth);
  CHECK(d.heldout.after < 1.1);
  CHECK(d.heldout.refit > 1.5 * d.heldout.after);
}

}  // namespace

TEST_CASE("the kneed biped: a damper in its knee is found, from angles and rates or from angles alone", "[walkers]") {
  using Damper = effects::Viscous<kneed_biped::Knee>;
  const With<KneedBiped<>, Damper> m(KneedBiped<>{}, Damper{0.03});
  const Record r = walks(m, "kneed_biped", 3, 1e-3);
  check_one(concluded(r), "viscous_damper@knee", 0.03);
  const Diagnosis d = concluded(angles_of(r));
  check_one(d, "viscous_damper@knee", 0.03);
  CHECK(d.outputs.size() == 3);
  const auto says = [&](const std::string& n) { return n.find("rate_s, rate_ns, rate_k") != std::string::npos; };
  CHECK(std::any_of(d.notes.begin(), d.notes.end(), says));
  for (const CandidateRow& c : d.candidates) CHECK(c.name.find("rate_") == std::string::npos);
}

TEST_CASE("walkers that are as declared: nothing is invented", "[walkers]") {
  const auto nothing = [](const Diagnosis& d) {
    INFO(d.story[1]);
    CHECK(d.effects.empty());
    CHECK((d.verdict == Verdict::no_discrepancy || d.verdict == Verdict::parameters_only));
    CHECK(d.heldout.before < 1.1);
    for (const CandidateRow& c : d.candidates) CHECK(c.name.rfind("input_", 0) != 0);  // for there is no input
  };
  nothing(concluded(walks(KneedBiped<>{}, "kneed_biped", 4, 1e-3)));
  nothing(concluded(walks(CompassGait<>{}, "compass_gait", 5, 1e-3)));
}

TEST_CASE("the compass gait: a damper in its hip is found, and steps that nobody counted are asked for", "[walkers]") {
  using Damper = effects::Viscous<compass_gait::Hip>;
  Record r = walks(With<CompassGait<>, Damper>(CompassGait<>{}, Damper{0.1}), "compass_gait", 6, 3e-4);
  check_one(concluded(r), "viscous_damper@hip", 0.1);
  r.cycle.clear();
  CHECK_THROWS_WITH(concluded(r), Catch::Contains("column 'cycle'"));
}
