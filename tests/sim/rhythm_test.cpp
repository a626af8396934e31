// The rhythm of machines that pace themselves, from records with a known truth and from a real one.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/random.hpp"
#include "sim/rhythm.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/walks.hpp"

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

namespace {

// A swing that turns at one pace and whose size decays to 1: p = size cos(angle), and `loop` times a third harmonic.
// Nothing marks a cycle.
Record swings_of(double decay, double noise, double loop, std::uint64_t seed) {
  Random random(seed);
  Record r;
  r.name = "swing";
  r.outputs = {{"p", "m", {}}};
  for (int e = 0; e < 12; ++e) {
    const double off = 0.1 * random.normal(), begin = 2.0 * std::numbers::pi * random.uniform();
    for (int n = 0; n < 1300; ++n) {
      const double t = n * dt, angle = begin - 2.0 * std::numbers::pi * t;
      r.experiment.push_back(e);
      r.t.push_back(t);
      r.outputs[0].values.push_back((1.0 + off * std::exp(-decay * t)) *
                                        (std::cos(angle) + loop * std::sin(3.0 * angle)) +
                                    noise * random.normal());
    }
  }
  return r;
}

}  // namespace

TEST_CASE("without events the kinematic phase tells the multiplier, its interval as often right as it says",
          "[rhythm][kinematic]") {
  constexpr double decay = 0.5;  // [1/s] of turns of 1 s
  RhythmOptions o;
  o.kinematic = true;
  o.replicates = 100;
  int inside = 0;
  double mean = 0.0;
  constexpr int seeds = 16;
  for (int seed = 1; seed <= seeds; ++seed) {
    const Rhythm r = identify_rhythm(swings_of(decay, 2e-3, 0.0, static_cast<std::uint64_t>(seed)), o);
    REQUIRE(r.multipliers.size() == 1);
    CHECK(r.sections.size() == 8);
    CHECK(r.turns_refused == 0);
    CHECK(std::abs(r.period - 1.0) < 1e-3);
    inside += std::abs(r.multipliers[0].value.real() - std::exp(-decay)) < 1.96 * r.multipliers[0].sigma;
    mean += r.multipliers[0].value.real() / seeds;
  }
  CAPTURE(inside, mean);
  CHECK(inside >= 14);
  CHECK(std::abs(mean - std::exp(-decay)) < 0.01);
}

TEST_CASE("a phase that falls back within its turn, or jumps at every event, is refused and the reason is given",
          "[rhythm][kinematic]") {
  RhythmOptions o;
  o.kinematic = true;
  const auto refusal = [&](const Record& r) -> std::string {
    try {
      identify_rhythm(r, o);
    } catch (const RecordError& e) {
      return e.what();
    }
    return "none";
  };
  CHECK(refusal(swings_of(0.5, 1e-3, 0.4, 1)).find("of p it falls back in") != std::string::npos);
  Arm arm;  // turns through a chart, and begins again
  arm.sway = 0.01;
  CHECK(refusal(record_of(arm, 12, 8, 1)).find("no output has a phase that goes round") != std::string::npos);
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
  const Rhythm found = identify_rhythm(test::walks_of(CompassGait<>{}, {}));
  REQUIRE(found.multipliers.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    CAPTURE(found.multipliers[i].value, found.multipliers[i].sigma);
    CHECK(found.multipliers[i].sigma < 0.03);
    CHECK(std::abs(found.multipliers[i].value - test::compass_gait_multipliers[i]) < 3.0 * found.multipliers[i].sigma);
  }
  CHECK(found.htf.empty());
  CHECK(found.refusal.find("no input") != std::string::npos);
}

TEST_CASE("a walker of two legs: sections at its events and by its kinematic phase tell the same multipliers",
          "[rhythm][kinematic]") {
  test::Walks w;
  w.two_legs = true;
  w.experiments = 30;
  w.dt = 0.002;  // so that a parabola about a passage misses the third direction by less than that scatters
  w.sigma = 1e-7;
  const Record record = test::walks_of(CompassGait<>{}, w);
  const Rhythm events = identify_rhythm(record);
  RhythmOptions o;
  o.kinematic = true;
  const Rhythm turns = identify_rhythm(record, o);
  CAPTURE(turns.plane, turns.turns_refused);
  CHECK(turns.plane.find("hip about") == 0);  // the stance angle jumps at every event
  CHECK(turns.turns_refused == 0);
  CHECK(turns.sections.size() == 6);                                     // two more lie about the events
  CHECK(std::abs(turns.period - events.period) < 1e-3 * events.period);  // two steps, and one turn
  const Complex a = test::compass_gait_multipliers[0], b = test::compass_gait_multipliers[2];
  const Complex truth[3] = {a * a, std::conj(a * a), b * b};
  for (const Rhythm* r : {&events, &turns}) {
    REQUIRE(r->multipliers.size() == 3);
    for (const Complex& z : truth) {
      const auto nearest =
          std::min_element(r->multipliers.begin(), r->multipliers.end(),
                           [&](const auto& x, const auto& y) { return std::abs(x.value - z) < std::abs(y.value - z); });
      CAPTURE(r->plane, nearest->value, nearest->sigma, z);
      CHECK(nearest->sigma < 0.02);
      CHECK(std::abs(nearest->value - z) < 3.0 * nearest->sigma + 0.003);  // the map is not quite linear
    }
  }
}

TEST_CASE("where one direction of three is not told the errors of the others hold what that costs",
          "[rhythm][kinematic]") {
  test::Walks w;
  w.two_legs = true;
  const Complex a = test::compass_gait_multipliers[0];
  for (const bool kinematic : {false, true}) {
    for (const std::uint64_t seed : {1u, 2u}) {
      w.seed = seed;
      RhythmOptions o;
      o.replicates = 100;
      o.kinematic = kinematic;
      const Rhythm r = identify_rhythm(test::walks_of(CompassGait<>{}, w), o);
      CHECK(r.directions == 2);
      REQUIRE(r.multipliers.size() == 2);
      for (const RhythmMultiplier& m : r.multipliers) {
        CAPTURE(kinematic, seed, m.value, m.sigma);
        CHECK(std::min(std::abs(m.value - a * a), std::abs(m.value - std::conj(a * a))) < 2.5 * m.sigma);
        CHECK(m.sigma < 0.2);
      }
    }
  }
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
