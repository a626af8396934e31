// What both sides publish for whoever watches: who is there, and the transfer functions as they come in.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "core/linalg.hpp"
#include "faults.hpp"
#include "session.hpp"

namespace saltus {

// Text of fixed size, cut where it is too long.
template <std::size_t N>
struct ShortText {
  std::array<char, N> chars{};  // ends with 0

  ShortText() = default;
  ShortText(std::string_view s) noexcept { s.copy(chars.data(), N - 1); }       // NOLINT: a text is a text
  ShortText(const std::string& s) noexcept : ShortText(std::string_view(s)) {}  // NOLINT
  std::string_view view() const noexcept { return {chars.data()}; }
};

enum class Role : std::uint8_t { machine, experimenter };
enum class Activity : std::uint8_t { idle, running, fail_safe, finished, gone };

constexpr std::string_view name(Activity a) noexcept {
  constexpr std::array<std::string_view, 5> names{"idle", "running", "in fail-safe", "finished", "gone"};
  return names[static_cast<std::size_t>(a)];
}

struct Presence {
  Role role = Role::machine;
  Activity activity = Activity::idle;
  Pace pace = Pace::lockstep;
  std::int64_t id = 0;       // of the machine, or the session of the experimenter
  std::int64_t session = 0;  // in which it takes part
  std::int64_t born = 0;     // [ns] since 1970
  std::int64_t sent = 0;     // statuses published before
  std::int64_t tick = 0;
  std::int64_t missed = 0;  // [tick] without a command or a measurement
  std::int32_t experiment = 0;
  std::int32_t sections = 0;         // [tick] a cycle
  std::int32_t stimulus_period = 0;  // [cycle]
  std::int32_t settle = 0;           // [cycle]
  double cycle_period = 0.0;         // [s]
  std::array<std::int64_t, fault_count> faults{};
  ShortText<64> who;  // program, host and process
  ShortText<32> model;
  ShortText<128> note;
};

// H_m at all tones for one harmonic and output.
struct HtfBins {
  static constexpr int capacity = 64;  // tones
  std::int64_t session = 0;
  std::int64_t sent = 0;
  std::int64_t tick = 0;
  std::int32_t experiment = 0, sections = 0, period = 0, harmonic = 0, output = 0, tones = 0;
  std::array<std::int32_t, capacity> line{};
  std::array<Complex, capacity> value{};  // [output unit / input unit]
};

}  // namespace saltus
