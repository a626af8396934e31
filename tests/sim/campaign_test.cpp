#include "sim/campaign.hpp"

#include <algorithm>

#include "sim/models/hopper_orbit.hpp"
#include "sim/record_identification.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;

namespace {

constexpr int sections = 32;
using World = worlds::Metronome<>;

// The metronome in closed form: between its clock-set events x' = (drive or 0) - k x + u, at them x -> keep x. In
// deviations from the cycle it is linear: d[n+1] = a[n] d[n] + b[n] u[n].
struct Sampled {
  std::array<double, sections> a{}, b{};

  explicit Sampled(const World& m) {
    const double h = 1.0 / sections;
    for (int n = 0; n < sections; ++n) {
      const auto i = static_cast<std::size_t>(n);
      a[i] = std::exp(-m.k * h);
      b[i] = (1.0 - std::exp(-m.k * h)) / m.k;
      for (const double event : {m.shift / (2.0 * std::numbers::pi), 0.5 + m.shift / (2.0 * std::numbers::pi)}) {
        const double into = event - n * h;
        if (!(into > 0.0 && into <= h)) continue;
        a[i] *= m.keep;
        b[i] = m.keep * std::exp(-m.k * (h - into)) * (1.0 - std::exp(-m.k * into)) / m.k +
               (1.0 - std::exp(-m.k * (h - into))) / m.k;
      }
    }
  }

  // H_m at f [cycles a cycle], by brute force: the steady response to exp(2 pi i f n / N), one cycle of it.
  Complex htf(int m, double f) const {
    Complex d = 0.0, sum = 0.0;
    for (int n = 0; n < 81 * sections; ++n) {
      const auto i = static_cast<std::size_t>(n % sections);
      const double angle = 2.0 * std::numbers::pi * f * n / sections;
      if (n >= 80 * sections) sum += d * std::polar(1.0, -angle - 2.0 * std::numbers::pi * m * n / sections);
      d = a[i] * d + b[i] * std::polar(1.0, angle);
    }
    return sum / static_cast<double>(sections);
  }
};

World world() {
  World m;
  m.shift = 0.35;
  return m;
}

Plan small_plan(double amplitude = 0.3) {
  PlanOptions o;
  o.period = 8;
  o.band = 6.0;
  o.amplitude = amplitude;
  return make_plan(o);
}

// The metronome with two motors, which act on it differently before and after its event.
template <class S = double>
struct TwoMotors : worlds::Metronome<S> {
  using X = Vec<2, S>;
  using U = Vec<2, S>;
  static constexpr std::string_view name = "two_motors";
  static constexpr std::array inputs{Quantity{"u", "1/s"}, Quantity{"w", "N"}};

  X flow(worlds::metronome::Tick, const X& x, const U& u) const noexcept {
    return {this->drive - this->k * x[0] + u[0] + 3.0 * u[1], this->omega};
  }
  X flow(worlds::metronome::Tock, const X& x, const U& u) const noexcept {
    return {0.5 * u[0] - u[1] - this->k * x[0], this->omega};
  }
  S guard(worlds::metronome::Off, const X& x, const U&) const noexcept { return sin(x[1] - this->shift); }
  S guard(worlds::metronome::On, const X& x, const U&) const noexcept { return -sin(x[1] - this->shift); }
  template <class E>
  X reset(E, const X& x, const U&) const noexcept {
    return {this->keep * x[0], x[1]};
  }
  template <class C>
  Vec<1, S> output(C, const X& x, const U&) const noexcept {
    return Vec<1, S>(x[0]);
  }
};

// E |estimated - exact|^2 over its stated value, and the mean stated variance, over every estimate but the merged
// noise.
struct Scatter {
  double ratio = 0.0, variance = 0.0;
  int inside68 = 0, inside95 = 0, count = 0;
};
template <class Exact>
Scatter scatter(const Identification& id, Exact&& exact) {
  Scatter s;
  for (const HtfEstimate& h : id.htf) {
    const double z = std::norm(h.value - exact(h)) / (h.sigma * h.sigma);
    s.ratio += z;
    s.variance += h.sigma * h.sigma;
    s.inside68 += z < -std::log(1.0 - 0.68) ? 1 : 0;
    s.inside95 += z < -std::log(1.0 - 0.95) ? 1 : 0;
    ++s.count;
  }
  s.ratio /= s.count;
  s.variance /= s.count;
  return s;
}

}  // namespace

