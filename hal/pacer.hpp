// Wakes at absolute deadlines, so that lateness never adds up.
#pragma once

#include <cstdint>

namespace saltus {

// The only system call of the real-time thread is the sleep in here.
class Pacer {
 public:
  enum class Overrun {
    catch_up,  // every deadline gets its tick, at once where it has passed: for who counts time by ticks
    skip,      // deadlines that have passed are left out: for who follows another's ticks
  };
  explicit Pacer(std::int64_t period, Overrun overrun = Overrun::catch_up) noexcept  // [ns]
      : period_(period > 0 ? period : 1), overrun_(overrun) {}

  void start() noexcept;  // the first deadline is one period from now

  // Sleeps to the next deadline and says how late the tick begins [ns].
  std::int64_t wait() noexcept;

  std::int64_t period() const noexcept { return period_; }  // [ns]
  std::int64_t ticks() const noexcept { return ticks_; }
  std::int64_t late() const noexcept { return late_; }    // ticks that began when the next was due already
  std::int64_t worst() const noexcept { return worst_; }  // [ns]
  double mean() const noexcept { return ticks_ == 0 ? 0.0 : sum_ / static_cast<double>(ticks_); }  // [ns]

 private:
  std::int64_t period_;
  Overrun overrun_;
  std::int64_t next_ = 0, ticks_ = 0, late_ = 0, worst_ = 0;
  double sum_ = 0.0;
};

}  // namespace saltus
