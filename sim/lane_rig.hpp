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

// What play_experiment does with one of them: the rig lends its sensors.
template <class R, class M, int W, class Estimator, class OnSample>
Status replay_lane(R& rig, const LaneReplies<M, W>& replies, int lane, std::span<const double> stimulus,
                   std::int64_t settle, Estimator& estimator, OnSample&& on_sample) noexcept {
  Status worst = Status::ok;
  std::size_t at = 0;  // in the stimulus
  for (std::size_t n = 0; n < replies.y.size(); ++n) {
    const Status status = replies.status[n][static_cast<std::size_t>(lane)];
    worst = worse(worst, status);
    if (!usable(status)) return status;
    Output<M> y;
    for (int i = 0; i < output_count<M>; ++i) y[i] = replies.y[n][i][lane];
    const auto measured = rig.measure(y);
    const auto sample = static_cast<std::int64_t>(n);
    if (sample >= settle) worst = worse(worst, estimator.push(sample, measured));
    on_sample(sample, stimulus[at], measured);
    if (++at == stimulus.size()) at = 0;
  }
  return worst;
}

}  // namespace saltus
