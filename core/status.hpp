// What a step of the loop may report, and where reports are counted. Nothing is repaired silently: a status is returned
// to the caller *and* counted in the caller's Ledger.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace saltus {

// In rising order of severity; the worst one met wins.
enum class Status : std::uint8_t {
  ok,
  grazing,   // a guard was crossed almost tangentially: the event time and every derivative through it are
             // ill-conditioned
  missing,   // a measurement was absent or not finite and did not enter the sums
  zeno,      // more crossings in one interval than the cap: events accumulate
  escaped,   // an unarmed guard ended below zero: the state left its chart without an event
  diverged,  // a coordinate is not finite
  failed,    // an iteration did not converge
};

inline constexpr std::size_t status_count = 7;

constexpr std::string_view name(Status s) noexcept {
  constexpr std::array<std::string_view, status_count> names{"ok",      "grazing",  "missing", "zeno",
                                                             "escaped", "diverged", "failed"};
  return names[static_cast<std::size_t>(s)];
}

constexpr Status worse(Status a, Status b) noexcept { return a < b ? b : a; }

// True where the state behind the status may still be used.
constexpr bool usable(Status s) noexcept { return s <= Status::missing; }

// Counts of every status met, with the tick of the last one of each kind.
struct Ledger {
  std::array<std::int64_t, status_count> count{};      // [-]
  std::array<std::int64_t, status_count> last_tick{};  // [tick]

  constexpr void note(Status s, std::int64_t tick) noexcept {
    const auto i = static_cast<std::size_t>(s);
    ++count[i];
    last_tick[i] = tick;
  }
  constexpr std::int64_t operator[](Status s) const noexcept { return count[static_cast<std::size_t>(s)]; }
};

}  // namespace saltus
