// An experimenter and controller as firmware, for a machine at the far end of a serial line (a hopper: `saltus rig
// hopper`). A stimulus generator excites it, a feedback of what is measured damps it, a streaming estimator follows its
// lines, and an alarm watches what a model beside it does not explain. Exits 0 when the machine is the model.
//
// The same source is a host's program: with the same machine, the hash of all that was sent and measured must be the
// same. bench/firmware/loop shows both.
#include <array>
#include <cmath>
#include <cstdint>

#include "board.hpp"
#include "core/flow/advance.hpp"
#include "core/spectrum/estimator.hpp"
#include "core/trace/alarm.hpp"
#include "print.hpp"
#include "serial.hpp"
#include "sim/models/hopper.hpp"

namespace {

using namespace saltus;
using board::Hash;
using board::Line;

constexpr int sections = 32, period = 16, tones = 7, harmonics = 1;
constexpr std::int64_t ticks = 64, approach = 60, settling = 16, end = settling + period;  // a turn [tick]; [cycle]
constexpr std::array<double, 2> noise{1e-4, 1e-3};                                         // [m], [m/s] of the machine
constexpr double damping = 0.1;                                                            // [N s/m]

const Hopper<> model;
Run<Hopper<>> run;
Timebase base;
Input<Hopper<>> u = Input<Hopper<>>::Zero();
Multisine<tones> stimulus(sections* period);
HtfEstimator<tones, harmonics, 2, sections, period> estimator;
std::array<std::array<double, 2>, sections> cycle{};  // undriven, by the model
DriftAlarm<sections, 2> watch;
Status worst = Status::ok;
Hash hash;

void to_next_section() noexcept {
  for (std::int64_t i = 0; i < ticks / sections; ++i) worst = worse(worst, step(model, run, u, base).status);
}

bool set_up() noexcept {
  base = timebase_of(model, ticks);
  std::array<int, tones> lines{};
  for (int k = 0; k < tones; ++k) {
    lines[static_cast<std::size_t>(k)] = k + 1 + k % 3 * period;
    if (!stimulus.add({lines[static_cast<std::size_t>(k)], 0.01, 0.0})) return false;
  }
  Random phases(2);
  stimulus.randomise_phases(phases);
  run.at = start_of(model);
  for (std::int64_t n = 0; n < approach * sections; ++n) {
    const auto y = output_at(model, run.at, u);
    cycle[static_cast<std::size_t>(n % sections)] = {y[0], y[1]};
    to_next_section();
  }
  return estimator.configure(sections, period, lines, harmonics) == Status::ok &&
         estimator.set_baseline(cycle) == Status::ok && watch.configure(sections, noise, 1e-6) == Status::ok;
}

// False where the machine, or the line to it, does not go on.
bool hear(serial::Reply& reply) noexcept {
  static serial::Frame<serial::Reply> frame;
  return board::receive(frame) && serial::unframed(frame, reply) && usable(reply.status);
}

bool experiment() noexcept {
  serial::Order order;
  serial::Reply reply;
  order.order = Order::start;
  if (!board::send(serial::framed(order)) || !hear(reply)) return false;
  order.order = Order::hold;
  for (std::int64_t n = 0; n < end * sections; ++n) {
    const auto expected = output_at(model, run.at, u);
    const auto section = static_cast<std::size_t>(n % sections);
    worst = worse(worst, estimator.push(n, reply.y));
    watch.push(static_cast<int>(section), {reply.y[0] - expected[0], reply.y[1] - expected[1]});
    u[0] = stimulus(n) - damping * (reply.y[1] - cycle[section][1]);
    for (const double x : {reply.y[0], reply.y[1], u[0]}) hash.add(x);
    order.tick = n;
    order.u[0] = u[0];
    if (!board::send(serial::framed(order))) return false;
    to_next_section();  // while the machine does the same
    if (!hear(reply)) return false;
  }
  hash.add_lines(estimator, tones, harmonics, 2);
  hash.add(watch.state().z);
  return true;
}

}  // namespace

int main() {
  if (!set_up()) return 2;
  if (!experiment()) {
    Line() << "the machine does not go on";
    return 1;
  }
  Line() << "status " << name(worst) << ", alarm " << (watch.state().raised ? "raised" : "silent")
         << ", residual's largest mean, in hundredths of its standard deviation: "
         << static_cast<std::int64_t>(100.0 * std::abs(watch.state().z));
  (Line() << "hash ").hex(hash.sum());
  return usable(worst) && !watch.state().raised ? 0 : 1;
}
