// A whole experiment as firmware: a stimulus generator drives a machine (a hopper, emulated here) and a model of it; a
// streaming estimator follows the machine's lines, and an alarm watches what the model does not explain. After 24
// cycles the machine's spring weakens by 3 %. Exits 0 when the alarm keeps silent before and raises after.
//
// The same source is a host's program: the hash of all states must be the same. bench/firmware/run shows both.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string_view>

#include "board.hpp"
#include "core/flow/advance.hpp"
#include "core/spectrum/estimator.hpp"
#include "core/trace/alarm.hpp"
#include "print.hpp"
#include "sim/models/hopper.hpp"

namespace {

using namespace saltus;
using board::Hash;
using board::Line;

constexpr int sections = 32, period = 16, tones = 7, harmonics = 1;
constexpr std::int64_t length = sections * period, ticks = 64;  // a stimulus period [sample], a turn [tick]
constexpr std::int64_t settling = 60, weakening = settling + 24, end = settling + 48;  // [cycle]
constexpr std::array<double, 2> noise{1e-4, 1e-3};                                     // [m], [m/s]
constexpr double amplitude = 0.01;                                                     // [N] of each tone

// What a part of the loop costs [instruction].
class Cost {
 public:
  void add(std::uint32_t begin) noexcept {
    const std::uint32_t cost = board::instructions_since(begin);
    ++calls_;
    total_ += cost;
    largest_ = std::max(largest_, cost);
  }
  void print(std::string_view what) const noexcept {
    if (total_ > 0)
      Line() << what << ": mean " << std::int64_t(total_ / calls_) << ", largest " << std::int64_t{largest_};
  }

