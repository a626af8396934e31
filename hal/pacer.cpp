#include "pacer.hpp"

#include <time.h>

#include <algorithm>
#include <cerrno>

namespace saltus {
namespace {

constexpr std::int64_t second = 1'000'000'000;  // [ns]

std::int64_t now() noexcept {
  timespec t{};
  ::clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<std::int64_t>(t.tv_sec) * second + t.tv_nsec;
}

}  // namespace

void Pacer::start() noexcept {
  next_ = now();
  ticks_ = late_ = worst_ = 0;
  sum_ = 0.0;
}

std::int64_t Pacer::wait() noexcept {
  next_ += period_;
  std::int64_t t = now();
  const std::int64_t behind = t - next_;
  if (overrun_ == Overrun::skip && behind >= period_) next_ += behind / period_ * period_;
  if (t < next_) {
    const timespec until{static_cast<time_t>(next_ / second), static_cast<long>(next_ % second)};
    while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR && now() < next_) {
    }
    t = now();
  }
  const std::int64_t lateness = std::max(t - next_, behind);
  ++ticks_;
  late_ += lateness >= period_ ? 1 : 0;
  worst_ = std::max(worst_, lateness);
  sum_ += static_cast<double>(lateness);
  return lateness;
}

}  // namespace saltus
