// A wait-free queue between two threads, one that only pushes and one that only pops.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <type_traits>

namespace saltus {

// Holds up to Capacity values in itself: no heap, no lock, no system call, and the same few instructions whatever the
// other side does. A full ring refuses what is new and keeps what is old; the refusals are counted.
template <class T, std::size_t Capacity>
class Ring {
  static_assert(Capacity > 0 && (Capacity & (Capacity - 1)) == 0, "the capacity of a Ring is a power of two");
  static_assert(std::is_trivially_copyable_v<T> && std::is_default_constructible_v<T>,
                "a Ring holds plain data: trivially copyable, default constructible");
  static_assert(std::atomic<std::size_t>::is_always_lock_free);

 public:
  static constexpr std::size_t capacity = Capacity;  // [-]

  Ring() = default;
  Ring(const Ring&) = delete;
  Ring& operator=(const Ring&) = delete;

  // The pushing thread only. False, and counted as dropped, where the ring is full.
  [[nodiscard]] bool try_push(const T& value) noexcept {
    const std::size_t pushed = pushed_.load(std::memory_order_relaxed);
    if (pushed - popped_seen_ == Capacity) {
      popped_seen_ = popped_.load(std::memory_order_acquire);
      if (pushed - popped_seen_ == Capacity) {
        dropped_.store(dropped_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
        return false;
      }
    }
    slots_[pushed % Capacity] = value;
    pushed_.store(pushed + 1, std::memory_order_release);
    return true;
  }

  // The popping thread only. False where the ring is empty; `value` is then untouched.
  [[nodiscard]] bool try_pop(T& value) noexcept {
    const std::size_t popped = popped_.load(std::memory_order_relaxed);
    if (popped == pushed_seen_) {
      pushed_seen_ = pushed_.load(std::memory_order_acquire);
      if (popped == pushed_seen_) return false;
    }
    value = slots_[popped % Capacity];
    popped_.store(popped + 1, std::memory_order_release);
    return true;
  }

  // Values refused so far; any thread may ask.
  [[nodiscard]] std::size_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }

 private:
  static constexpr std::size_t line = 64;  // [B] of a cache line: what the two threads write never shares one

  // Counts of values ever pushed and popped; they may wrap. Each side keeps what it last saw of the other's, so that it
  // looks across only when the ring seems full or empty.
  alignas(line) std::atomic<std::size_t> pushed_{0};
  std::size_t popped_seen_ = 0;
  std::atomic<std::size_t> dropped_{0};
  alignas(line) std::atomic<std::size_t> popped_{0};
  std::size_t pushed_seen_ = 0;
  alignas(line) std::array<T, Capacity> slots_{};
};

}  // namespace saltus