TEST_CASE("A machine in closed form is identified to rounding, by any harmonic at any line") {
  const World m = world();
  const Sampled truth(m);
  CampaignOptions o;
  o.settle = 40;
  o.harmonics = 8;
  const auto c = run_campaign(m, ClockPhases{sections}, small_plan(), o, nullptr, {});
  REQUIRE(c->id.worst == Status::ok);
  CHECK(std::abs(c->decay - m.keep * m.keep * std::exp(-m.k)) < 1e-10);
  CHECK(c->id.notes.empty());
  CHECK(c->id.htf.size() == 17u * 36u);  // the 47 lines below 6 less the 11 multiples of 1/2
  double worst = 0.0, beside = 0.0;
  for (const HtfEstimate& h : c->id.htf) {
    worst = std::max(worst, std::abs(h.value - truth.htf(h.m, h.line / 8.0)));
    beside = std::max(beside, std::abs(c->exact(h) - truth.htf(h.m, h.line / 8.0)));
    CHECK(h.cycles == 8);
    CHECK(std::isnan(h.sigma));
  }
  INFO(worst << ", exact " << beside);
  CHECK(worst < 1e-11);
  CHECK(beside < 1e-11);
}

TEST_CASE("Multiples of half the pumping frequency and the constant are identified to rounding, opposed or not") {
  const World m = world();
  const Sampled truth(m);
  for (const bool opposed : {false, true}) {
    for (const int period : {8, 7}) {
      PlanOptions p;
      p.period = period;
      p.band = 6.0;
      p.amplitude = 0.3;
      p.opposed = opposed;
      p.half_multiples = true;
      CampaignOptions o;
      o.settle = 40;
      o.harmonics = 8;
      o.jobs = 2;
      const auto c = run_campaign(m, ClockPhases{sections}, make_plan(p), o, nullptr, {});
      REQUIRE(c->id.worst == Status::ok);
      CHECK(c->id.notes.empty());
      REQUIRE(c->id.htf.size() == 17u * 6u * static_cast<unsigned>(period));  // every line from 0 on
      double worst = 0.0;
      for (const HtfEstimate& h : c->id.htf) {
        const Complex exact = truth.htf(h.m, static_cast<double>(h.line) / period);
        worst = std::max({worst, std::abs(h.value - exact), std::abs(c->exact(h) - exact)});
        const bool twice = h.line != 0 && 2 * h.line % period == 0;
        CHECK(h.cycles == period * (opposed ? 2 : 1) * (twice ? 2 : 1));
        if (h.line != 0 || h.m < 0) continue;
        for (const HtfEstimate& other : c->id.select(-h.m, 0)) {
          if (other.line == 0) CHECK(other.value == std::conj(h.value));
        }
      }
      INFO(period << " cycles: " << worst);
      CHECK(worst < 1e-11);
    }
  }
}

TEST_CASE("The hopper's half multiples and its constant are those of its linearised motion") {
  PlanOptions p;
  p.period = 16;
  p.band = 3.0;
  p.amplitude = 1e-4;
  p.opposed = true;
  p.half_multiples = true;
  const Hopper<> m;
  const auto c = run_campaign(m, ClockPhases{sections}, make_plan(p), {}, nullptr, {});
  REQUIRE(c->id.worst == Status::ok);
  REQUIRE(c->id.htf.size() == 7u * 2u * 48u);
  double size[2] = {}, error[2] = {};
  for (const HtfEstimate& h : c->id.htf) {
    const auto output = static_cast<std::size_t>(h.output);
    if (h.m == 0) size[output] = std::max(size[output], std::abs(c->exact(h)));
    if (2 * h.line % 16 == 0) error[output] = std::max(error[output], std::abs(h.value - c->exact(h)));
  }
  for (const std::size_t output : {0u, 1u}) {
    INFO(error[output] << " of " << size[output]);
    CHECK(error[output] < 1e-6 * size[output]);
  }
}

