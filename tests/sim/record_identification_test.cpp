#include "sim/record_identification.hpp"

#include <algorithm>
#include <map>
#include <memory>
#include <numbers>

#include "core/random.hpp"
#include "sim/plan.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/htf_table.hpp"

using namespace saltus;

namespace {

const Record& measured() {
  static const Record record = read_record(std::filesystem::path(SALTUS_TEST_DATA) / "hopper/open-none.csv");
  return record;
}

// The rows for which keep(experiment, cycle, section) holds.
template <class Keep>
Record filtered(const Record& r, Keep&& keep) {
  Record s = r;
  std::size_t to = 0;
  for (std::size_t i = 0; i < r.rows(); ++i) {
    if (!keep(r.experiment[i], r.cycle[i], r.section[i])) continue;
    s.experiment[to] = r.experiment[i];
    s.cycle[to] = r.cycle[i];
    s.section[to] = r.section[i];
    s.t[to] = r.t[i];
    for (std::size_t c = 0; c < r.inputs.size(); ++c) s.inputs[c].values[to] = r.inputs[c].values[i];
    for (std::size_t c = 0; c < r.outputs.size(); ++c) s.outputs[c].values[to] = r.outputs[c].values[i];
    ++to;
  }
  s.experiment.resize(to);
  s.cycle.resize(to);
  s.section.resize(to);
  s.t.resize(to);
  for (Channel& c : s.inputs) c.values.resize(to);
  for (Channel& c : s.outputs) c.values.resize(to);
  return s;
}

// |H - H_exact|^2 / sigma^2 of every estimate: exponential of mean 1 where sigma is right.
std::vector<double> scores(const Identification& id) {
  std::vector<double> z;
  for (const HtfEstimate& h : id.htf) {
    const auto& exact = test::reference_isochrons().at(h.m, h.line, h.output == 0 ? "y_M" : "v_M");
    z.push_back(std::norm(h.value - exact.value) / (h.sigma * h.sigma));
  }
  std::sort(z.begin(), z.end());
  return z;
}

double share_below(const std::vector<double>& z, double p) {
  const double bound = -std::log(1.0 - p);
  return static_cast<double>(std::count_if(z.begin(), z.end(), [bound](double x) { return x <= bound; })) /
         static_cast<double>(z.size());
}

// A machine whose response is known: y[n] = 1 + gain[n mod N] (u[n-1] + u[n-3] / 2), of 8 sections.
constexpr int sections = 8, period = 16, length = sections * period;
double gain(std::int64_t n) { return 1.0 + 0.5 * std::cos(2.0 * std::numbers::pi * static_cast<double>(n) / sections); }
Complex exact(int m, double f) {
  const double w = 2.0 * std::numbers::pi * f / sections;
  const Complex lag = std::polar(1.0, -w) + 0.5 * std::polar(1.0, -3.0 * w);
  return m == 0 ? lag : std::abs(m) == 1 ? 0.25 * lag : 0.0;
}

// One experiment of it, from `first_cycle` on, answering to a periodic stimulus that began long ago.
template <class U>
void play(Record& r, int experiment, int first_cycle, int cycles, const U& u, double noise = 0.0,
          Random* random = nullptr) {
  for (std::int64_t n = std::int64_t{first_cycle} * sections; n < std::int64_t{first_cycle + cycles} * sections; ++n) {
    r.experiment.push_back(experiment);
    r.cycle.push_back(static_cast<int>(n / sections));
    r.section.push_back(static_cast<int>(n % sections));
    r.t.push_back(static_cast<double>(n) / sections);
    r.inputs[0].values.push_back(u(n));
    const double e = random == nullptr ? 0.0 : noise * random->normal();
    r.outputs[0].values.push_back(1.0 + gain(n) * (u(n - 1) + 0.5 * u(n - 3)) + e);
  }
}
Record blank(int settle = 0) {
  Record r;
  r.name = "made.csv";
  r.sections = "clock";
  r.sections_per_cycle = sections;
  r.stimulus_period_cycles = period;
  r.settle_cycles = settle;
  r.inputs = {{"u", "N", {}}};
  r.outputs = {{"y", "m", {}}};
  return r;
}
Multisine<8> tones(std::initializer_list<int> lines, double phase = 0.3) {
  Multisine<8> s(length);
  for (const int q : lines) {
    REQUIRE(s.add({q, 0.2, phase * q}));
  }
  return s;
}
double worst_error(const Identification& id) {
  double worst = 0.0;
  for (const HtfEstimate& h : id.htf) {
    worst = std::max(worst, std::abs(h.value - exact(h.m, static_cast<double>(h.line) / period)));
  }
  return worst;
}

std::string refusal(const Record& r) {
  try {
    identify_record(r, 3);
  } catch (const RecordError& e) {
    return e.what();
  }
  return "accepted";
}

}  // namespace

