// Linear periodic machines drawn at random, whose harmonic transfer functions htf() gives exactly, run in time and
// identified from the plans that make_plan() makes: every line of the band, the constant included.
#include "sim/line_equations.hpp"

#include <memory>

#include "core/random.hpp"
#include "core/spectrum/htf.hpp"
#include "sim/identification.hpp"
#include "sim/plan.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

constexpr int sections = 8, outputs = 2, harmonics = 3;
template <int Inputs>
using System = Ldtp<3, Inputs, outputs, sections>;

template <int Inputs>
System<Inputs> drawn(std::uint64_t seed) {
  Random random(seed);
  const auto fill = [&](auto& matrix, double size) {
    for (auto i = 0 * matrix.size(); i < matrix.size(); ++i) matrix.data()[i] = size * (2.0 * random.uniform() - 1.0);
  };
  System<Inputs> s;
  for (std::size_t n = 0; n < sections; ++n) {
    s.dim[n] = 3;
    fill(s.A[n], 0.7);
    fill(s.B[n], 1.0);
    fill(s.C[n], 1.0);
    fill(s.D[n], 0.5);
  }
  return s;
}

PlanOptions options(int inputs, int period, bool opposed) {
  PlanOptions o;
  o.sections = sections;
  o.period = period;
  o.band = 0.5 * sections;
  o.amplitude = 0.7;
  o.opposed = opposed;
  o.half_multiples = true;
  o.inputs = inputs;
  o.share = {1.0, 0.4, 2.0};
  o.share.resize(static_cast<std::size_t>(inputs));
  return o;
}

// What a campaign makes of the experiments that `plays` says.
template <int Inputs>
Identification identified(const System<Inputs>& system, const Plan& plan, int periods, double sigma, Random& random,
                          const std::vector<std::size_t>& plays) {
  constexpr int settle = 80;
  const int period = plan.options.period;
  std::array<Vec<outputs>, sections> cycle;  // the machine's own
  for (auto& y : cycle) y << 3.0 * random.uniform(), random.uniform();
  Identification id;
  id.sections = sections;
  id.period = period;
  LineNoise noise;
  LineEquations equations(sections, period);
  const auto estimator = std::make_unique<LineEstimator<outputs>>(), pump = std::make_unique<LineEstimator<outputs>>();
  for (const std::size_t e : plays) {
    std::vector<int> lines;
    std::vector<Multisine<max_tones>> inputs;
    std::vector<LineEquations::Tone> tones;
    std::vector<Complex> u;
    for (int k = 0; k < plan.experiments[e].tones(); ++k) lines.push_back(plan.experiments[e].tone(k).line);
    for (int j = 0; j < Inputs; ++j) {
      inputs.push_back(plan.stimulus(e, j));
      for (const int q : lines) {
        tones.push_back({q, inputs.back().spectrum(q), j});
        if (Inputs == 1) u.push_back(tones.back().u);
      }
    }
    REQUIRE(estimator->configure(sections, period, lines, harmonics) == Status::ok);
    REQUIRE(follow_pump(*pump, sections, period) == Status::ok);
    Vec<3> x = Vec<3>::Zero();
    for (int n = 0; n < (settle + periods * period) * sections; ++n) {
      const auto s = static_cast<std::size_t>(n % sections);
      Vec<Inputs> now;
      for (int j = 0; j < Inputs; ++j) now[j] = inputs[static_cast<std::size_t>(j)](n);
      const Vec<outputs> y = system.C[s] * x + system.D[s] * now + cycle[s];
      x = (system.A[s] * x + system.B[s] * now).eval();
      if (n < settle * sections) continue;
      const std::array<double, outputs> measured{y[0] + sigma * random.normal(), y[1] + sigma * random.normal()};
      (void)estimator->push(n, measured);
      (void)pump->push(n, measured);
    }
    equations.begin(tones);
    collect(*estimator, u, 0, outputs, id, noise, equations);
    collect_pump(*pump, {}, 0, outputs, noise, equations);
  }
  equations.solve(harmonics, id);
  finish(id, noise);
  return id;
}

std::vector<std::size_t> all(const Plan& plan) {
  std::vector<std::size_t> plays(plan.experiments.size());
  for (std::size_t e = 0; e < plays.size(); ++e) plays[e] = e;
  return plays;
}

template <int Inputs>
Complex exact(const System<Inputs>& system, const HtfEstimate& h, int period) {
  return htf(system, 2.0 * std::numbers::pi * h.line / (period * sections))(h.m)(h.output, h.input);
}

