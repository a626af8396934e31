#include "session.hpp"

#include <unistd.h>

#include <atomic>
#include <chrono>

#include "core/random.hpp"

namespace saltus {

std::int64_t draw_id() noexcept {
  static std::atomic<std::uint64_t> drawn{0};
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const auto ns = static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
  const std::uint64_t place = (static_cast<std::uint64_t>(::getpid()) << 32) + drawn.fetch_add(1);
  return static_cast<std::int64_t>((Random(ns, place).bits() >> 1) | 1);  // positive
}

}  // namespace saltus
