// The rhythm of machines that pace themselves, from records with a known truth and from a real one.
#include <cmath>
#include <numbers>

#include "core/flow/advance.hpp"
#include "core/random.hpp"
#include "sim/models/compass_gait.hpp"
#include "sim/rhythm.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

// A turning arm with a lateral coordinate that decays and is pushed: chart "a" while it turns through [0, 1), then "b",
// each event taking `kept` of the lateral coordinate. theta' = 1 + slow q, q' = -decay q + gain u.
struct Arm {
  double decay = 0.4, kept = 0.9, gain = 2.0, noise = 1e-4;
  double sway = 0.0;      // of the start of each experiment
  double push = 0.0;      // held for `hold` samples at random
  double feedback = 0.0;  // u = -feedback q besides
  int hold = 10;
};
constexpr double dt = 0.005, half = 0.5;  // [s] a sample, a chart

Record record_of(const Arm& arm, int experiments, int cycles, std::uint64_t seed) {
  Random random(seed);
  Record r;
  r.name = "arm";
  r.chart_names = {"a", "b"};
  r.inputs = {{"u", "N", {}}};
  r.outputs = {{"theta", "rad", {}}, {"q", "m", {}}};
  for (int e = 0; e < experiments; ++e) {
    double q = arm.sway * random.normal(), u = 0.0;
    double theta = 0.0;
    int chart = 0, step = 1, n = 0;
    while (step <= 2 * cycles) {
      if (n % arm.hold == 0) u = arm.push * random.normal() - arm.feedback * q;
      r.experiment.push_back(e);
      r.cycle.push_back(step);
      r.chart.push_back(chart);
      r.t.push_back(n * dt);
      r.inputs[0].values.push_back(u);
      r.outputs[0].values.push_back(theta + arm.noise * random.normal());
      r.outputs[1].values.push_back(q + arm.noise * random.normal());
      // Exactly: q decays; theta = time within the chart.
      const double fade = std::exp(-arm.decay * dt);
      q = fade * q + arm.gain * u * (1.0 - fade) / arm.decay;
      theta += dt;
      ++n;
      if (theta > half - 1e-9) {
        theta = 0.0;
        q *= arm.kept;
        chart = 1 - chart;
        ++step;
      }
    }
  }
  return r;
}

double truth_of(const Arm& arm) { return arm.kept * arm.kept * std::exp(-arm.decay * 2.0 * half); }

}  // namespace

TEST_CASE("the multiplier of a machine whose deviations decay lies in its interval, and noise does not bias it",
          "[rhythm]") {
  Arm arm;
  arm.sway = 0.01;
  arm.noise = 1e-3;
  int inside = 0;
  double mean = 0.0;
  constexpr int seeds = 40;
  for (int seed = 1; seed <= seeds; ++seed) {
    const Rhythm r = identify_rhythm(record_of(arm, 12, 6, static_cast<std::uint64_t>(seed)));
    REQUIRE(r.multipliers.size() == 1);  // its rate is the same coordinate once more
    const double z = (r.multipliers[0].value.real() - truth_of(arm)) / r.multipliers[0].sigma;
    inside += std::abs(z) < 1.96;
    mean += r.multipliers[0].value.real() / seeds;
    CHECK(r.cycles == 12 * 4);  // the first and the last have an event at one end only
    CHECK(std::abs(r.period - 2.0 * half) < 1e-3);
  }
  CAPTURE(inside, mean, truth_of(arm));
  CHECK(inside >= 34);
  CHECK(std::abs(mean - truth_of(arm)) < 0.02);
}

TEST_CASE("where the input excites the machine its harmonic transfer functions are those between its sections",
          "[rhythm]") {
  Arm arm;
  arm.push = 0.4;
  arm.hold = 5;
  arm.kept = 0.95;
  int all = 0, inside = 0, clear = 0;
  for (const std::uint64_t seed : {1u, 2u, 3u, 4u, 5u, 6u}) {
    const Rhythm r = identify_rhythm(record_of(arm, 10, 40, seed));
    CAPTURE(r.refusal);
    REQUIRE(!r.htf.empty());
    CHECK(r.told < 0.5);
    // The same machine from section to section, played for long enough.
    const std::size_t N = r.sections.size();
    std::vector<double> a(N), b(N);
    for (std::size_t k = 0; k < N; ++k) {
      const double ahead = k + 1 < N ? r.sections[k + 1].phase : r.sections[0].phase + 1.0;
      const double time = (ahead - r.sections[k].phase) * 2.0 * half;
      const bool event = (k + 1) % (N / 2) == 0;
      a[k] = std::exp(-arm.decay * time) * (event ? arm.kept : 1.0);
      b[k] = arm.gain * (1.0 - std::exp(-arm.decay * time)) / arm.decay * (event ? 0.5 * (1.0 + arm.kept) : 1.0);
    }
    for (const RhythmHtf& h : r.htf) {
      if (r.coordinates[h.output].first != "q" || h.f > 2.0) continue;
      const double w = 2.0 * std::numbers::pi * h.f / static_cast<double>(N);
      const double scale = arm.gain / std::hypot(arm.decay, 2.0 * std::numbers::pi * h.f);  // of H_0, about
      Complex x = 0.0, exact = 0.0;
      const std::size_t settle = 40 * N, turns = 16;  // f is a multiple of 1/16
      for (std::size_t k = 0; k < settle + turns * N; ++k) {
        const double turn = 2.0 * std::numbers::pi * h.m * static_cast<double>(k) / static_cast<double>(N);
        if (k >= settle)
          exact += x * std::polar(1.0 / static_cast<double>(turns * N), -w * static_cast<double>(k) - turn);
        x = a[k % N] * x + b[k % N] * std::polar(1.0, w * static_cast<double>(k));
      }
      ++all;
      inside += std::abs(h.value - exact) < 2.0 * h.sigma + 0.01 * scale;
      clear += h.m == 0 && std::abs(h.value) > 5.0 * h.sigma;
    }
  }
  CAPTURE(inside, all, clear);
  CHECK(inside > all * 8 / 10);
  CHECK(clear > 6 * 20);
}