 private:
  std::uint64_t total_ = 0, calls_ = 0;
  std::uint32_t largest_ = 0;
};

Hopper<> machine;
const Hopper<> model;
Run<Hopper<>> machine_run, model_run;
Timebase base;
Multisine<tones> stimulus(static_cast<int>(length));
Multisine<tones, float> single_stimulus(static_cast<int>(length));  // the same, for who has no double
double stimulus_loss = 0.0;                                         // [-] of the sum of the amplitudes
HtfEstimator<tones, harmonics, 2, sections, period> estimator;
HtfEstimator<tones, harmonics, 2, sections, period, float> single;  // the same in half the memory
std::array<std::array<double, 2>, sections> baseline{};             // the undriven cycle
DriftAlarm<sections, 2> alarm;
Random random(3);
Input<Hopper<>> u;
Status worst = Status::ok;

Cost generating, generating_single, ticking, integrating, estimating, estimating_single, watching;
Hash hash;

void tick() noexcept { worst = worse(worst, step(machine, machine_run, u, base).status); }

// The innermost part alone: a step of the flight phase.
void integrate() noexcept {
  const auto rate = [](const Vec<5>& x) noexcept -> Vec<5> { return model.flow(hopper::Flight{}, x, u); };
  static Vec<5> x = model.start().x;
  x = rk4<5, double>(rate, x, rate(x), base.dt());
}

// A sample: measure, estimate, watch, and on to the next section. Until the cycle is settled and known, no stimulus.
void sample(std::int64_t n) noexcept {
  std::array<double, 2> y{}, residual{};
  const auto real = output_at(machine, machine_run.at, u), expected = output_at(model, model_run.at, u);
  for (int i = 0; i < 2; ++i) {
    const auto k = static_cast<std::size_t>(i);
    y[k] = real[i] + noise[k] * random.normal();
    residual[k] = y[k] - expected[i];
    if (n < settling * sections) baseline[static_cast<std::size_t>(n % sections)][k] = expected[i];
  }
  std::uint32_t begin = board::now();
  estimator.push(n, y);
  estimating.add(begin);
  begin = board::now();
  single.push(n, y);
  estimating_single.add(begin);
  begin = board::now();
  alarm.push(static_cast<int>(n % sections), residual);
  watching.add(begin);
  if (n >= settling * sections) {
    begin = board::now();
    u[0] = stimulus(n);
    generating.add(begin);
    begin = board::now();
    const float approximate = single_stimulus(n);
    generating_single.add(begin);
    stimulus_loss = std::max(stimulus_loss, std::fabs(double{approximate} - u[0]) / (tones * amplitude));
  }
  for (std::int64_t i = 0; i < ticks / sections; ++i) {
    begin = board::now();
    tick();
    ticking.add(begin);
    worst = worse(worst, step(model, model_run, u, base).status);
    for (const double x : machine_run.at.x) hash.add(x);
  }
}

bool set_up() noexcept {
  base = timebase_of(model, ticks);
  std::array<int, tones> lines{};
  for (int k = 0; k < tones; ++k) {
    lines[static_cast<std::size_t>(k)] = k + 1 + k % 3 * period;
    const Tone tone{lines[static_cast<std::size_t>(k)], amplitude, 0.0};
    if (!stimulus.add(tone) || !single_stimulus.add(tone)) return false;
  }
  Random phases(2), same_phases(2);
  stimulus.randomise_phases(phases);
  single_stimulus.randomise_phases(same_phases);
  machine_run.at = model_run.at = start_of(model);
  return estimator.configure(sections, period, lines, harmonics) == Status::ok &&
         single.configure(sections, period, lines, harmonics) == Status::ok &&
         alarm.configure(sections, noise, 1e-6) == Status::ok;
}

// Largest difference of the lines in single precision from those in double, over the largest line.
double loss() noexcept {
  double difference = 0.0, size = 0.0;
  for (int k = 0; k < tones; ++k) {
    for (int l = -harmonics; l <= harmonics; ++l) {
      for (int c = 0; c < 2; ++c) {
        difference = std::max(difference, std::norm(single.line(k, l, c) - estimator.line(k, l, c)));
        size = std::max(size, std::norm(estimator.line(k, l, c)));
      }
    }
  }
  return std::sqrt(difference / size);
}

void experiment() noexcept {
  std::int64_t raised = -1;  // [cycle]
  for (std::int64_t n = 0; n < end * sections; ++n) {
    if (n == settling * sections) {
      alarm.restart();
      worst = worse(worst, estimator.set_baseline(baseline));
      worst = worse(worst, single.set_baseline(baseline));
    }
    if (n == weakening * sections) machine.k *= 0.97;
    sample(n);
    if (raised < 0 && n >= settling * sections && alarm.state().raised) raised = n / sections;
  }
  hash.add_lines(estimator, tones, harmonics, 2);
  hash.add(loss());
  hash.add(stimulus_loss);
  hash.add(alarm.state().z);
  hash.add(static_cast<double>(raised));
  Line() << "alarm in cycle " << raised << ", section " << std::int64_t{alarm.state().section} << ", output "
         << std::int64_t{alarm.state().output};
  if (raised < weakening || raised > end) worst = Status::failed;
}

}  // namespace

int main() {
  if (!set_up()) return 2;
  const std::uint32_t stack = board::stack_of(experiment);
  Line() << "status " << name(worst);
  (Line() << "hash ").hex(hash.sum());
  generating.print("stimulus, instructions a sample");
  generating_single.print("stimulus in single precision, instructions a sample");
  ticking.print("tick, instructions");
  for (int i = 0; i < 100; ++i) {
    const std::uint32_t begin = board::now();
    integrate();
    integrating.add(begin);
  }
  integrating.print("Runge-Kutta step of five states, instructions");
  estimating.print("estimator, instructions a sample");
  estimating_single.print("estimator in single precision, instructions a sample");
  Line() << "single precision: stimulus off by " << static_cast<std::int64_t>(1e10 * stimulus_loss)
         << "e-10 of its amplitudes, lines by " << static_cast<std::int64_t>(1e10 * loss())
         << "e-10 of the largest; bytes " << std::int64_t{sizeof single} << " instead of "
         << std::int64_t{sizeof estimator};
  watching.print("alarm, instructions a sample");
  if (stack > 0) {
    Line() << "stack, bytes: " << std::int64_t{stack} << ", of a tick " << std::int64_t{board::stack_of(tick)}
           << ", of a step " << std::int64_t{board::stack_of(integrate)};
  }
  return usable(worst) ? 0 : 1;
}
