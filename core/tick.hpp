// Integer time: the only place where a time in seconds or a clock angle is computed from a tick.
#pragma once

#include <cstdint>
#include <numbers>

namespace saltus {

// `per_turn` ticks make one turn of the clock, of `period` seconds. A model without a clock uses any convenient turn.
struct Timebase {
  double period = 1.0;          // [s] of one turn
  std::int64_t per_turn = 512;  // [tick] in one turn, >= 1
  bool sets_clock = false;      // a turn is the model's: its clock coordinate is set from the tick, not integrated

  constexpr double dt() const noexcept { return period / static_cast<double>(per_turn); }  // [s]

  // Time of a tick [s]; exact at whole turns whatever their number.
  constexpr double time(std::int64_t tick) const noexcept {
    const std::int64_t turn = tick / per_turn;
    return static_cast<double>(turn) * period + static_cast<double>(tick - turn * per_turn) * dt();
  }

  // Clock angle of a tick, in [0, 2 pi) [rad].
  constexpr double phase(std::int64_t tick) const noexcept {
    std::int64_t r = tick % per_turn;
    if (r < 0) r += per_turn;
    return 2.0 * std::numbers::pi * (static_cast<double>(r) / static_cast<double>(per_turn));
  }
};

}  // namespace saltus