TEST_CASE("a record that marks no events, or too few, is refused with what to do about it", "[rhythm]") {
  Arm arm;
  arm.sway = 0.01;
  Record r = record_of(arm, 12, 6, 1);
  r.cycle.clear();
  CHECK_NOTHROW(identify_rhythm(r));  // its charts mark them
  r.chart.clear();
  r.chart_names.clear();
  std::string said;
  try {
    identify_rhythm(r);
  } catch (const RecordError& e) {
    said = e.what();
  }
  CHECK(said.find("column cycle") != std::string::npos);
  CHECK_THROWS_AS(identify_rhythm(record_of(arm, 2, 3, 1)), RecordError);
}

TEST_CASE("an input that the state tells is refused, and so is none", "[rhythm]") {
  Arm arm;
  arm.sway = 0.1;
  arm.feedback = 0.5;
  arm.hold = 1;
  const Rhythm fed = identify_rhythm(record_of(arm, 12, 8, 3));
  CHECK(fed.htf.empty());
  CHECK(fed.told > 0.8);
  CHECK(fed.refusal.find("fed back") != std::string::npos);
  arm.feedback = 0.0;
  const Rhythm none = identify_rhythm(record_of(arm, 12, 8, 3));
  CHECK(none.htf.empty());
  CHECK(none.refusal.find("excites nothing") != std::string::npos);
}

TEST_CASE("a walker let go near its gait: the multipliers are those of its limit cycle", "[rhythm]") {
  const CompassGait<> m;
  Random random(5);
  Record r;
  r.name = "walker";
  r.model = "compass_gait";
  r.chart_names = {"Swing"};
  for (const Quantity& q : CompassGait<>::outputs) r.outputs.push_back({std::string(q.name), std::string(q.unit), {}});
  const double sigma[4] = {1e-6, 1e-6, 1e-5, 1e-5};
  const Timebase base{2.0, 400};
  for (int e = 0; e < 24; ++e) {
    Run<CompassGait<>> run;
    run.at = start_of(m);
    int step_count = 1;
    std::int64_t events = 0;
    for (int n = 0; n < 3200; ++n) step(m, run, Vec<0>{}, base);
    while (step(m, run, Vec<0>{}, base).events == 0) continue;
    for (int i = 0; i < 4; ++i) run.at.x[i] *= 1.0 + 3e-4 * random.normal();  // little: its basin is small
    for (int n = 0; n < 1400 && step_count < 9; ++n) {
      const auto y = m.output(CompassGait<>::Swing{}, Vec<4>(run.at.x.head<4>()), Vec<0>{});
      r.experiment.push_back(e);
      r.cycle.push_back(step_count);
      r.chart.push_back(0);
      r.t.push_back(n * 0.005);
      for (int o = 0; o < 4; ++o)
        r.outputs[static_cast<std::size_t>(o)].values.push_back(y[o] + sigma[o] * random.normal());
      const auto s = step(m, run, Vec<0>{}, base);
      REQUIRE(usable(s.status));
      if (s.events > 0) ++step_count;
      events += s.events;
    }
    CHECK(events >= 8);
  }
  const Rhythm found = identify_rhythm(r);
  REQUIRE(found.multipliers.size() == 3);
  const Complex truth[3] = {{-0.199726126830, 0.544476062095}, {-0.199726126830, -0.544476062095}, 0.131572624077};
  for (std::size_t i = 0; i < 3; ++i) {
    CAPTURE(found.multipliers[i].value, found.multipliers[i].sigma);
    CHECK(found.multipliers[i].sigma < 0.03);
    CHECK(std::abs(found.multipliers[i].value - truth[i]) < 3.0 * found.multipliers[i].sigma);
  }
  CHECK(found.htf.empty());
  CHECK(found.refusal.find("no input") != std::string::npos);
}

TEST_CASE("the walking robot: seven walks tell how its gait attracts, and that its motor only follows its state",
          "[rhythm][measured]") {
  const Rhythm r =
      identify_rhythm(read_record(std::filesystem::path(SALTUS_TEST_DATA "/measured/compass-gait-walking.csv")));
  CHECK(r.charts == std::vector<std::string>{"outer", "inner"});
  CHECK(r.experiments == 7);
  REQUIRE(!r.multipliers.empty());
  CHECK(r.multipliers[0].high < 1.0);  // it walked on
  CHECK(r.multipliers[0].sigma < 0.3);
  CHECK(r.disagreement < 3.0 * r.multipliers[0].sigma);
  CHECK(r.period > 0.5);
  CHECK(r.htf.empty());
  CHECK(!r.refusal.empty());
}
