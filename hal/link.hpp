// What an experimenter and a machine say to each other, and the concept of that which carries it.
#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <type_traits>

#include "core/status.hpp"

namespace saltus {

// The experimenter sends a Stimulus, the machine answers with a Measurement. The command of tick n is held from tick n
// to tick n + 1; the measurement of tick n + 1 is the first it can show in. That pair makes one entry of a record:
//
//   experimenter   Stimulus{seq = q, tick = n, u(n)}  ─────────▶  machine: holds u(n), advances one tick
//   experimenter   ◀─────────  Measurement{seq = q, tick = n + 1, y(n + 1)}
//
// Ticks count simulated or planned time, never the wall clock's, so that a log replays to the same bits.
//
// Over a wire a run also has a beginning and an end, said with the same two messages: `order` and `answer`.

// What the experimenter wants. Every order is a stimulus with the next seq, so each is obeyed exactly once.
enum class Order : std::uint8_t {
  hold,   // hold u for one tick
  start,  // begin an experiment at tick 0; with a session the machine does not know it also asks for the machine
  stop,   // no stimulus any more; the machine is free
};

// What a measurement answers.
enum class Answer : std::uint8_t {
  measured,   // y of this tick
  started,    // y of tick 0 of an experiment
  stopped,    // the machine is free: asked to, or its fail-safe stopped it
  fail_safe,  // y of this tick, but commands have been missing for so long that the machine holds zero
  busy,       // refused: another session holds the machine
  unknown,    // refused: no such session, for instance after a restart of the machine
};

template <int Nu>
struct Stimulus {
  static_assert(Nu >= 0);
  std::int64_t session = 0;  // [-] drawn by the experimenter for one run: what belongs to another is not this run's
  std::int64_t seq = 0;      // [-] counts the stimuli of the session from 0: a gap is a loss, a repeat a duplicate
  std::int64_t tick = 0;     // [tick] from which u is held
  std::array<double, Nu> u{};
  Order order = Order::hold;
  std::int32_t experiment = 0;  // [-] of a start
  std::int64_t sent = 0;        // [-] messages sent before this one in the session, repeats included
};

template <int Ny>
struct Measurement {
  static_assert(Ny >= 0);
  std::int64_t session = 0;  // [-] of the stimulus it answers
  std::int64_t seq = -1;     // [-] of the stimulus that was held up to this tick; -1 before the first
  std::int64_t tick = 0;     // [tick] at which y was measured
  std::array<double, Ny> y{};
  Status status = Status::ok;  // of the machine; missing: y is not to be used
  Answer answer = Answer::measured;
  std::int64_t machine = 0;  // [-] drawn by the machine when it came up
  std::int64_t sent = 0;     // [-] as of a stimulus; -1 in a refusal, which belongs to no session of the machine
};

static_assert(std::is_trivially_copyable_v<Stimulus<0>> && std::is_trivially_copyable_v<Stimulus<2>>);
static_assert(std::is_trivially_copyable_v<Measurement<0>> && std::is_trivially_copyable_v<Measurement<2>>);

// One end of a link. It never blocks: each call does bounded work and says at once whether it was done.
//   experimenter's end  Link<L, Stimulus<Nu>, Measurement<Ny>>
//   machine's end       Link<L, Measurement<Ny>, Stimulus<Nu>>
template <class L, class Out, class In>
concept Link = requires(L& link, const Out& out, In& in) {
  { link.try_send(out) }
  noexcept->std::same_as<bool>;  // false: not taken, and lost unless sent again
  { link.try_receive(in) }
  noexcept->std::same_as<bool>;  // false: nothing there, and `in` untouched
};

}  // namespace saltus