TEST_CASE("Several experiments at a time give the bits of one after the other, and the record in their order") {
  const World m = world();
  PlanOptions p;
  p.period = 8;
  p.band = 6.0;
  p.amplitude = 0.3;
  p.subsets = 13;  // no multiple of the jobs
  const Plan plan = make_plan(p);
  const auto run = [&](int jobs, Record& record) {
    CampaignOptions o;
    o.settle = 5;
    o.periods = 3;
    o.noise = {1e-3};
    o.watch = {1e-3};
    o.jobs = jobs;
    record.inputs = {{"u", "1/s", {}}};
    record.outputs = {{"x", "-", {}}};
    return run_campaign(m, ClockPhases{sections}, plan, o, &record, {});
  };
  Record one_by_one, together;
  const auto a = run(1, one_by_one), b = run(3, together);
  REQUIRE(a->id.worst == Status::ok);
  REQUIRE(a->id.htf.size() == b->id.htf.size());
  REQUIRE(a->id.htf.size() > 100u);
  CHECK(a->id.watched);
  CHECK(a->id.samples == b->id.samples);
  CHECK(a->id.drifts.size() == b->id.drifts.size());
  bool same = true;
  for (std::size_t i = 0; i < a->id.htf.size(); ++i) {
    const HtfEstimate &x = a->id.htf[i], &y = b->id.htf[i];
    same = same && x.m == y.m && x.line == y.line && x.output == y.output && x.value == y.value && x.sigma == y.sigma;
  }
  CHECK(same);
  CHECK(one_by_one.experiment == together.experiment);
  CHECK(one_by_one.t == together.t);
  CHECK(one_by_one.inputs[0].values == together.inputs[0].values);
  CHECK(one_by_one.outputs[0].values == together.outputs[0].values);
}

TEST_CASE("Experiments side by side in lanes give the bits of one after the other") {
  PlanOptions p;
  p.period = 8;
  p.band = 4.0;
  p.subsets = 11;  // no multiple of the lanes
  p.amplitude = 0.05;
  const Plan plan = make_plan(p);
  for (const double noise : {0.0, 1e-3}) {
    const auto run = [&](bool lanes, int jobs, Record& record) {
      CampaignOptions o;
      o.ticks = 64;
      o.settle = 6;
      o.ramp = 3;
      o.periods = 2;
      if (noise > 0.0) o.noise = o.watch = {noise, noise};
      o.lanes = lanes;
      o.jobs = jobs;
      record.inputs = {{"u", "N", {}}};
      record.outputs = {{"y_M", "m", {}}, {"v_M", "m/s", {}}};
      return run_campaign(Hopper<>{}, ClockPhases{sections}, plan, o, &record, {});
    };
    Record alone, beside, on_two;
    const auto a = run(false, 1, alone), b = run(true, 1, beside), c = run(true, 2, on_two);
    REQUIRE(a->id.worst == Status::ok);
    REQUIRE(a->id.htf.size() > 100u);
    for (const auto* other : {&b, &c}) {
      const Identification& id = (*other)->id;
      REQUIRE(a->id.htf.size() == id.htf.size());
      CHECK(a->id.worst == id.worst);
      CHECK(a->id.drifts.size() == id.drifts.size());
      bool same = true;
      for (std::size_t i = 0; i < id.htf.size(); ++i) {
        const HtfEstimate &x = a->id.htf[i], &y = id.htf[i];
        same = same && x.line == y.line && x.value == y.value && (x.sigma == y.sigma || noise == 0.0);
      }
      CHECK(same);
    }
    for (const Record* other : {&beside, &on_two}) {
      CHECK(alone.experiment == other->experiment);
      CHECK(alone.inputs[0].values == other->inputs[0].values);
      CHECK(alone.outputs[0].values == other->outputs[0].values);
      CHECK(alone.outputs[1].values == other->outputs[1].values);
    }
  }
}

