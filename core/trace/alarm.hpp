// Watches the residual of a running machine, cycle by cycle, and says when and where it leaves its noise band.
//
// Two charts run side by side. For every section and output an exponentially weighted mean of the residual in units of
// its noise (Roberts 1959), which finds a small lasting shift and names the section; and a cumulative sum of the
// cycle's mean square (Page 1954), which finds more scatter than there should be. Both thresholds follow from one
// false-alarm probability a cycle. Constant work a sample, nothing allocated.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "../status.hpp"
#include "statistics.hpp"

namespace saltus {

template <int MaxSections, int Outputs>
class DriftAlarm {
 public:
  using Sample = std::array<double, static_cast<std::size_t>(Outputs)>;

  struct State {
    bool raised = false;
    int section = -1;  // where the mean is furthest from zero
    int output = -1;
    double z = 0.0;        // [-] how far, in its standard deviations
    double scatter = 0.0;  // [-] the cumulative sum over its threshold
  };

  // `noise`: standard deviation of each output's residual. `false_alarm`: probability of an alarm in a cycle in which
  // nothing is wrong, at most. `memory`: cycles over which the means forget. failed: a number out of range.
  [[nodiscard]] Status configure(int sections, const Sample& noise, double false_alarm = 1e-4,
                                 double memory = 16.0) noexcept {
    if (sections < 1 || sections > MaxSections || !(false_alarm > 0.0 && false_alarm < 0.5) || !(memory >= 1.0))
      return Status::failed;
    for (const double s : noise) {
      if (!(s > 0.0) || !std::isfinite(s)) return Status::failed;
    }
    sections_ = sections;
    noise_ = noise;
    weight_ = 1.0 / memory;
    const int charts = sections * Outputs;
    limit_ = largest_of(charts, 0.5 * false_alarm);
    // A one-sided cumulative sum of nearly normal steps with allowance 1/2 crosses c at a rate near exp(-c) (Siegmund
    // 1985, ch. 2); the steps' skew is given half as much again.
    ceiling_ = 1.5 * -std::log(0.5 * false_alarm);
    restart();
    return Status::ok;
  }

  void restart() noexcept {
    mean_ = {};
    variance_ = {};
    square_ = 0.0;
    count_ = 0;
    sum_ = 0.0;
    cycles_ = 0;
    state_ = {};
  }

  // The residual (measured minus model) of a section. missing: not finite, left out.
  Status push(int section, const Sample& residual) noexcept {
    if (sections_ == 0 || section < 0 || section >= sections_) return Status::failed;
    Status status = Status::ok;
    for (std::size_t j = 0; j < residual.size(); ++j) {
      if (!std::isfinite(residual[j])) {
        status = Status::missing;
        continue;
      }
      const double e = residual[j] / noise_[j];
      const std::size_t k = static_cast<std::size_t>(section) * residual.size() + j;
      mean_[k] += weight_ * (e - mean_[k]);
      variance_[k] = (1.0 - weight_) * (1.0 - weight_) * variance_[k] + weight_ * weight_;
      square_ += e * e;
      ++count_;
    }
    if (section == sections_ - 1) finish();
    return status;
  }

  // As of the last complete cycle. Once raised it stays so until restart().
  const State& state() const noexcept { return state_; }
  std::int64_t cycles() const noexcept { return cycles_; }
  // What |z| of a section has to exceed.
  double limit() const noexcept { return limit_; }

 private:
  void finish() noexcept {
    ++cycles_;
    if (count_ > 0) {
      const double n = static_cast<double>(count_);
      // Wilson & Hilferty: the cube root of a mean square is nearly normal.
      const double third = 2.0 / (9.0 * n);
      const double z = (std::cbrt(square_ / n) - (1.0 - third)) / std::sqrt(third);
      sum_ = std::max(0.0, sum_ + z - 0.5);
    }
    square_ = 0.0;
    count_ = 0;
    const bool was = state_.raised;
    State now;
    for (int s = 0; s < sections_; ++s) {
      for (int j = 0; j < Outputs; ++j) {
        const std::size_t k =
            static_cast<std::size_t>(s) * static_cast<std::size_t>(Outputs) + static_cast<std::size_t>(j);
        if (!(variance_[k] > 0.0)) continue;
        const double z = mean_[k] / std::sqrt(variance_[k]);
        if (std::abs(z) > std::abs(now.z)) {
          now.z = z;
          now.section = s;
          now.output = j;
        }
      }
    }
    now.scatter = sum_ / ceiling_;
    now.raised = std::abs(now.z) > limit_ || now.scatter > 1.0;
    if (was && !now.raised) return;  // keep what raised it
    state_ = now;
  }

  int sections_ = 0;
  Sample noise_{};
  double weight_ = 0.0, limit_ = 0.0, ceiling_ = 0.0;
  std::array<double, static_cast<std::size_t>(MaxSections) * static_cast<std::size_t>(Outputs)> mean_{}, variance_{};
  double square_ = 0.0, sum_ = 0.0;
  std::int64_t count_ = 0, cycles_ = 0;
  State state_{};
};

}  // namespace saltus