TEST_CASE("Every line of the measured record is within its standard error as often as it should be") {
  const Identification id = identify_record(measured(), 3);
  REQUIRE(id.htf.size() == 84 * 7 * 2);
  CHECK(id.noise_known());
  CHECK(id.missing == 0);
  const std::vector<double> z = scores(id);
  // The noise is white, so that errors on different output lines are independent: tones of one experiment answer on
  // lines of their own, and so do the harmonics of one tone. 1176 independent errors scatter the shares by 0.0136 and
  // 0.0064. What is shared is sigma: pooled over 48 lines of 3 degrees of freedom, so good to 4 %, 8 % of its square,
  // in some 24 pools. That shifts a share by c exp(-c) 0.08 / sqrt(24), c = -ln(1 - p): 0.006 and 0.0025. Four standard
  // deviations.
  CHECK(std::abs(share_below(z, 0.68) - 0.68) < 4.0 * std::hypot(0.0136, 0.006));
  CHECK(std::abs(share_below(z, 0.95) - 0.95) < 4.0 * std::hypot(0.0064, 0.0025));
  // Uniform all over: Kolmogorov and Smirnov's distance, 0.1 % point, widened by the same.
  double distance = 0.0;
  for (std::size_t i = 0; i < z.size(); ++i) {
    const double p = 1.0 - std::exp(-z[i]);
    distance = std::max(
        {distance, std::abs(p - static_cast<double>(i) / 1176.0), std::abs(p - static_cast<double>(i + 1) / 1176.0)});
  }
  CHECK(distance < 1.95 / std::sqrt(1176.0) + 0.006);
}

TEST_CASE("Half of the measured periods make the standard errors larger by the root of two, still true") {
  const Identification all = identify_record(measured(), 3);
  const Identification half = identify_record(filtered(measured(), [](int, int cycle, int) { return cycle < 168; }), 3);
  REQUIRE(half.htf.size() == all.htf.size());
  double a = 0.0, b = 0.0;
  for (std::size_t i = 0; i < all.htf.size(); ++i) {
    a += std::pow(all.htf[i].sigma, 2);
    b += std::pow(half.htf[i].sigma, 2);
    CHECK(half.htf[i].cycles == 128);
  }
  CHECK(std::abs(std::sqrt(b / a) - std::sqrt(2.0)) < 0.07);
  CHECK(std::abs(share_below(scores(half), 0.68) - 0.68) < 0.075);
  CHECK(std::abs(share_below(scores(half), 0.95) - 0.95) < 0.035);
}

TEST_CASE("Missing measurements cost no truth, whichever are missing") {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    Random random(seed);
    Record r = filtered(measured(), [&](int, int, int) { return random.uniform() > 0.005; });
    for (Channel& c : r.outputs) {
      for (double& y : c.values) {
        if (random.uniform() < 0.005) y = std::nan("");
      }
    }
    const Identification id = identify_record(r, 3);
    REQUIRE(id.htf.size() == 84 * 7 * 2);
    CHECK(id.worst == Status::missing);
    CHECK(id.samples == 57344);
    CHECK(std::abs(static_cast<double>(id.missing) / 57344.0 - 0.015) < 0.003);
    CHECK(id.notes.empty());
    const auto z = scores(id);
    CHECK(std::abs(share_below(z, 0.68) - 0.68) < 0.065);
    CHECK(std::abs(share_below(z, 0.95) - 0.95) < 0.03);
  }
}

TEST_CASE("A response known in closed form is found to rounding, wherever the record begins") {
  for (const int first : {0, 1, 5, 16, 100}) {
    for (const int settle : {0, 3}) {
      INFO("from cycle " << first << ", settling " << settle);
      Record r = blank(settle);
      const auto a = tones({1, 5, 23, 30}), b = tones({2, 9, 44});
      play(r, 3, first, 40, a);
      play(r, 4, first, 23, b);
      const Identification id = identify_record(r, 3);
      CHECK(id.htf.size() == 7 * 7);
      CHECK(worst_error(id) < 1e-13);
      // The second experiment has one whole period whatever is left out, the first two.
      for (const HtfEstimate& h : id.htf) CHECK(h.cycles == (h.line == 2 || h.line == 9 || h.line == 44 ? 16 : 32));
      CHECK(id.notes.size() == (settle > 0 && first >= settle ? 2u : 0u));
    }
  }
}

