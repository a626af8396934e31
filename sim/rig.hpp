// The emulated machine: a model that lives from section to section under a held input, is measured with noise, and
// speaks the messages that hardware would.
#pragma once

#include <cmath>
#include <cstddef>
#include <span>

#include "core/orbit/section_map.hpp"
#include "core/random.hpp"
#include "hal/link.hpp"

namespace saltus {

// One number for each output, zero where there are no more.
template <class M>
Output<M> by_output(std::span<const double> values) noexcept {
  Output<M> all = Output<M>::Zero();
  for (int i = 0; i < output_count<M> && static_cast<std::size_t>(i) < values.size(); ++i) {
    all[i] = values[static_cast<std::size_t>(i)];
  }
  return all;
}

template <class M, class Family>
class Rig {
 public:
  using Command = Stimulus<input_count<M>>;
  using Reply = Measurement<output_count<M>>;
  static constexpr int longest_delay = 63;  // [section]

  // Stands on section 0 of the family, at `start`. `noise` is the standard deviation of each output [its unit].
  Rig(const M& model, const Timebase& base, const Family& family, const Run<M>& start, const Output<M>& noise,
      std::uint64_t seed) noexcept
      : model_(model),
        base_(base),
        family_(family),
        start_(start),
        run_(start),
        noise_(noise),
        seed_(seed),
        random_(seed) {
    if constexpr (!Family::on_grid) base_.sets_clock = false;
  }

  // Outputs come in multiples of `quantum` [their unit; 0: exactly], inputs act `delay` sections late.
  void degrade(const Output<M>& quantum, int delay) noexcept {
    quantum_ = quantum;
    delay_ = static_cast<std::uint64_t>(delay < 0 ? 0 : delay < longest_delay ? delay : longest_delay);
  }

  // Outputs are taken off by a random time, independent from section to section, of this standard deviation [s]: the
  // chart's flow carried on, past an event too.
  void jitter(double seconds) noexcept { jitter_ = seconds; }

  const Run<M>& run() const noexcept { return run_; }

  // The measurement before the first stimulus, seq -1.
  Reply greeting() noexcept { return reply(-1, Status::ok); }

  // Answers one stimulus if one waits. One tick of the link is a section.
  template <Link<Reply, Command> End>
  bool serve(End& end) noexcept {
    Command command;
    if (!end.try_receive(command)) return false;
    return end.try_send(advance(command));
  }

  // Back to where it was at first, with the noise of this experiment; what is measured there.
  Reply start(std::int32_t experiment) noexcept {
    run_ = start_;
    random_ = Random(seed_ + 1000003 * static_cast<std::uint64_t>(experiment));
    section_ = 0;
    met_ = 0;
    late_ = {};
    held_ = Input<M>::Zero();
    return greeting();
  }

  // Holds the stimulus until the next section, then measures.
  Reply advance(const Command& command) noexcept {
    late_[static_cast<std::size_t>(met_ % late_.size())] = command;
    const Command& acting = late_[static_cast<std::size_t>((met_ + late_.size() - delay_) % late_.size())];
    for (int i = 0; i < input_count<M>; ++i) held_[i] = acting.u[static_cast<std::size_t>(i)];
    const Status s =
        to_next_section(model_, run_, section_, held_, base_, family_, [](const Point<M>&, const Passage&) {});
    section_ = (section_ + 1) % family_.count();
    ++met_;
    Reply r = reply(command.seq, s);
    r.session = command.session;
    return r;
  }

  // No stimulus any more: an emulated machine then stands still.
  Reply rest() noexcept { return reply(-1, Status::ok); }

  // What its sensors make of outputs y.
  decltype(Reply::y) measure(const Output<M>& y) noexcept {
    decltype(Reply::y) r;
    for (int i = 0; i < output_count<M>; ++i) {
      const double measured = y[i] + (noise_[i] > 0.0 ? noise_[i] * random_.normal() : 0.0);
      r[static_cast<std::size_t>(i)] =
          quantum_[i] > 0.0 ? quantum_[i] * std::nearbyint(measured / quantum_[i]) : measured;
    }
    return r;
  }

 private:
  Reply reply(std::int64_t seq, Status status) noexcept {
    Reply r;
    r.seq = seq;
    r.tick = static_cast<std::int64_t>(met_);
    r.status = status;
    Point<M> at = run_.at;
    if (jitter_ > 0.0) {
      const double off = jitter_ * random_.normal();
      visit_chart(at, [&](auto c) {
        constexpr int n = decltype(c)::dim;
        const auto f = [&](const Vec<n>& x) noexcept -> Vec<n> { return model_.flow(c, x, held_); };
        const Vec<n> x = at.in(c);
        at.set(c, rk4<n, double>(f, x, f(x), off));
      });
    }
    r.y = measure(output_at(model_, at, Input<M>(Input<M>::Zero())));
    return r;
  }

  M model_;
  Timebase base_;
  Family family_;
  Run<M> start_, run_;
  Output<M> noise_, quantum_ = Output<M>::Zero();
  double jitter_ = 0.0;               // [s]
  Input<M> held_ = Input<M>::Zero();  // since the last section
  std::uint64_t seed_;
  Random random_;
  std::uint64_t delay_ = 0;                        // [section]
  std::array<Command, longest_delay + 1> late_{};  // the last commands, by section
  int section_ = 0;
  std::uint64_t met_ = 0;  // [section] since the start
};

}  // namespace saltus
