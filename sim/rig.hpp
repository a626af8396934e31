// The emulated machine: a model that lives from section to section under a held input, is measured with noise, and
// speaks the messages that hardware would.
#pragma once

#include "core/orbit/section_map.hpp"
#include "core/random.hpp"
#include "hal/link.hpp"

namespace saltus {

template <class M, class Family>
class Rig {
 public:
  using Command = Stimulus<input_count<M>>;
  using Reply = Measurement<output_count<M>>;

  // Stands on section 0 of the family, at `start`. `noise` is the standard deviation of each output [its unit].
  Rig(const M& model, const Timebase& base, const Family& family, const Run<M>& start, const Output<M>& noise,
      std::uint64_t seed) noexcept
      : model_(model), base_(base), family_(family), run_(start), noise_(noise), random_(seed) {
    if constexpr (!Family::on_grid) base_.sets_clock = false;
  }

  const Run<M>& run() const noexcept { return run_; }

  // The measurement before the first stimulus, seq -1.
  Reply greeting() noexcept { return reply(-1, Status::ok); }

  // Answers one stimulus if one waits: holds it until the next section, then measures. One tick of the link is a
  // section.
  template <Link<Reply, Command> End>
  bool serve(End& end) noexcept {
    Command command;
    if (!end.try_receive(command)) return false;
    Input<M> u;
    for (int i = 0; i < input_count<M>; ++i) u[i] = command.u[static_cast<std::size_t>(i)];
    const Status s = to_next_section(model_, run_, section_, u, base_, family_, [](const Point<M>&, const Passage&) {});
    section_ = (section_ + 1) % family_.count();
    ++met_;
    return end.try_send(reply(command.seq, s));
  }

 private:
  Reply reply(std::int64_t seq, Status status) noexcept {
    Reply r;
    r.seq = seq;
    r.tick = met_;
    r.status = status;
    const Output<M> y = output_at(model_, run_.at, Input<M>(Input<M>::Zero()));
    for (int i = 0; i < output_count<M>; ++i) {
      r.y[static_cast<std::size_t>(i)] = y[i] + (noise_[i] > 0.0 ? noise_[i] * random_.normal() : 0.0);
    }
    return r;
  }

  M model_;
  Timebase base_;
  Family family_;
  Run<M> run_;
  Output<M> noise_;
  Random random_;
  int section_ = 0;
  std::int64_t met_ = 0;  // [section] since the start
};

}  // namespace saltus
