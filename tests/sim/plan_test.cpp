#include "sim/plan.hpp"

#include <map>
#include <numbers>
#include <set>
#include <stdexcept>

#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

std::string refusal(const PlanOptions& o) {
  try {
    make_plan(o);
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "accepted";
}

}  // namespace

TEST_CASE("A plan plays every line once, its opposites not counted") {
  for (const bool opposed : {false, true}) {
    PlanOptions o;
    o.opposed = opposed;
    const Plan plan = make_plan(o);
    CHECK(plan.lines() == 620);
    CHECK(plan.bound.size == 20);
    CHECK(plan.experiments.size() == (opposed ? 40 : 20));
    std::multiset<int> lines;
    for (const auto& e : plan.experiments) {
      CHECK(e.samples() == 32 * 64);
      for (int k = 0; k < e.tones(); ++k) {
        lines.insert(e.tone(k).line);
        CHECK(e.tone(k).amplitude == 0.01);
      }
    }
    CHECK(lines.size() == (opposed ? 1240u : 620u));
    for (const int q : lines) CHECK(lines.count(q) == (opposed ? 2 : 1));
  }
}

TEST_CASE("An opposite is the same stimulus with its sign reversed") {
  PlanOptions o;
  o.opposed = true;
  o.amplitude = 2.5;
  const Plan plan = make_plan(o);
  for (std::size_t e = 0; e < plan.experiments.size(); e += 2) {
    double sum = 0.0, size = 0.0;
    for (int n = 0; n < 2048; n += 7) {
      sum = std::max(sum, std::abs(plan.experiments[e](n) + plan.experiments[e + 1](n)));
      size = std::max(size, std::abs(plan.experiments[e](n)));
    }
    CHECK(size > 2.5);
    CHECK(sum < 1e-13 * size);
  }
}

TEST_CASE("A half multiple is played a second time a quarter turn later, and the constant as it is") {
  for (const bool opposed : {false, true}) {
    PlanOptions o;
    o.opposed = opposed;
    o.half_multiples = true;
    const Plan plan = make_plan(o);
    CHECK(plan.lines() == 640);
    CHECK(plan.bound.size == 20);
    CHECK(plan.experiments.size() == (opposed ? 40 : 20));
    std::map<int, std::vector<double>> phases;
    for (std::size_t e = 0; e < plan.experiments.size(); e += opposed ? 2 : 1) {
      const auto& u = plan.experiments[e];
      for (int k = 0; k < u.tones(); ++k) phases[u.tone(k).line].push_back(u.tone(k).phase);
    }
    for (const auto& [q, played] : phases) {
      REQUIRE(played.size() == (q % 32 == 0 && q != 0 ? 2u : 1u));
      if (q == 0) CHECK(played[0] == 0.0);
      if (played.size() == 2) CHECK(std::abs(played[1] - played[0] - 0.5 * std::numbers::pi) < 1e-15);
    }
  }
  // All else is as it was.
  PlanOptions o;
  const Plan without = make_plan(o);
  o.half_multiples = true;
  CHECK(refusal(o) == "accepted");
  o.period = 128;
  CHECK(refusal(o).find("add --tones 64") != std::string::npos);
  CHECK(without.lines() == 620);
}

TEST_CASE("The plays of several inputs are orthogonal, line by line, and shared out") {
  for (const int inputs : {1, 2, 3, 4, 5, 8}) {
    PlanOptions o;
    o.period = 8;
    o.band = 3.0;
    o.half_multiples = true;
    o.inputs = inputs;
    o.share = {1.0, 0.1};
    o.share.resize(std::min<std::size_t>(2, static_cast<std::size_t>(inputs)));
    const Plan plan = make_plan(o);
    REQUIRE(plan.experiments.size() == static_cast<std::size_t>(6 * inputs));
    CHECK(plan.lines() == 24);
    CHECK(plan.least_experiments() == 6 * inputs);
    for (std::size_t e = 0; e < plan.experiments.size(); e += static_cast<std::size_t>(inputs)) {
      for (int k = 0; k < plan.experiments[e].tones(); ++k) {
        const int q = plan.experiments[e].tone(k).line;
        for (int i = 0; i < inputs; ++i) {
          for (int j = 0; j <= i; ++j) {
            Complex sum{};
            for (int play = 0; play < inputs; ++play) {
              const auto at = e + static_cast<std::size_t>(play);
              sum += plan.stimulus(at, i).spectrum(q) * std::conj(plan.stimulus(at, j).spectrum(q));
            }
            const double share = (i == 1 ? 0.1 : 1.0) * (j == 1 ? 0.1 : 1.0);
            const bool alone = q == 0 && (inputs == 3 || inputs == 5);  // a constant goes to one input at a time
            const double size = q != 0 ? 0.25 * inputs : alone ? 1.0 : inputs;
            CHECK(std::abs(sum - (i == j ? size * share * 1e-4 : 0.0)) < 1e-16);
          }
        }
      }
    }
  }
  PlanOptions o;
  o.inputs = 9;
  CHECK(refusal(o).find("--inputs") == 0);
  o.inputs = 2;
  o.share = {1.0, 1.0, 1.0};
  CHECK(refusal(o).find("--share") == 0);
  o.share = {1.0, -1.0};
  CHECK(refusal(o).find("--share") == 0);
}

