#include "sim/transient.hpp"

#include <cmath>

#include "sim/campaign.hpp"
#include "sim/models/hopper_orbit.hpp"
#include "sim/record_identification.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

constexpr int P = 16;

struct Measured {
  Record record;
  std::unique_ptr<Campaign<Hopper<>>> campaign;
};

Measured measure(int settle, double noise, std::uint64_t seed) {
  PlanOptions p;
  p.period = P;
  p.seed = seed;
  p.amplitude = 0.004;
  p.opposed = true;  // distortion of even order, a product of transient and response, would be an error of its own
  Measured r;
  r.record.model = "hopper";
  r.record.sections = "clock";
  r.record.sections_per_cycle = 32;
  r.record.cycle_period = 1.0;
  r.record.stimulus_period_cycles = P;
  r.record.settle_cycles = settle;
  r.record.inputs.push_back({"u", "N", {}});
  r.record.outputs.push_back({"y_M", "m", {}});
  r.record.outputs.push_back({"v_M", "m/s", {}});
  CampaignOptions o;
  o.settle = settle;
  o.harmonics = 1;
  o.seed = seed;
  if (noise > 0.0) o.noise = {noise, 6.0 * noise};
  r.campaign = run_campaign(Hopper<>{}, ClockPhases{32}, make_plan(p), o, &r.record, {});
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

TEST_CASE("in noise too, and the first period on is usable", "[transient]") {
  double removed = 0.0, forty = 0.0;
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    Measured five = measure(5, 1e-4, seed);
    REQUIRE(remove_transient(five.record, 2).removed);
    removed += error_of(five);
    forty += error_of(measure(40, 1e-4, seed));
  }
  CHECK(removed <= 1.15 * forty);
}

TEST_CASE("a record too short, or without a clock, is left as it was", "[transient]") {
  Measured m = measure(0, 0.0, 1);
  const Record before = m.record;
  CHECK_FALSE(remove_transient(m.record, 2).removed);
  CHECK(m.record.outputs[0].values == before.outputs[0].values);
  m.record.sections = "foot";
  CHECK_FALSE(remove_transient(m.record, 2).removed);
}
