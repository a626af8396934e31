// Emulated machines side by side: experiments from the same start under stimuli of their own, one a lane.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "core/flow/lanes.hpp"
#include "identification.hpp"

namespace saltus {

// What they would measure at each sample, but for noise.
template <class M, int W>
struct LaneReplies {
  std::vector<typename LaneRuns<M, W>::Y> y;
  std::vector<std::array<Status, static_cast<std::size_t>(W)>> status;  // of the way there
};

// Plays one period of each stimulus over and over, as play_experiment does to a Rig, on a family that is on the grid.
template <class M, int W, class Family>
void play_in_lanes(const M& m, const Timebase& base, const Family& family, const Run<M>& start,
                   const std::array<std::span<const double>, static_cast<std::size_t>(W)>& stimuli,
                   std::int64_t samples, LaneReplies<M, W>& out) {
  static_assert(Family::on_grid && input_count<M> == 1);
  using Runs = LaneRuns<M, W>;
  typename Runs::Models models;
  models.fill(m);
  Runs runs(models);
  for (int lane = 0; lane < W; ++lane) runs.set(lane, start);
  out.y.resize(static_cast<std::size_t>(samples));
  out.status.assign(static_cast<std::size_t>(samples), {});
  const std::int64_t ticks = base.per_turn / family.count();
  typename Runs::U u, none;
  none[0] = 0.0;
  std::array<std::size_t, static_cast<std::size_t>(W)> at{};
  for (std::size_t n = 0; n < out.y.size(); ++n) {
    out.y[n] = runs.output(none);
    if (n + 1 == out.y.size()) break;
    for (std::size_t lane = 0; lane < at.size(); ++lane) {
      u[0].set(static_cast<int>(lane), stimuli[lane][at[lane]]);
      if (++at[lane] == stimuli[lane].size()) at[lane] = 0;
    }
    auto& status = out.status[n + 1];
    for (std::int64_t i = 0; i < ticks; ++i) {
      runs.step(u, base);
      if (runs.ok()) continue;
      for (std::size_t lane = 0; lane < at.size(); ++lane) {
        status[lane] = worse(status[lane], runs.status(static_cast<int>(lane)));
      }
    }
  }
}

// One of them, as a machine for play_experiment; its rig is the sensors.
template <class R, class M, int W>
class LaneReplay {
 public:
  LaneReplay(R& rig, const LaneReplies<M, W>& replies, int lane) noexcept
      : rig_(&rig), replies_(&replies), lane_(lane) {}

  Outcome start(std::int32_t, typename R::Reply& y) noexcept {
    next_ = 0;
    y = reply(-1);
    return Outcome::answered;
  }
  Outcome exchange(std::int64_t tick, const decltype(R::Command::u)&, typename R::Reply& y) noexcept {
    if (next_ < replies_->y.size()) y = reply(tick);  // after the last sample nobody asks
    return Outcome::answered;
  }

 private:
  typename R::Reply reply(std::int64_t seq) noexcept {
    Output<M> y;
    for (int i = 0; i < output_count<M>; ++i) y[i] = replies_->y[next_][i][lane_];
    const Status status = replies_->status[next_][static_cast<std::size_t>(lane_)];
    ++next_;
    return rig_->measure(seq, status, y);
  }

  R* rig_;
  const LaneReplies<M, W>* replies_;
  int lane_;
  std::size_t next_ = 0;  // [sample]
};

}  // namespace saltus