TEST_CASE("The seed decides phases and the random partition, and nothing else does") {
  PlanOptions o;
  o.subsets = 80;
  const Plan a = make_plan(o), again = make_plan(o);
  o.seed = 2;
  const Plan b = make_plan(o);
  int same = 0, moved = 0;
  for (std::size_t e = 0; e < 80; ++e) {
    REQUIRE(a.experiments[e].tones() == again.experiments[e].tones());
    for (int k = 0; k < a.experiments[e].tones(); ++k) {
      same += a.experiments[e].tone(k).line == again.experiments[e].tone(k).line &&
                      a.experiments[e].tone(k).phase == again.experiments[e].tone(k).phase
                  ? 1
                  : 0;
      moved += k >= b.experiments[e].tones() || a.experiments[e].tone(k).line != b.experiments[e].tone(k).line ? 1 : 0;
    }
  }
  CHECK(same == 620);
  CHECK(moved > 500);
  // No phase twice: experiments draw from streams of their own.
  std::set<double> phases;
  for (const auto& e : a.experiments) {
    for (int k = 0; k < e.tones(); ++k) phases.insert(e.tone(k).phase);
  }
  CHECK(phases.size() == 620);
}

TEST_CASE("What cannot be planned is refused by the option's name") {
  const auto with = [](auto&& change) {
    PlanOptions o;
    change(o);
    return refusal(o);
  };
  const double nan = std::nan("");
  CHECK(with([](PlanOptions&) {}) == "accepted");
  CHECK(with([](PlanOptions& o) { o.period = 2; }).find("--period 2") == 0);
  CHECK(with([](PlanOptions& o) { o.period = 129; }).find("--period 129") == 0);
  CHECK(with([](PlanOptions& o) { o.period = -64; }).find("--period -64") == 0);
  CHECK(with([](PlanOptions& o) { o.band = 16.1; }).find("--band") == 0);
  CHECK(with([](PlanOptions& o) { o.band = 0.0; }).find("--band") == 0);
  CHECK(with([nan](PlanOptions& o) { o.band = nan; }).find("--band") == 0);
  CHECK(with([](PlanOptions& o) { o.band = 0.001; }).find("no line lies in the band") != std::string::npos);
  CHECK(with([](PlanOptions& o) { o.amplitude = 0.0; }).find("--amplitude") == 0);
  CHECK(with([nan](PlanOptions& o) { o.amplitude = nan; }).find("--amplitude") == 0);
  CHECK(with([](PlanOptions& o) { o.subsets = 19; }).find("--subsets 19: give at least 20") == 0);
  CHECK(with([](PlanOptions& o) { o.subsets = 621; }).find("--subsets 621") == 0);
  CHECK(with([](PlanOptions& o) { o.subsets = 620; }) == "accepted");
  CHECK(with([](PlanOptions& o) {
          o.sections = 1024;
          o.period = 128;
          o.band = 500.0;
        }).find("more than 16384 lines") != std::string::npos);
}

TEST_CASE("The largest plans fit the capacities") {
  PlanOptions o;
  o.period = 128;
  o.band = 16.0;
  const Plan plan = make_plan(o);
  CHECK(plan.experiments.size() == 32);
  CHECK(plan.lines() == 2016);
  for (const auto& e : plan.experiments) CHECK(e.tones() == 63);
  o.opposed = true;
  CHECK(make_plan(o).lines() == 2016);
}
