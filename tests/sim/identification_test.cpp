#include "sim/identification.hpp"

#include <memory>

#include "core/orbit/orbit.hpp"
#include "core/random.hpp"
#include "sim/models/hopper_orbit.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;

namespace {

// Answers with what it was told, and keeps the conversation.
struct Parrot {
  static constexpr std::int64_t never = std::int64_t{1} << 40;
  std::int64_t silent_at = never, broken_at = never;
  std::vector<std::pair<std::int64_t, double>> heard;

  Outcome start(std::int32_t experiment, Measurement<1>& y) {
    y.y[0] = 1000.0 * experiment;
    y.tick = 0;
    return silent_at < 0 ? Outcome::silent : Outcome::answered;
  }
  Outcome exchange(std::int64_t tick, const std::array<double, 1>& u, Measurement<1>& y) {
    if (tick >= silent_at) return Outcome::restarted;
    heard.emplace_back(tick, u[0]);
    y.tick = tick + 1;
    y.y[0] = u[0];
    y.status = tick >= broken_at ? Status::escaped : tick == 5 ? Status::grazing : Status::ok;
    return Outcome::answered;
  }
};

struct Ahead : Parrot {
  std::vector<std::pair<std::int64_t, double>> given;
  static std::int64_t lead() { return 3; }
  void give(std::int64_t tick, const std::array<double, 1>& u) { given.emplace_back(tick, u[0]); }
};

// Keeps what an estimator would be told.
struct Tape {
  std::vector<std::pair<std::int64_t, double>> pushed;
  Status push(std::int64_t n, const std::array<double, 1>& y) {
    pushed.emplace_back(n, y[0]);
    return Status::ok;
  }
};

using Pairs = std::vector<std::pair<std::int64_t, double>>;

struct Played {
  Status status;
  Outcome outcome;
  Pairs sampled, stimuli;
};

template <class Machine>
Played play(Machine& machine, std::int64_t samples, std::int64_t settle, Tape& tape) {
  const std::vector<double> stimulus{0.5, 1.5, 2.5};
  Played p{};
  p.status = play_experiment<1>(
      machine, 2, stimulus, samples, settle, tape,
      [&](std::int64_t n, double u, const std::array<double, 1>& y) {
        p.stimuli.emplace_back(n, u);
        p.sampled.emplace_back(n, y[0]);
      },
      p.outcome);
  return p;
}

HtfEstimate estimate(int m, int line, Complex value, double scale, int cycles = 64) {
  return {m, line, 0, value, scale, cycles};
}

}  // namespace

TEST_CASE("A sample is the measurement of its tick beside the input that is held from it on") {
  Parrot machine;
  Tape tape;
  const Played p = play(machine, 7, 4, tape);
  CHECK(p.status == Status::grazing);  // usable, and remembered
  CHECK(p.outcome == Outcome::answered);
  CHECK(p.stimuli == Pairs{{0, 0.5}, {1, 1.5}, {2, 2.5}, {3, 0.5}, {4, 1.5}, {5, 2.5}, {6, 0.5}});
  CHECK(machine.heard == p.stimuli);
  CHECK(p.sampled == Pairs{{0, 2000.0}, {1, 0.5}, {2, 1.5}, {3, 2.5}, {4, 0.5}, {5, 1.5}, {6, 2.5}});
  CHECK(tape.pushed == Pairs{{4, 0.5}, {5, 1.5}, {6, 2.5}});
}

TEST_CASE("A machine that is to be told ahead is told each tick once, in order") {
  Ahead machine;
  Tape tape;
  const Played p = play(machine, 5, 0, tape);
  CHECK(machine.given == Pairs{{0, 0.5}, {1, 1.5}, {2, 2.5}});
  CHECK(machine.heard == Pairs{{3, 0.5}, {4, 1.5}, {5, 2.5}, {6, 0.5}, {7, 1.5}});
  CHECK(p.stimuli == Pairs{{0, 0.5}, {1, 1.5}, {2, 2.5}, {3, 0.5}, {4, 1.5}});
}

TEST_CASE("An experiment ends where the machine is silent or broken, and says which") {
  Tape tape;
  Parrot dumb;
  dumb.silent_at = -1;
  Played p = play(dumb, 7, 0, tape);
  CHECK(p.status == Status::failed);
  CHECK(p.outcome == Outcome::silent);
  CHECK(p.sampled.empty());

  Parrot forgetful;
  forgetful.silent_at = 3;
  p = play(forgetful, 7, 0, tape);
  CHECK(p.status == Status::failed);
  CHECK(p.outcome == Outcome::restarted);
  CHECK(p.sampled.size() == 4);

  Parrot broken;
  broken.broken_at = 3;
  tape = {};
  p = play(broken, 7, 0, tape);
  CHECK(p.status == Status::escaped);
  CHECK(p.outcome == Outcome::answered);
  CHECK(tape.pushed.size() == 4);  // the broken measurement did not enter
}

