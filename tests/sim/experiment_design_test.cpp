#include "sim/experiment_design.hpp"

#include <cmath>
#include <map>
#include <set>

#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

// The rules of Ankarali & Cowan 2014, V.B, as they are printed: no multiple of half the pumping frequency, no sum or
// difference a multiple of the pumping frequency.
void obeys_the_rules(const Plan& plan) {
  for (const auto& u : plan.experiments) {
    for (int i = 0; i < u.tones(); ++i) {
      const int q = u.tone(i).line;
      REQUIRE(2 * q % plan.options.period != 0);
      for (int j = 0; j < i; ++j) {
        REQUIRE((q - u.tone(j).line) % plan.options.period != 0);
        REQUIRE((q + u.tone(j).line) % plan.options.period != 0);
      }
    }
  }
}

std::map<int, int> times_played(const Plan& plan) {
  std::map<int, int> times;
  for (const auto& u : plan.experiments) {
    for (int k = 0; k < u.tones(); ++k) ++times[u.tone(k).line];
  }
  return times;
}

}  // namespace

TEST_CASE("fewer tones at a time: every line once, the rules kept", "[design]") {
  DesignOptions d;
  d.tones = 12;
  const Plan plan = design_plan({}, d);
  obeys_the_rules(plan);
  CHECK(plan.experiments.size() == 52);  // 620 / 12, rounded up
  const auto times = times_played(plan);
  CHECK(times.size() == 620);
  for (const auto& [line, n] : times) CHECK(n == 1);
  for (const auto& u : plan.experiments) CHECK((u.tones() <= 12 && u.tones() >= 11));
}

TEST_CASE("an odd design leaves the even lines and some odd classes silent", "[design]") {
  DesignOptions d;
  d.odd = true;
  d.detection = 4;
  d.realisations = 2;
  const Plan plan = design_plan({}, d);
  obeys_the_rules(plan);
  const auto times = times_played(plan);
  CHECK(times.size() == 320);
  for (const auto& [line, n] : times) {
    CHECK(line % 2 == 1);
    CHECK(n == 2);
  }
  for (const auto& u : plan.experiments) {
    std::set<int> classes;
    for (int k = 0; k < u.tones(); ++k) classes.insert(residue_class(u.tone(k).line, 64));
    CHECK(classes.size() <= 12);
  }
  const std::size_t half = plan.experiments.size() / 2;
  CHECK(plan.experiments[0].tone(0).line == plan.experiments[half].tone(0).line);
  CHECK(plan.experiments[0].tone(0).phase != plan.experiments[half].tone(0).phase);
}

TEST_CASE("a low crest factor within an amplitude limit", "[design]") {
  PlanOptions o;
  o.band = 1.0;
  o.amplitude = 1.0;
  DesignOptions d;
  d.crest = true;
  d.peak_limit = 2.0;
  const Plan random = make_plan(o), plan = design_plan(o, d);
  obeys_the_rules(plan);
  REQUIRE(plan.experiments.size() == random.experiments.size());
  double before = 0.0, after = 0.0;
  for (std::size_t e = 0; e < plan.experiments.size(); ++e) {
    before += crest_between_samples(random.experiments[e]);
    after += crest_between_samples(plan.experiments[e]);
    double peak = 0.0;
    for (int n = 0; n < plan.experiments[e].samples(); ++n) peak = std::max(peak, std::abs(plan.experiments[e](n)));
    CHECK(peak <= 2.0 + 1e-9);
  }
  CHECK(after < 0.7 * before);
}

TEST_CASE("a design that cannot be is refused with the option's name", "[design]") {
  const auto message = [](const PlanOptions& o, const DesignOptions& d) {
    try {
      design_plan(o, d);
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  PlanOptions odd_period;
  odd_period.period = 63;
  DesignOptions odd;
  odd.odd = true;
  CHECK(message(odd_period, odd).find("--odd") != std::string::npos);
  DesignOptions silent;
  silent.detection = 3;
  CHECK(message({}, silent).find("--odd") != std::string::npos);
  odd.detection = 16;
  CHECK(message({}, odd).find("--detection") != std::string::npos);
}
