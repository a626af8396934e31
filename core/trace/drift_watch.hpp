// The declared model beside the machine: it gets the same input, and an alarm watches what the machine does otherwise,
// section by section, while the experiment runs. Constant work a section, nothing allocated.
#pragma once

#include "../orbit/section_map.hpp"
#include "alarm.hpp"

namespace saltus {

template <HybridModel M, class Family, int MaxSections>
class DriftWatch {
 public:
  using Alarm = DriftAlarm<MaxSections, output_count<M>>;
  using Sample = typename Alarm::Sample;

  // Where and when the residual left its noise band: in the section after which the alarm was raised, or in which its
  // mean is furthest off.
  struct Departure {
    std::int64_t cycle = 0;  // of the experiment
    int section = -1;
    int chart = -1;   // the model's, there
    int output = -1;  // -1: no single section, more scatter in all
    double z = 0.0;   // [-] standard deviations of the mean residual there
  };

  // `start`: the model on section 0 of `family`, on its cycle. `noise`: standard deviation of each output [its unit].
  // `false_alarm`: probability a cycle. `settle`: cycles of an experiment before the residual counts, in which model
  // and machine forget how they began. failed: a number out of range.
  [[nodiscard]] Status configure(const M& m, const Timebase& base, const Family& family, const Run<M>& start,
                                 const Sample& noise, double false_alarm, std::int64_t settle) noexcept {
    ready_ = false;
    if (settle < 0 || alarm_.configure(family.count(), noise, false_alarm) != Status::ok) return Status::failed;
    model_ = m;
    base_ = base;
    if constexpr (!Family::on_grid) base_.sets_clock = false;
    family_ = &family;
    start_ = start;
    settle_ = settle;
    ready_ = true;
    begin();
    return Status::ok;
  }

  // A new experiment: the model back at its start, the alarm at rest.
  void begin() noexcept {
    run_ = start_;
    n_ = 0;
    lost_ = Status::ok;
    alarm_.restart();
  }

  // The measurement `y` of the next section in order, and the input held from there on. Anything else than ok: the
  // model could not follow the input, and nothing is watched from then on; missing: a measurement that is not finite.
  Status push(const Input<M>& u, const Sample& y) noexcept {
    if (!ready_) return Status::failed;
    if (!usable(lost_)) return lost_;
    const int section = static_cast<int>(n_ % family_->count());
    const Output<M> expected = output_at(model_, run_.at, Input<M>(Input<M>::Zero()));
    chart_[static_cast<std::size_t>(section)] = run_.at.chart;
    Status s = Status::ok;
    if (n_ >= settle_ * family_->count()) {
      Sample residual;
      for (int j = 0; j < output_count<M>; ++j)
        residual[static_cast<std::size_t>(j)] = y[static_cast<std::size_t>(j)] - expected[j];
      s = alarm_.push(section, residual);
    }
    ++n_;
    lost_ = to_next_section(model_, run_, section, u, base_, *family_, [](const Point<M>&, const Passage&) {});
    return usable(lost_) ? s : lost_;
  }

  bool raised() const noexcept { return alarm_.state().raised; }
  // As of the last complete cycle.
  Departure departure() const noexcept {
    const auto& state = alarm_.state();
    Departure d;
    d.cycle = (n_ - 1) / family_->count();
    d.section = state.section;
    if (state.section >= 0) d.chart = chart_[static_cast<std::size_t>(state.section)];
    d.output = std::abs(state.z) > alarm_.limit() ? state.output : -1;
    d.z = state.z;
    return d;
  }

 private:
  M model_{};
  Timebase base_{};
  const Family* family_ = nullptr;
  Run<M> start_{}, run_{};
  Alarm alarm_;
  std::array<int, static_cast<std::size_t>(MaxSections)> chart_{};
  std::int64_t n_ = 0, settle_ = 0;
  Status lost_ = Status::ok;
  bool ready_ = false;
};

}  // namespace saltus