TEST_CASE("A million ticks of the loop allocate nothing") {
  const Hopper<> m;
  const Timebase base = timebase_of(m, 512);
  constexpr std::int64_t samples = 62500;  // of 16 ticks each
  const auto check = [&](const auto& family) {
    using Family = std::decay_t<decltype(family)>;
    const auto system = std::make_unique<LdtpOf<Hopper<>, 32>>();
    const auto orbit = find_orbit<32>(m, base, family, *system);
    REQUIRE(orbit.status == Status::ok);
    Run<Hopper<>> start;
    start.at = orbit.point[0];
    Rig<Hopper<>, Family> rig(m, base, family, start, Output<Hopper<>>(1e-3, 6e-3), 1);
    const auto estimator = std::make_unique<LineEstimator<2>>();
    std::vector<int> lines;
    for (int k = 1; k <= 31; ++k) lines.push_back(k);
    REQUIRE(estimator->configure(32, 64, lines, 3) == Status::ok);
    std::vector<double> stimulus(2048);
    for (std::size_t n = 0; n < stimulus.size(); ++n) {
      stimulus[n] = 0.01 * std::cos(2.0 * std::numbers::pi * static_cast<double>(5 * n) / 2048.0);
    }
    std::int64_t met = 0;
    const test::AllocationCount allocated;
    const Status status = run_experiment(rig, stimulus, samples, 640, *estimator,
                                         [&](std::int64_t, double, const std::array<double, 2>&) { ++met; });
    CHECK(allocated() == 0);
    CHECK(status == Status::ok);
    CHECK(met == samples);
    CHECK(estimator->periods() == (samples - 640) / 2048);
  };
  check(ClockPhases{32});
  check(KinematicPhases{32});
}

TEST_CASE("Noise is pooled over the nearest lines, folded as a sampled signal folds them") {
  LineNoise noise;
  CHECK(std::isnan(noise.variance(0, 1.0, 32)));
  for (int i = 0; i < 200; ++i) noise.add(0, 0.05 * i, i < 100 ? 4.0 : 9.0, 4);
  noise.sort(32);
  CHECK(noise.variance(0, 0.5, 32) == 4.0);
  CHECK(noise.variance(0, 9.5, 32) == 9.0);
  CHECK(std::abs(noise.variance(0, 5.0 - 0.025, 32) - 6.5) < 0.2);  // half of each
  for (const double f : {-0.5, 31.5, 32.5, -31.5, 63.5}) CHECK(noise.variance(0, f, 32) == 4.0);
  CHECK(std::isnan(noise.variance(1, 0.5, 32)));

  // Few entries are all used, weighed by their degrees of freedom.
  LineNoise few;
  few.add(1, 0.1, 1.0, 2);
  few.add(1, 15.0, 5.0, 4);
  few.sort(32);
  CHECK(std::abs(few.variance(1, 3.0, 32) - (1.0 * 1 + 5.0 * 3) / 4.0) < 1e-15);
  CHECK(std::isnan(few.variance(0, 3.0, 32)));
}

TEST_CASE("The order in which experiments come decides nothing") {
  Random random(3);
  std::vector<std::array<double, 2>> entries;
  for (int i = 0; i < 900; ++i) {
    const double f = static_cast<double>(random.uniform_int(100)) / 64.0;  // many share a frequency
    entries.push_back({f, 1.0 + random.uniform()});
  }
  LineNoise forwards, backwards;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    forwards.add(0, entries[i][0], entries[i][1], 3);
    const auto& e = entries[entries.size() - 1 - i];
    backwards.add(0, e[0], e[1], 3);
  }
  forwards.sort(32);
  backwards.sort(32);
  for (int q = 0; q <= 110; ++q) {
    const double f = q / 64.0;
    CHECK(std::abs(forwards.variance(0, f, 32) - backwards.variance(0, f, 32)) < 1e-13);
  }
}

TEST_CASE("A line of several experiments is one estimate, by inverse variance") {
  Identification id;
  LineNoise noise;
  noise.add(0, 0.5, 4.0, 100);
  // Scales 1/(|u| sqrt(periods)): the second experiment was twice as loud.
  id.htf = {estimate(0, 32, {1.0, 0.0}, 1.0), estimate(0, 33, {5.0, 1.0}, 1.0), estimate(0, 32, {2.0, 1.0}, 0.5, 128)};
  finish(id, noise);
  REQUIRE(id.htf.size() == 2);
  CHECK(id.htf[0].line == 32);
  CHECK(std::abs(id.htf[0].value - Complex(1.8, 0.8)) < 1e-15);
  CHECK(std::abs(id.htf[0].sigma - 2.0 / std::sqrt(5.0)) < 1e-15);
  CHECK(id.htf[0].cycles == 192);
  CHECK(id.htf[1].value == Complex(5.0, 1.0));
  CHECK(std::abs(id.htf[1].sigma - 2.0) < 1e-15);
  CHECK(id.noise_known());
}

TEST_CASE("Without a noise that is known, a line of several experiments is their mean by cycles") {
  Identification id;
  LineNoise none;
  id.htf = {estimate(0, 7, {1.0, 0.0}, 1.0, 64), estimate(0, 7, {-1.0, 2.0}, 1.0, 64)};
  finish(id, none);
  REQUIRE(id.htf.size() == 1);
  CHECK(id.htf[0].value == Complex(0.0, 1.0));
  CHECK(std::isnan(id.htf[0].sigma));
  CHECK(id.htf[0].cycles == 128);
  CHECK_FALSE(id.noise_known());
}

TEST_CASE("Estimates are selected by harmonic and output, by rising line") {
  Identification id;
  LineNoise none;
  for (const int line : {9, 3, 6}) {
    for (const int m : {1, 0, -1}) {
      id.htf.push_back(estimate(m, line, {double(line), double(m)}, 1.0));
      id.htf.back().output = 1;
      id.htf.push_back(estimate(m, line, {-double(line), double(m)}, 1.0));
    }
  }
  finish(id, none);
  const auto list = id.select(-1, 1);
  REQUIRE(list.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) CHECK(list[i].value == Complex(3.0 * static_cast<double>(i + 1), -1.0));
  CHECK(id.select(2, 1).empty());
  CHECK(id.select(0, 2).empty());
}