TEST_CASE("More tones than the estimator takes at once are identified all the same") {
  Record r = blank();
  r.sections_per_cycle = 8;
  r.stimulus_period_cycles = 400;
  constexpr int long_period = 400, total = 8 * long_period;
  const auto u = [](std::int64_t n) {
    double sum = 0.0;
    for (int q = 1; q <= 199; ++q) {  // one of each class
      const std::int64_t turn = ((n % total) + total) % total * q % total;
      sum += 0.01 * std::cos(2.0 * std::numbers::pi * static_cast<double>(turn) / total + 0.37 * q * q);
    }
    return sum;
  };
  std::map<std::int64_t, double> table;
  for (std::int64_t n = -3; n < total; ++n) table[n] = u(n);
  play(r, 0, 0, long_period, [&](std::int64_t n) { return table.at(n); });
  const Identification id = identify_record(r, 1);
  CHECK(id.htf.size() == 199 * 3);
  double worst = 0.0;
  for (const HtfEstimate& h : id.htf) {
    worst = std::max(worst, std::abs(h.value - exact(h.m, static_cast<double>(h.line) / long_period)));
  }
  CHECK(worst < 1e-11);
}

TEST_CASE("A line measured in two experiments is one estimate of a smaller error") {
  Random random(11);
  Record r = blank();
  const auto u = tones({3, 21, 28});
  play(r, 0, 0, 8 * period, u, 0.01, &random);
  const Identification once = identify_record(r, 3);
  play(r, 1, 0, 8 * period, u, 0.01, &random);
  const Identification twice = identify_record(r, 3);
  REQUIRE(once.htf.size() == 21);
  REQUIRE(twice.htf.size() == 21);
  double a = 0.0, b = 0.0;
  for (std::size_t i = 0; i < 21; ++i) {
    CHECK(twice.htf[i].cycles == 2 * once.htf[i].cycles);
    a += std::pow(once.htf[i].sigma, 2);
    b += std::pow(twice.htf[i].sigma, 2);
  }
  CHECK(std::abs(std::sqrt(a / b) - std::sqrt(2.0)) < 0.15);
}

TEST_CASE("Inputs that no row tells are taken from their repeats") {
  Record r = blank();
  const auto u = tones({3, 21, 28});
  play(r, 0, 0, 3 * period, u);
  for (std::size_t i = 0; i < r.rows(); i += 7) r.inputs[0].values[i] = std::nan("");
  CHECK(worst_error(identify_record(r, 3)) < 1e-13);
}

TEST_CASE("Tones that answer on each other's lines are left out and named") {
  Record r = blank();
  play(r, 5, 0, 2 * period, tones({3, 13, 21, 8, 16, 28}));  // 3 + 13 = 16; 8 and 16 are of the pump
  const Identification id = identify_record(r, 3);
  std::vector<int> lines;
  for (const HtfEstimate& h : id.select(0, 0)) lines.push_back(h.line);
  CHECK(lines == std::vector<int>{21, 28});
  CHECK(worst_error(id) < 1e-13);
  REQUIRE(id.notes.size() == 3);
  CHECK(id.notes[0].find("experiment 5: left out 2 tone(s) of class 3 (lines 3 13)") == 0);
  CHECK(id.notes[1].find("left out 1 multiple(s) of the pumping frequency (lines 16)") == 0);
  CHECK(id.notes[2].find("left out 1 multiple(s) of half the pumping frequency (lines 8)") == 0);
}

