#include "sim/distortion.hpp"

#include <cmath>

#include "sim/experiment_design.hpp"
#include "sim/models/hopper_orbit.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

Multisine<max_tones> odd_stimulus(double amplitude, int period) {
  PlanOptions p;
  p.amplitude = amplitude;
  p.period = period;
  DesignOptions d;
  d.odd = true;
  d.detection = period / 16;
  return design_plan(p, d).experiments[0];
}

}  // namespace

TEST_CASE("distortion of the hopper is found and sized at 0.3 and 1 N, and none is claimed at 0.01 N", "[distortion]") {
  const KinematicPhases family{32};
  CampaignOptions o;
  o.settle = 60;
  o.periods = 4;
  for (const double amplitude : {0.01, 0.3, 1.0}) {
    const auto stimulus = odd_stimulus(amplitude, 32);
    o.noise.clear();
    const Distortion exact = measure_distortion(Hopper<>{}, family, stimulus, 32, o);
    o.noise = {1e-3, 6e-3};
    const Distortion seen = measure_distortion(Hopper<>{}, family, stimulus, 32, o);
    REQUIRE(exact.status == Status::ok);
    REQUIRE(seen.status == Status::ok);
    for (int c = 0; c < 2; ++c) {
      const auto i = static_cast<std::size_t>(c);
      INFO(amplitude << " N, output " << c);
      CHECK(seen.found_even(c) == (amplitude > 0.1));
      if (amplitude < 0.1) CHECK_FALSE(seen.found_odd(c));
      if (amplitude > 0.9) CHECK(seen.found_odd(c));
      CHECK(std::abs(seen.even[i].rms() - exact.even[i].rms()) < 4.0 * seen.even[i].sigma());
      CHECK(std::abs(seen.odd[i].rms() - exact.odd[i].rms()) < 4.0 * seen.odd[i].sigma());
    }
  }
}

// At 1 mm the odd order of 0.3 N and all of the isochrons' distortion is far below the noise: finer sensors see it.
TEMPLATE_TEST_CASE("what 1 mm of noise hides is sized by finer sensors, under both phases", "[distortion]", ClockPhases,
                   KinematicPhases) {
  const TestType family{32};
  const bool clock = TestType::on_grid;
  const double fine = clock ? 1e-9 : 1e-5;
  CampaignOptions o;
  o.settle = 80;
  o.periods = 4;
  for (const double amplitude : {0.3, 1.0}) {
    const auto stimulus = odd_stimulus(amplitude, 32);
    o.noise.clear();
    const Distortion exact = measure_distortion(Hopper<>{}, family, stimulus, 32, o);
    o.noise = {1e-3, 6e-3};
    const Distortion hidden = measure_distortion(Hopper<>{}, family, stimulus, 32, o);
    o.noise = {fine, 6.0 * fine};
    const Distortion seen = measure_distortion(Hopper<>{}, family, stimulus, 32, o);
    for (int c = 0; c < 2; ++c) {
      const auto i = static_cast<std::size_t>(c);
      INFO(amplitude << " N, output " << c << ": " << exact.even[i].rms() << " " << exact.odd[i].rms());
      CHECK(seen.found_even(c));
      CHECK((clock || seen.found_odd(c)));
      CHECK(std::abs(seen.even[i].rms() - exact.even[i].rms()) < 4.0 * seen.even[i].sigma());
      CHECK(std::abs(seen.odd[i].rms() - exact.odd[i].rms()) < 4.0 * seen.odd[i].sigma());
      if (clock) CHECK_FALSE(hidden.found_even(c));
      if (clock || amplitude < 0.5) CHECK_FALSE(hidden.found_odd(c));
    }
  }
}

TEST_CASE("distortion of even order grows with the square of the amplitude, of odd order with the cube",
          "[distortion]") {
  CampaignOptions o;
  o.settle = 100;
  const ClockPhases family{32};
  const Distortion small = measure_distortion(Hopper<>{}, family, odd_stimulus(0.5, 32), 32, o);
  const Distortion large = measure_distortion(Hopper<>{}, family, odd_stimulus(1.0, 32), 32, o);
  REQUIRE(large.status == Status::ok);
  CHECK(std::abs(large.even[0].rms() / small.even[0].rms() - 4.0) < 0.1);
  CHECK(std::abs(large.odd[0].rms() / small.odd[0].rms() - 8.0) < 1.0);
}

TEST_CASE("a ladder of amplitudes gives the linear HTF that a single amplitude misses", "[distortion]") {
  const KinematicPhases family{32};
  const std::vector<double> amplitude{0.04, 0.06, 0.09};
  PlanOptions p;
  p.period = 16;
  p.band = 1.0;
  p.opposed = true;
  CampaignOptions o;
  o.settle = 100;
  o.harmonics = 0;
  std::vector<std::vector<HtfEstimate>> rungs;
  std::vector<Complex> exact;
  for (const double a : amplitude) {
    p.amplitude = a;
    const auto campaign = run_campaign(Hopper<>{}, family, make_plan(p), o, nullptr, {});
    REQUIRE(usable(campaign->id.worst));
    rungs.push_back(campaign->id.htf);
    exact.clear();
    for (const HtfEstimate& h : campaign->id.htf) exact.push_back(campaign->exact(h));
  }
  double largest = 0.0, extrapolated = 0.0;
  for (std::size_t i = 0; i < exact.size(); ++i) {
    std::vector<Complex> value;
    for (const auto& rung : rungs) value.push_back(rung[i].value);
    const std::vector<double> sigma(value.size(), 1e-7);  // exact but for rounding and settling: the highest degree
    const ZeroAmplitude zero = extrapolate_to_zero(amplitude, value, sigma);
    largest = std::max(largest, std::abs(value.front() - exact[i]));
    extrapolated = std::max(extrapolated, std::abs(zero.value - exact[i]));
  }
  INFO(largest << " " << extrapolated);
  CHECK(extrapolated < 0.2 * largest);
}
