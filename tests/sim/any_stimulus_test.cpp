#include "sim/any_stimulus.hpp"

#include <cmath>

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

// Sections of the kinematic phase follow one another as those of the clock do, so their record is written as one.
template <class Family>
Record play(const Family& family, const std::vector<double>& u, std::uint64_t seed) {
  const Hopper<> m;
  const Timebase base = timebase_of(m, 512);
  LdtpOf<Hopper<>, N> system;
  const auto orbit = find_orbit<N>(m, base, family, system);
  REQUIRE(orbit.status == Status::ok);
  Run<Hopper<>> start;
  start.at = orbit.point[0];
  Rig<Hopper<>, Family> rig(m, base, family, start, Output<Hopper<>>(noise_level, 6.0 * noise_level), seed);
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
                                  add_row(r, 0, n, N, 1.0, input, y);
                                })));
  return r;
}

}  // namespace

TEMPLATE_TEST_CASE("a chirp and a random binary sequence give the HTFs of the multisine, within their intervals",
                   "[stimulus]", ClockPhases, KinematicPhases) {
  const TestType family{N};
  PlanOptions p;
  p.period = 16;
  p.amplitude = 0.02;
  CampaignOptions o;
  o.periods = 4;
  o.harmonics = 1;
  o.noise = {noise_level, 6.0 * noise_level};
  const auto campaign = run_campaign(Hopper<>{}, family, make_plan(p), o, nullptr, {});
  REQUIRE(usable(campaign->id.worst));

  AnyStimulusOptions options;
  options.period = 16;
  options.band = 9.0;
  for (const bool sweep : {true, false}) {
    INFO((sweep ? "chirp" : "binary sequence"));
    int agree = 0, exact = 0, all = 0;
    const std::vector<double> u = sweep ? chirp_input(cycles, N, 11.0, 0.05) : binary_input(cycles, N, 0.05, 5);
    const AnyStimulusFit fit = identify_any_stimulus(play(family, u, 5), options);
    REQUIRE(fit.status == Status::ok);
    REQUIRE(fit.multipliers.size() == 2);
    CHECK(fit.condition > 1.0);
    CHECK(fit.condition < (sweep ? 1e10 : 1e4));
    CHECK(std::abs(fit.noise[0] / noise_level - 1.0) < 0.05);
    CHECK(std::abs(fit.noise[1] / (6.0 * noise_level) - 1.0) < 0.05);
    const Complex exact_multiplier(-0.248983334736, 0.699333251798);
    CHECK(std::abs(fit.multipliers[0] - exact_multiplier) < 3.5 * fit.sigma[0]);
    for (const HtfEstimate& h : fit.id.htf) {
      for (const HtfEstimate& other : campaign->id.htf) {
        if (other.m != h.m || other.line != h.line || other.output != h.output) continue;
        const double sigma = std::hypot(h.sigma, other.sigma);
        agree += std::abs(h.value - other.value) < 1.7308 * sigma ? 1 : 0;  // 95 % of a complex normal
        exact += std::abs(h.value - campaign->exact(h)) < 1.7308 * h.sigma ? 1 : 0;
        ++all;
      }
    }
    REQUIRE(all == 3 * 2 * 126);
    // Binomial, for as many independent numbers as there are taps: 95 a harmonic and output, real for each of two
    // parts.
    const double independent = 3 * 2 * 95 / 2.0, spread = std::sqrt(0.95 * 0.05 / independent);
    INFO(agree << " " << exact << " of " << all << ", a standard deviation is " << spread * all);
    CHECK(std::abs(static_cast<double>(agree) / all - 0.95) < 3.0 * spread);
    CHECK(std::abs(static_cast<double>(exact) / all - 0.95) < 3.0 * spread);
  }
}

TEST_CASE("the binary sequence is of maximal length, and the chirp sweeps its band", "[stimulus]") {
  const std::vector<double> u = binary_input(20000, N, 1.0, 3);
  double sum = 0.0, next = 0.0;
  for (std::size_t n = 0; n + 1 < u.size(); ++n) {
    sum += u[n];
    next += u[n] * u[n + 1];
  }
  const auto count = static_cast<double>(u.size());
  CHECK(std::abs(sum) < 4.0 * std::sqrt(count));  // as of a fair coin
  CHECK(std::abs(next) < 4.0 * std::sqrt(count));
  CHECK(binary_input(20, N, 1.0, 3) != binary_input(20, N, 1.0, 4));
  const std::vector<double> v = chirp_input(400, N, 8.0, 0.5);
  REQUIRE(v.size() == 400 * N);
  int crossings = 0;  // of one sweep: twice the mean frequency, four cycles a cycle for 80 cycles
  for (std::size_t n = 1; n < v.size() / 5; ++n) crossings += v[n] * v[n - 1] < 0.0 ? 1 : 0;
  CHECK(std::abs(crossings - 2 * 4 * 80) < 5);
}

TEST_CASE("a record that cannot be used is refused", "[stimulus]") {
  Record r;
  CHECK_THROWS_AS(identify_any_stimulus(r), RecordError);
  r = play(ClockPhases{N}, std::vector<double>(40 * N, 0.0), 1);
  CHECK_THROWS_AS(identify_any_stimulus(r), RecordError);  // too few cycles
}