TEST_CASE("A machine that is lost in a lane ends the campaign as it does alone") {
  PlanOptions p;
  p.period = 8;
  p.band = 4.0;
  p.amplitude = 30.0;
  const Plan plan = make_plan(p);
  CampaignOptions o;
  o.ticks = 64;
  o.settle = 5;
  const auto beside = run_campaign(Hopper<>{}, ClockPhases{sections}, plan, o, nullptr, {});
  o.lanes = false;
  const auto alone = run_campaign(Hopper<>{}, ClockPhases{sections}, plan, o, nullptr, {});
  CHECK(!usable(alone->id.worst));
  CHECK(beside->id.worst == alone->id.worst);
  CHECK(beside->id.htf.size() == alone->id.htf.size());
}

TEST_CASE("Progress rises to one, and the record holds every sample of every experiment") {
  const World m = world();
  const Plan plan = small_plan();
  CampaignOptions o;
  o.settle = 3;
  o.periods = 2;
  Record record;
  record.inputs = {{"u", "1/s", {}}};
  record.outputs = {{"x", "-", {}}};
  std::vector<double> progress;
  const auto c = run_campaign(m, ClockPhases{sections}, plan, o, &record, [&](double x) { progress.push_back(x); });
  REQUIRE(c->id.worst == Status::ok);
  CHECK(progress.size() == plan.experiments.size());
  CHECK(std::is_sorted(progress.begin(), progress.end()));
  CHECK(progress.back() == 1.0);
  CHECK(c->id.samples == static_cast<std::int64_t>(plan.experiments.size()) * 2 * 8 * sections);

  const std::size_t length = (3 + 2 * 8) * sections;
  REQUIRE(record.rows() == plan.experiments.size() * length);
  for (std::size_t row = 0; row < record.rows(); ++row) {
    const std::size_t n = row % length;
    const auto& u = plan.experiments[row / length];
    if (record.experiment[row] != static_cast<int>(row / length) || record.cycle[row] != static_cast<int>(n / 32) ||
        record.section[row] != static_cast<int>(n % 32) || record.t[row] != static_cast<double>(n) / 32.0 ||
        std::abs(record.inputs[0].values[row] - u(static_cast<std::int64_t>(n))) > 1e-14) {
      FAIL("row " << row);
    }
  }
  // 3 settling cycles leave 0.3^3 of the transient, and that is said.
  REQUIRE(c->id.notes.size() == 1);
  CHECK(c->id.notes[0] == "after 3 settling cycles 2.6e-02 of the first transient is left; 8 leave 1e-4");
}

TEST_CASE("An estimate is within its standard error as often as it says, and four times the data halve it") {
  const World m = world();
  const Sampled truth(m);
  const auto exact = [&](const HtfEstimate& h) { return truth.htf(h.m, h.line / 8.0); };
  CampaignOptions o;
  o.settle = 20;
  o.noise = {0.05};
  double variance = 0.0, scattered = 0.0;
  for (const int periods : {2, 8}) {
    Scatter sum;
    for (o.seed = 1; o.seed <= 4; ++o.seed) {
      o.periods = periods;
      const auto c = run_campaign(m, ClockPhases{sections}, small_plan(), o, nullptr, {});
      const Scatter s = scatter(c->id, exact);
      sum.ratio += s.ratio / 4.0;
      sum.variance += s.variance / 4.0;
      sum.inside68 += s.inside68;
      sum.inside95 += s.inside95;
      sum.count += s.count;
    }
    INFO(periods << " periods");
    REQUIRE(sum.count == 4 * 7 * 36);
    // White noise on lines that are orthogonal: 1008 independent errors. Their standard error is pooled over 48 lines
    // or more, each of periods - 1 degrees of freedom: good to 7 % with two periods, in pools that some 50 estimates
    // share. That adds 0.011 to the binomial 0.015 at 68 %, 0.004 to 0.007 at 95 %. Bounds of four standard deviations.
    CHECK(std::abs(sum.inside68 / 1008.0 - 0.68) < 0.075);
    CHECK(std::abs(sum.inside95 / 1008.0 - 0.95) < 0.033);
    CHECK(std::abs(sum.ratio - 1.0) < 0.18);
    if (periods == 8) {
      CHECK(std::abs(std::sqrt(sum.variance / variance) - 0.5) < 0.03);
      CHECK(std::abs(std::sqrt(sum.variance * sum.ratio / scattered) - 0.5) < 0.06);
      // White noise of sigma on L samples: E|Y|^2 = sigma^2 / L, H = Y / (a/2), 8 repeats.
      CHECK(std::abs(sum.variance / (0.05 * 0.05 / 256.0 / (0.15 * 0.15) / 8.0) - 1.0) < 0.05);
    }
    variance = sum.variance;
    scattered = sum.variance * sum.ratio;
  }
}

