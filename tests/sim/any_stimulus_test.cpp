#include "sim/any_stimulus.hpp"

#include <cmath>
#include <numbers>

#include "sim/campaign.hpp"
#include "sim/models/hopper_orbit.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

constexpr int N = 32, cycles = 400;
constexpr double noise_level = 2e-4;

struct Deaf {  // the machine is played to, nobody listens
  Status push(std::int64_t, const auto&) { return Status::ok; }
};

Record play(const std::vector<double>& u, std::uint64_t seed) {
  const Hopper<> m;
  const ClockPhases family{N};
  const Timebase base = timebase_of(m, 512);
  LdtpOf<Hopper<>, N> system;
  const auto orbit = find_orbit<N>(m, base, family, system);
  REQUIRE(orbit.status == Status::ok);
  Run<Hopper<>> start;
  start.at = orbit.point[0];
  Rig<Hopper<>, ClockPhases> rig(m, base, family, start, Output<Hopper<>>(noise_level, 6.0 * noise_level), seed);
  Record r;
  r.sections = "clock";
  r.sections_per_cycle = N;
  r.cycle_period = 1.0;
  r.inputs.push_back({"u", "N", {}});
  r.outputs.push_back({"y_M", "m", {}});
  r.outputs.push_back({"v_M", "m/s", {}});
  Deaf deaf;
  REQUIRE(usable(run_experiment(rig, u, static_cast<std::int64_t>(u.size()), 0, deaf,
                                [&](std::int64_t n, double input, const auto& y) {
                                  r.experiment.push_back(0);
                                  r.t.push_back(static_cast<double>(n) / N);
                                  r.cycle.push_back(static_cast<int>(n / N));
                                  r.section.push_back(static_cast<int>(n % N));
                                  r.inputs[0].values.push_back(input);
                                  for (std::size_t c = 0; c < 2; ++c) r.outputs[c].values.push_back(y[c]);
                                })));
  return r;
}

std::vector<double> chirp() {  // from 0 to 11 cycles a cycle, and again four times
  std::vector<double> u;
  constexpr double span = cycles * N / 5.0;
  for (int n = 0; n < cycles * N; ++n) {
    const double t = std::fmod(n, span);
    u.push_back(0.05 * std::cos(std::numbers::pi * (11.0 / N) * t * t / span + 0.1));
  }
  return u;
}

std::vector<double> binary() {
  Random random(11);
  std::vector<double> u;
  for (int n = 0; n < cycles * N; ++n) u.push_back(random.bits() >> 63 != 0 ? 0.05 : -0.05);
  return u;
}

}  // namespace

TEST_CASE("a chirp and a random binary sequence give the HTFs of the multisine, within their intervals", "[stimulus]") {
  PlanOptions p;
  p.period = 16;
  p.amplitude = 0.02;
  CampaignOptions o;
  o.periods = 4;
  o.harmonics = 1;
  o.noise = {noise_level, 6.0 * noise_level};
  const auto campaign = run_campaign(Hopper<>{}, ClockPhases{N}, make_plan(p), o, nullptr, {});
  REQUIRE(usable(campaign->id.worst));

  AnyStimulusOptions options;
  options.period = 16;
  options.band = 9.0;
  for (const bool sweep : {true, false}) {
    INFO((sweep ? "chirp" : "binary sequence"));
    const AnyStimulusFit fit = identify_any_stimulus(play(sweep ? chirp() : binary(), 5), options);
    REQUIRE(fit.status == Status::ok);
    REQUIRE(fit.multipliers.size() == 2);
    CHECK(fit.condition > 1.0);
    CHECK(fit.condition < (sweep ? 1e10 : 1e4));
    CHECK(std::abs(fit.noise[0] / noise_level - 1.0) < 0.05);
    CHECK(std::abs(fit.noise[1] / (6.0 * noise_level) - 1.0) < 0.05);
    const Complex exact_multiplier(-0.248983334736, 0.699333251798);
    CHECK(std::abs(fit.multipliers[0] - exact_multiplier) < 3.5 * fit.sigma[0]);
    int agree = 0, exact = 0, all = 0;
    for (const HtfEstimate& h : fit.id.htf) {
      for (const HtfEstimate& other : campaign->id.htf) {
        if (other.m != h.m || other.line != h.line || other.output != h.output) continue;
        const double sigma = std::hypot(h.sigma, other.sigma);
        agree += std::abs(h.value - other.value) < 1.73 * sigma ? 1 : 0;
        exact += std::abs(h.value - campaign->exact(h)) < 1.73 * h.sigma ? 1 : 0;
        ++all;
      }
    }
    REQUIRE(all == 3 * 2 * 126);
    INFO(agree << " " << exact << " of " << all);
    CHECK(agree > 0.9 * all);
    CHECK(exact > 0.88 * all);
  }
}

TEST_CASE("a record that cannot be used is refused", "[stimulus]") {
  Record r;
  CHECK_THROWS_AS(identify_any_stimulus(r), RecordError);
  r = play(std::vector<double>(40 * N, 0.0), 1);
  CHECK_THROWS_AS(identify_any_stimulus(r), RecordError);  // too few cycles
}
