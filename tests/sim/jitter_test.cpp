#include "sim/jitter.hpp"

#include <cmath>

#include "sim/campaign.hpp"
#include "sim/models/hopper_orbit.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

struct Measured {
  Record record;
  std::unique_ptr<Campaign<Hopper<>>> campaign;
};

Measured measure(double jitter, double noise, double amplitude, std::uint64_t seed, std::int64_t periods = 4) {
  PlanOptions p;
  p.period = 16;
  p.seed = seed;
  p.amplitude = std::abs(amplitude);
  Measured r;
  r.record.model = "hopper";
  r.record.sections = "clock";
  r.record.sections_per_cycle = 32;
  r.record.cycle_period = 1.0;
  r.record.stimulus_period_cycles = 16;
  r.record.settle_cycles = 40;
  r.record.inputs.push_back({"u", "N", {}});
  r.record.outputs.push_back({"y_M", "m", {}});
  r.record.outputs.push_back({"v_M", "m/s", {}});
  CampaignOptions o;
  o.settle = 40;
  o.periods = periods;
  o.harmonics = 1;
  o.seed = seed;
  if (noise > 0.0) o.noise = {noise, 6.0 * noise};
  o.jitter = jitter;
  r.campaign = run_campaign(Hopper<>{}, ClockPhases{32}, scaled(make_plan(p), amplitude), o, &r.record, {});
  REQUIRE(usable(r.campaign->id.worst));
  return r;
}

}  // namespace

TEST_CASE("instants that scatter by 5 ms are found, within three standard errors", "[jitter]") {
  for (const double jitter : {0.002, 0.005}) {
    const TimingJitter r = estimate_jitter(measure(jitter, 1e-3, 0.01, 1).record);
    INFO(jitter << ": " << r.seconds << " +- " << r.sigma);
    CHECK(r.found);
    CHECK(std::abs(r.seconds - jitter) < 3.0 * r.sigma);
    CHECK(r.sigma < 0.05 * jitter);
  }
}

TEST_CASE("none is claimed where there is none, whatever the noise", "[jitter]") {
  int claimed = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    claimed += estimate_jitter(measure(0.0, seed % 2 == 0 ? 1e-3 : 1e-5, 0.01, seed, 2).record).found ? 1 : 0;
  }
  CHECK(claimed == 0);
  CHECK_FALSE(estimate_jitter(measure(0.0, 0.0, 0.01, 1, 2).record).found);
}

TEST_CASE("most of the bias of scattering instants is taken off the height at the highest lines", "[jitter]") {
  // The same instants with the stimulus and with its opposite: what the cycle itself scatters cancels in their mean.
  const Measured plus = measure(0.005, 0.0, 0.05, 3, 8), minus = measure(0.005, 0.0, -0.05, 3, 8);
  const TimingJitter r = estimate_jitter(plus.record);
  REQUIRE(r.found);
  Identification biased = plus.campaign->id;
  for (std::size_t i = 0; i < biased.htf.size(); ++i) {
    biased.htf[i].value = 0.5 * (biased.htf[i].value + minus.campaign->id.htf[i].value);
  }
  Identification corrected = biased;
  correct_jitter(corrected, r.seconds, 1.0);
  const auto gain = [&](const Identification& id, int output) {  // of H_0 at f = 8 to 10, by least squares
    Complex sum{};
    double square = 0.0;
    for (const HtfEstimate& h : id.htf) {
      if (h.m != 0 || h.output != output || h.line < 8 * id.period) continue;
      const Complex exact = plus.campaign->exact(h);
      sum += std::conj(exact) * h.value;
      square += std::norm(exact);
    }
    return std::real(sum) / square;
  };
  const double before = gain(biased, 0), after = gain(corrected, 0);
  INFO(before << " " << after << ", jitter " << r.seconds << " +- " << r.sigma);
  CHECK(before < 0.96);  // exp(-(2 pi 9 0.005)^2 / 2) = 0.961, and the corners of a held input
  CHECK(std::abs(after - 1.0) < 0.5 * std::abs(before - 1.0));
}

TEST_CASE("the correction is the inverse of the mean of a cosine at scattered instants", "[jitter]") {
  Random random(5);
  constexpr double pi = 3.14159265358979323846, s = 0.005, f = 10.0;
  double mean = 0.0;
  constexpr int draws = 400000;
  for (int i = 0; i < draws; ++i) mean += std::cos(2.0 * pi * f * s * random.normal()) / draws;
  Identification id;
  id.sections = 32;
  id.period = 64;
  id.htf.push_back({1, 9 * 64, 0, Complex(mean, 0.0), 0.1 * mean, 64});  // input at 9, output at 10
  correct_jitter(id, s, 1.0);
  CHECK(std::abs(id.htf[0].value - 1.0) < 5e-4);
  CHECK(std::abs(id.htf[0].sigma - 0.1) < 5e-5);
}