TEST_CASE("Half multiples are within their standard errors as often as these say") {
  const World m = world();
  const Sampled truth(m);
  PlanOptions p;
  p.period = 8;
  p.band = 6.0;
  p.amplitude = 0.3;
  p.half_multiples = true;
  CampaignOptions o;
  o.settle = 20;
  o.periods = 8;
  o.noise = {0.05};
  int inside68 = 0, inside95 = 0, count = 0;
  double ratio = 0.0;
  for (const bool opposed : {false, true}) {
    p.opposed = opposed;
    const Plan plan = make_plan(p);
    for (o.seed = 1; o.seed <= 5; ++o.seed) {
      const auto c = run_campaign(m, ClockPhases{sections}, plan, o, nullptr, {});
      for (const HtfEstimate& h : c->id.htf) {
        if (2 * h.line % 8 != 0 || h.line == 0) continue;
        const double z = std::norm(h.value - truth.htf(h.m, h.line / 8.0)) / (h.sigma * h.sigma);
        ratio += z;
        inside68 += z < -std::log(1.0 - 0.68) ? 1 : 0;
        inside95 += z < -std::log(1.0 - 0.95) ? 1 : 0;
        ++count;
      }
    }
  }
  REQUIRE(count == 10 * 7 * 11);
  // 770 complex errors of mean square one: the binomial's standard deviations are 0.0168 and 0.0079. Opposed plays, or
  // two a quarter turn apart, leave errors that do not correlate; those that share an estimate of the machine's own
  // cycle do a little, and so do the pooled standard errors, good to 3 %: half as much again. Four standard deviations.
  INFO(inside68 << ", " << inside95 << " of " << count << ", mean square " << ratio / count);
  CHECK(std::abs(inside68 / static_cast<double>(count) - 0.68) < 4.0 * 1.5 * 0.0168);
  CHECK(std::abs(inside95 / static_cast<double>(count) - 0.95) < 4.0 * 1.5 * 0.0079);
  CHECK(std::abs(ratio / count - 1.0) < 4.0 * 1.5 / std::sqrt(770.0));
}

TEST_CASE("Two inputs are identified by orthogonal plays, and from the record of them") {
  const TwoMotors<> m;
  CampaignOptions o;
  o.settle = 40;
  PlanOptions p;
  p.period = 8;
  p.band = 4.0;
  p.amplitude = 0.3;
  p.inputs = 2;
  p.share = {1.0, 0.25};
  for (const bool half_multiples : {false, true}) {
    p.half_multiples = half_multiples;
    const Plan plan = make_plan(p);
    CHECK(plan.experiments.size() == 16u);
    Record record;
    record.sections = "clock";
    record.sections_per_cycle = sections;
    record.stimulus_period_cycles = 8;
    record.settle_cycles = 40;
    record.inputs = {{"u", "1/s", {}}, {"w", "N", {}}};
    record.outputs = {{"x", "-", {}}};
    const auto c = run_campaign(m, ClockPhases{sections}, plan, o, &record, {});
    REQUIRE(c->id.worst == Status::ok);
    REQUIRE(c->id.htf.size() == 2u * 7u * (half_multiples ? 32u : 24u));
    CHECK(c->id.condition < (half_multiples ? 10.0 : 1.0 + 1e-9));  // the own cycle is no orthogonal input
    double worst = 0.0, apart = 0.0;
    for (const HtfEstimate& h : c->id.htf) {
      worst = std::max(worst, std::abs(h.value - c->exact(h)));
      for (const HtfEstimate& other : c->id.select(h.m, 0, 1 - h.input)) {
        if (other.line == h.line) apart = std::max(apart, std::abs(other.value - h.value));
      }
    }
    INFO(worst);
    CHECK(worst < 1e-11);
    CHECK(apart > 0.1);
    const Identification id = identify_record(record, o.harmonics);
    REQUIRE(id.htf.size() == c->id.htf.size());
    for (std::size_t i = 0; i < id.htf.size(); ++i) {
      CHECK(id.htf[i].line == c->id.htf[i].line);
      CHECK(id.htf[i].input == c->id.htf[i].input);
      CHECK(std::abs(id.htf[i].value - c->id.htf[i].value) < 1e-11);
    }
  }
}