template <int Inputs>
void check_exact(std::uint64_t seed) {
  Random random(seed);
  for (const int period : {6, 7, 8}) {
    for (const bool opposed : {false, true}) {
      const auto system = drawn<Inputs>(seed + static_cast<std::uint64_t>(period));
      const Plan plan = make_plan(options(Inputs, period, opposed));
      CHECK(static_cast<int>(plan.experiments.size()) == sections * Inputs * (opposed ? 2 : 1));
      const Identification id = identified(system, plan, 1, 0.0, random, all(plan));
      const int lines = sections / 2 * period;  // from 0 on
      CHECK(plan.lines() == lines);
      REQUIRE(static_cast<int>(id.htf.size()) == lines * Inputs * outputs * (2 * harmonics + 1));
      CHECK(id.notes.empty());
      double worst = 0.0, largest = 0.0;
      for (const HtfEstimate& h : id.htf) {
        worst = std::max(worst, std::abs(h.value - exact(system, h, period)));
        largest = std::max(largest, std::abs(h.value));
      }
      INFO(Inputs << " inputs, " << period << " cycles: " << worst << " of " << largest);
      CHECK(worst < 1e-10);
      CHECK(largest > 0.1);
    }
  }
}

}  // namespace

TEST_CASE("One input: every line is found exactly, multiples of half the pumping frequency and the constant too") {
  check_exact<1>(1);
}

TEST_CASE("Two inputs and three: every line of each is found exactly, from so many plays") {
  check_exact<2>(2);
  check_exact<3>(3);
}

TEST_CASE("What the plays do not tell is left out and named, the rest is found") {
  Random random(9);
  const auto system = drawn<2>(5);
  const Plan plan = make_plan(options(2, 8, false));
  std::vector<std::size_t> first;  // of the two plays of each experiment
  for (std::size_t e = 0; e < plan.experiments.size(); e += 2) first.push_back(e);
  Identification id = identified(system, plan, 1, 0.0, random, first);
  CHECK(id.htf.empty());
  CHECK(id.notes.size() == 3);

  std::vector<std::size_t> most = all(plan);
  most.pop_back();
  id = identified(system, plan, 1, 0.0, random, most);
  std::vector<int> missing;
  for (int k = 0; k < plan.experiments.back().tones(); ++k) missing.push_back(plan.experiments.back().tone(k).line);
  double worst = 0.0;
  for (const HtfEstimate& h : id.htf) {
    CHECK(std::count(missing.begin(), missing.end(), h.line) == 0);
    worst = std::max(worst, std::abs(h.value - exact(system, h, 8)));
  }
  CHECK(worst < 1e-10);
  CHECK(id.htf.size() == (32 - missing.size()) * 2 * 2 * 7);
  CHECK_FALSE(id.notes.empty());
}

TEST_CASE("Standard errors of several inputs and of half multiples are right") {
  Random random(4);
  const auto system = drawn<2>(8);
  int inside68 = 0, inside95 = 0, count = 0, half68 = 0, half95 = 0, halves = 0;
  for (const bool opposed : {false, true}) {
    const Plan plan = make_plan(options(2, 8, opposed));
    for (int trial = 0; trial < 2; ++trial) {
      const Identification id = identified(system, plan, 4, 0.1, random, all(plan));
      REQUIRE(id.noise_known());
      for (const HtfEstimate& h : id.htf) {
        if (h.line == 0) continue;  // real numbers among them
        const double z = std::norm(h.value - exact(system, h, 8)) / (h.sigma * h.sigma);
        const int in68 = z < -std::log(1.0 - 0.68) ? 1 : 0, in95 = z < -std::log(1.0 - 0.95) ? 1 : 0;
        inside68 += in68;
        inside95 += in95;
        ++count;
        if (identifiable(h.line, 8)) continue;
        half68 += in68;
        half95 += in95;
        ++halves;
      }
    }
  }
  REQUIRE(count == 4 * 31 * 7 * 2 * 2);
  REQUIRE(halves == 4 * 7 * 7 * 2 * 2);
  // 3472 errors, 784 of half multiples: binomial standard deviations of 0.0079 and 0.0037, 0.0167 and 0.0078. Pooled
  // standard errors, good to 4 % in some ten pools a trial, and those that share the own cycle's estimate: half as much
  // again. Four standard deviations.
  const auto share = [](int inside, int of) { return static_cast<double>(inside) / of; };
  INFO(share(inside68, count) << ", " << share(inside95, count) << "; " << share(half68, halves) << ", "
                              << share(half95, halves));
  CHECK(std::abs(share(inside68, count) - 0.68) < 4.0 * 1.5 * 0.0079);
  CHECK(std::abs(share(inside95, count) - 0.95) < 4.0 * 1.5 * 0.0037);
  CHECK(std::abs(share(half68, halves) - 0.68) < 4.0 * 1.5 * 0.0167);
  CHECK(std::abs(share(half95, halves) - 0.95) < 4.0 * 1.5 * 0.0078);
}