TEST_CASE("Multiples of half the pumping frequency are found where experiments tell them from their mirror images") {
  // Turned by a quarter in the second play; line 16 lies on the machine's own cycle, which is 1 here.
  const auto turned = [](double phase, double sign, double constant = 0.0) {
    Multisine<8> s(length);
    for (const int q : {5, 8, 16}) {
      REQUIRE(s.add({q, sign * 0.2, q == 5 ? 0.4 : 0.9 + phase}));
    }
    REQUIRE(s.add({0, constant, 0.0}));
    return s;
  };
  const double quarter = 0.5 * std::numbers::pi;
  const auto lines = [](const Identification& id) {
    std::vector<int> all;
    for (const HtfEstimate& h : id.select(0, 0)) all.push_back(h.line);
    return all;
  };
  Record r = blank();
  play(r, 0, 3, 2 * period, turned(0.0, 1.0));
  play(r, 1, 0, 3 * period, turned(quarter, 1.0));
  Identification id = identify_record(r, 3);
  CHECK(lines(id) == std::vector<int>{5, 8});  // the cycle is not known
  CHECK(worst_error(id) < 1e-13);
  REQUIRE(id.notes.size() == 1);
  CHECK(id.notes[0] ==
        "left out 1 multiple(s) of the pumping frequency (lines 16): play each twice, a quarter turn apart, and one "
        "experiment without them or all with both signs");

  Record silent = r;
  play(silent, 2, 0, period, tones({5}));
  id = identify_record(silent, 3);
  CHECK(lines(id) == std::vector<int>{5, 8, 16});
  CHECK(worst_error(id) < 1e-13);
  CHECK(id.notes.empty());

  Record opposed = r;
  play(opposed, 2, 0, 2 * period, turned(0.0, -1.0));
  play(opposed, 3, 0, 2 * period, turned(quarter, -1.0));
  id = identify_record(opposed, 3);
  CHECK(lines(id) == std::vector<int>{5, 8, 16});
  CHECK(worst_error(id) < 1e-13);
  CHECK(id.notes.empty());

  // A constant that changes is a tone on line 0; one that does not is part of the cycle.
  Record steps = opposed;
  play(steps, 4, 0, period, turned(0.0, 1.0, 0.1));
  id = identify_record(steps, 3);
  CHECK(lines(id) == std::vector<int>{0, 5, 8, 16});
  CHECK(worst_error(id) < 1e-13);
  for (double& u : steps.inputs[0].values) u += 0.7;
  id = identify_record(steps, 3);
  CHECK(lines(id) == std::vector<int>{0, 5, 8, 16});
  CHECK(worst_error(id) < 1e-12);
  for (double& u : opposed.inputs[0].values) u += 0.7;
  CHECK(lines(identify_record(opposed, 3)) == std::vector<int>{5, 8, 16});
}

TEST_CASE("What is no experiment on a clock is refused by the record's name, with the mend") {
  const auto good = [] {
    Record r = blank();
    play(r, 0, 0, 2 * period, tones({3, 21}));
    return r;
  };
  CHECK(refusal(good()) == "accepted");
  const auto spoilt = [&](auto&& spoil) {
    Record r = good();
    spoil(r);
    const std::string words = refusal(r);
    CHECK(words.find("made.csv: ") == 0);
    CHECK(words.find("; ") != words.npos);
    return words;
  };
  const auto has = [](const std::string& words, const char* part) {
    INFO(words);
    CHECK(words.find(part) != words.npos);
  };
  has(spoilt([](Record& r) { r.sections = "touchdown"; }), "not paced by a clock");
  has(spoilt([](Record& r) { r.sections_per_cycle.reset(); }), "not paced by a clock");
  has(spoilt([](Record& r) { r.stimulus_period_cycles.reset(); }), "it names no stimulus period");
  has(spoilt([](Record& r) { r.stimulus_period_cycles = 33; }), "no experiment has a whole stimulus period");
  has(spoilt([](Record& r) { r.stimulus_period_cycles = 513; }), "512 cycles a stimulus period");
  has(spoilt([](Record& r) { r.stimulus_period_cycles = 15; }), "does not repeat with the stimulus period");
  has(spoilt([](Record& r) { r.settle_cycles = 17; }), "no experiment has a whole stimulus period");
  has(spoilt([](Record& r) { r.settle_cycles = 1 << 30; }), "no experiment has a whole stimulus period");
  has(spoilt([](Record& r) { r.inputs.push_back({"w", "N", r.inputs[0].values}); }), "can be told apart");
  has(spoilt([](Record& r) { r.inputs.clear(); }), "it has no input");
  has(spoilt([](Record& r) { std::fill(r.inputs[0].values.begin(), r.inputs[0].values.end(), 0.7); }), "excites");
  has(spoilt([](Record& r) { std::fill(r.inputs[0].values.begin(), r.inputs[0].values.end(), std::nan("")); }),
      "inputs that no repeat tells");
  has(spoilt([](Record& r) { r.inputs[0].values[100] += 0.01; }), "does not repeat");
  has(spoilt([](Record& r) { std::fill(r.outputs[0].values.begin(), r.outputs[0].values.end(), std::nan("")); }),
      "nothing was measured of y");
  const Record clash = [] {
    Record r = blank();
    play(r, 0, 0, 2 * period, tones({3, 13}));
    return r;
  }();
  has(refusal(clash), "no experiment excites the machine on lines that can be told apart");
}

TEST_CASE("Harmonics that a sampled cycle cannot tell apart are not made up") {
  Record r = blank();
  play(r, 0, 0, 2 * period, tones({3, 21}));
  int highest = 0;
  for (const HtfEstimate& h : identify_record(r, 8).htf) highest = std::max(highest, std::abs(h.m));
  CHECK(highest == 3);  // of 8 sections: H_4 and H_-4 are one
}
