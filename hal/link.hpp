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
template <int Nu>
struct Stimulus {
  static_assert(Nu >= 0);
  std::int64_t session = 0;  // [-] drawn by the experimenter for one run: what belongs to another is not this run's
  std::int64_t seq = 0;      // [-] counts the stimuli of the session from 0: a gap is a loss, a repeat a duplicate
  std::int64_t tick = 0;     // [tick] from which u is held
  std::array<double, Nu> u{};
};

template <int Ny>
struct Measurement {
  static_assert(Ny >= 0);
  std::int64_t session = 0;  // [-] of the stimulus it answers
  std::int64_t seq = -1;     // [-] of the stimulus that was held up to this tick; -1 before the first
  std::int64_t tick = 0;     // [tick] at which y was measured
  std::array<double, Ny> y{};
  Status status = Status::ok;  // of the machine; missing: y is not to be used
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
