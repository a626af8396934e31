#include "sim/transient.hpp"

#include <cmath>

#include "sim/campaign.hpp"
#include "sim/experiment_design.hpp"
#include "sim/models/hopper_orbit.hpp"
#include "sim/record_identification.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {


struct Measured {
  Record record;
  std::unique_ptr<Campaign<Hopper<>>> campaign;
};

struct Setting {
  int period = 16, tones = 0;  // tones 0: all that the rules allow
  double band = 10.0;
};

Measured measure(int settle, double noise, std::uint64_t seed, const Setting& setting = {}) {
  PlanOptions p;
  p.period = setting.period;
  p.band = setting.band;
  p.seed = seed;
  p.amplitude = 0.004;
  p.opposed = true;  // distortion of even order, a product of transient and response, would be an error of its own
  Measured r;
  r.record.model = "hopper";
  r.record.sections = "clock";
  r.record.sections_per_cycle = 32;
  r.record.cycle_period = 1.0;
  r.record.stimulus_period_cycles = setting.period;
  r.record.settle_cycles = settle;
  r.record.inputs.push_back({"u", "N", {}});
  r.record.outputs.push_back({"y_M", "m", {}});
  r.record.outputs.push_back({"v_M", "m/s", {}});
  CampaignOptions o;
  o.settle = settle;
  o.harmonics = 1;
  o.seed = seed;
  if (noise > 0.0) o.noise = {noise, 6.0 * noise};
  DesignOptions d;
  d.tones = setting.tones;
  r.campaign = run_campaign(Hopper<>{}, ClockPhases{32}, design_plan(p, d), o, &r.record, {});
  REQUIRE(usable(r.campaign->id.worst));
  return r;
}

// Root mean square of the error of H_0 over all lines and outputs, each output over its own H_0.
double error_of(const Measured& m) {
  const Identification id = identify_record(m.record, 0);
  double error[2]{}, size[2]{};
  for (const HtfEstimate& h : id.htf) {
    const Complex exact = m.campaign->exact(h);
    error[h.output] += std::norm(h.value - exact);
    size[h.output] += std::norm(exact);
  }
  return std::sqrt(error[0] / size[0] + error[1] / size[1]);
}

}  // namespace

TEST_CASE("five settling cycles with the transient taken out are worth forty dropped ones", "[transient]") {
  Measured five = measure(5, 0.0, 1);
  const double dropped_five = error_of(five), dropped_forty = error_of(measure(40, 0.0, 1));
  const TransientRemoval r = remove_transient(five.record, 2);
  REQUIRE(r.removed);
  CHECK(std::abs(r.multipliers[0] - Complex(-0.248983334736, 0.699333251798)) < 1e-5);
  CHECK(r.cycles_saved > 10);
  const double removed = error_of(five);
  INFO(dropped_five << " " << dropped_forty << " " << removed);
  CHECK(dropped_five > 0.01);
  CHECK(removed <= dropped_forty);
}

TEST_CASE("in noise too, whatever the tones: modelling lets next to no noise through", "[transient]") {
  for (const Setting& setting : {Setting{16, 0, 10.0}, Setting{64, 0, 1.0}}) {  // 7 and 31 tones
    double removed = 0.0, forty = 0.0;
    for (const std::uint64_t seed : {1U, 2U, 3U, 4U}) {
      Measured five = measure(5, 1e-4, seed, setting);
      const TransientRemoval r = remove_transient(five.record, 2);
      REQUIRE(r.removed);
      CHECK(r.inflation < 1.02);
      removed += error_of(five);
      forty += error_of(measure(40, 1e-4, seed, setting));
    }
    INFO(setting.period << ": " << removed << " " << forty);
    CHECK(removed <= 1.05 * forty);  // the scatter of four draws
  }
}

TEST_CASE("usable from the first cycle on, and never worse than dropping by more than 2 %", "[transient]") {
  const Setting four{16, 4, 10.0};
  for (const double noise : {0.0, 1e-4, 1e-3}) {
    for (const int settle : {0, 1, 5}) {
      Measured m = measure(settle, noise, 3, four);
      const double dropped = error_of(m);
      const TransientRemoval r = remove_transient(m.record, 2);
      const double chosen = error_of(m);
      INFO(noise << " " << settle << ": " << dropped << " " << chosen << ", expected " << r.dropped << " "
                 << r.modelled);
      CHECK(chosen <= 1.02 * dropped);
      CHECK(r.removed == (noise < 5e-4));  // 1 mm hides what is left of it
      // What was expected is what came, H_0 of both outputs being meant.
      const double expected = (r.removed ? r.modelled : r.dropped) * std::sqrt(2.0);
      CHECK(chosen < 1.3 * expected + 1e-6);
      if (noise > 0.0) CHECK(chosen > 0.7 * expected);
      if (noise == 0.0) CHECK(chosen < 1e-5);
    }
  }
}

TEST_CASE("the choice can be made by hand", "[transient]") {
  const Setting four{16, 4, 10.0};
  Measured m = measure(0, 1e-3, 3, four);
  const Record before = m.record;
  CHECK_FALSE(remove_transient(m.record, 2, TransientChoice::drop).removed);
  CHECK(m.record.outputs[0].values == before.outputs[0].values);
  CHECK(remove_transient(m.record, 2, TransientChoice::model).removed);
  CHECK(m.record.outputs[0].values != before.outputs[0].values);
}

TEST_CASE("a record too short, or without a clock, is left as it was", "[transient]") {
  Measured m = measure(0, 0.0, 1);
  const Record before = m.record;
  CHECK_FALSE(remove_transient(m.record, 2).removed);
  CHECK(m.record.outputs[0].values == before.outputs[0].values);
  m.record.sections = "foot";
  CHECK_FALSE(remove_transient(m.record, 2).removed);
}
