// What can be wrong with a message, counted by kind. Nothing is repaired silently, and nothing wrong is used.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace saltus {

// In the order of the checks: a message is counted under the first that it fails.
enum class Fault : std::uint8_t {
  length,       // not the size of its type
  fingerprint,  // not the type
  checksum,     // damaged
  kind,         // another type of the same fields, another number of channels, or a word that is none
  session,      // of another run, or another sender in this one
  gap,          // messages missing before this one; those that come after all are counted late as well
  duplicate,    // came before
  late,         // overtaken, and used all the same where it still fits
  sequence,     // not what follows: answers or orders that were not asked for
  range,        // a value that is not finite
  overflow,     // no room: whoever should have taken it did not
};

inline constexpr std::size_t fault_count = 11;

constexpr std::string_view name(Fault f) noexcept {
  constexpr std::array<std::string_view, fault_count> names{"length",   "fingerprint", "checksum",  "kind",
                                                            "session",  "gap",         "duplicate", "late",
                                                            "sequence", "range",       "overflow"};
  return names[static_cast<std::size_t>(f)];
}

// Counted by the thread of the link and by the one behind it; any thread may read.
class FaultCounts {
 public:
  void note(Fault f, std::int64_t n = 1) noexcept {
    count_[static_cast<std::size_t>(f)].fetch_add(n, std::memory_order_relaxed);
  }
  std::int64_t operator[](Fault f) const noexcept {
    return count_[static_cast<std::size_t>(f)].load(std::memory_order_relaxed);
  }

 private:
  std::array<std::atomic<std::int64_t>, fault_count> count_{};
};

// Tells from the numbers of the messages of one sender which are missing, doubled or late. Looks back 64 messages.
class Arrivals {
 public:
  void restart() noexcept { newest_ = -1; }

  // Takes the number of the next message; false: it came before.
  bool note(std::int64_t number, FaultCounts& faults) noexcept {
    const std::int64_t ahead = number - newest_;
    if (newest_ < 0 || ahead > 0) {
      if (newest_ >= 0 && ahead > 1) faults.note(Fault::gap, ahead - 1);
      seen_ = newest_ < 0 || ahead > 63 ? 1 : (seen_ << ahead) | 1;
      newest_ = number;
      return true;
    }
    const std::uint64_t mark = ahead > -64 ? std::uint64_t{1} << -ahead : 0;
    const bool before = (seen_ & mark) != 0;
    seen_ |= mark;
    faults.note(before ? Fault::duplicate : Fault::late);
    return !before;
  }

 private:
  std::int64_t newest_ = -1;  // -1: none yet; what was sent before the first one heard is not missed
  std::uint64_t seen_ = 0;    // bit i: newest_ - i came
};

}  // namespace saltus