TEST_CASE("Opposed pairs cancel what is even in the stimulus") {
  PlanOptions p;
  p.period = 16;
  p.band = 2.0;
  p.amplitude = 0.05;
  const Hopper<> m;
  CampaignOptions o;
  double error[2] = {};
  for (const bool opposed : {false, true}) {
    p.opposed = opposed;
    const auto c = run_campaign(m, ClockPhases{sections}, make_plan(p), o, nullptr, {});
    REQUIRE(c->id.worst == Status::ok);
    for (const HtfEstimate& h : c->id.htf) {
      if (h.m == 0) error[opposed ? 1 : 0] += std::norm(h.value - c->exact(h));
      CHECK(h.cycles == (opposed ? 32 : 16));
    }
  }
  CHECK(std::sqrt(error[1]) < 0.2 * std::sqrt(error[0]));
}

TEST_CASE("There is no campaign without a cycle, nor around one that does not attract") {
  Hopper<> m;
  m.b = 0.0;
  const auto none = run_campaign(m, ClockPhases{sections}, small_plan(), {}, nullptr, {});
  CHECK(none->orbit.status != Status::ok);
  CHECK(none->id.worst == none->orbit.status);
  CHECK(none->id.htf.empty());

  m = {};
  m.a = 4.0;  // stays on the ground, a mass on a spring without a damper
  const auto neutral = run_campaign(m, ClockPhases{sections}, small_plan(), {}, nullptr, {});
  CHECK(neutral->orbit.status == Status::ok);
  CHECK(std::abs(neutral->decay - 1.0) < 1e-6);
  CHECK(neutral->id.worst == Status::failed);
  CHECK(neutral->id.htf.empty());
}

TEST_CASE("A machine thrown off its cycle ends the campaign with its status") {
  const Hopper<> m;
  CampaignOptions o;
  Record record;
  record.inputs = {{"u", "N", {}}};
  record.outputs = {{"y_M", "m", {}}, {"v_M", "m/s", {}}};
  const auto c = run_campaign(m, ClockPhases{sections}, small_plan(1e6), o, &record, {});
  CHECK(c->orbit.status == Status::ok);
  CHECK_FALSE(usable(c->id.worst));
  CHECK(c->id.htf.empty());
}

TEST_CASE("A record saved in memory is identified as the campaign was") {
  const World m = world();
  CampaignOptions o;
  o.settle = 30;
  o.periods = 4;
  o.noise = {0.01};
  for (const bool half_multiples : {false, true}) {
    PlanOptions p;
    p.period = 8;
    p.band = 6.0;
    p.amplitude = 0.3;
    p.half_multiples = half_multiples;
    Record record;
    record.sections = "clock";
    record.sections_per_cycle = sections;
    record.stimulus_period_cycles = 8;
    record.settle_cycles = 30;
    record.inputs = {{"u", "1/s", {}}};
    record.outputs = {{"x", "-", {}}};
    const auto c = run_campaign(m, ClockPhases{sections}, make_plan(p), o, &record, {});
    const Identification id = identify_record(record, o.harmonics);
    CHECK(c->id.htf.size() == 7u * (half_multiples ? 48u : 36u));
    REQUIRE(id.htf.size() == c->id.htf.size());
    for (std::size_t i = 0; i < id.htf.size(); ++i) {
      CHECK(id.htf[i].line == c->id.htf[i].line);
      CHECK(id.htf[i].m == c->id.htf[i].m);
      CHECK(std::abs(id.htf[i].value - c->id.htf[i].value) < 1e-12);
      CHECK(std::abs(id.htf[i].sigma / c->id.htf[i].sigma - 1.0) < 1e-9);
    }
  }
}
