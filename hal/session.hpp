// The conversation of an experimenter and a machine, without the wire and without a clock of its own: what each message
// means to its receiver, and what comes next. The same two state machines serve both ways of going on:
//
//   lockstep  the experimenter repeats an order until it is answered; the machine obeys each order exactly once and
//             repeats its answer to the latest. Any loss, doubling, damage or reordering delays, and alters nothing.
//   paced     both follow the clock. Orders come ahead of their tick; where one is missing the machine holds the last,
//             counts, holds zero after `fail_safe` ticks in a row, and after as many again it stops.
#pragma once

#include <cmath>

#include "faults.hpp"
#include "link.hpp"

namespace saltus {

enum class Pace : std::uint8_t { lockstep, paced };

struct SessionOptions {
  Pace pace = Pace::lockstep;
  std::int64_t lease = 2'000'000'000;  // [ns] of silence after which another session may have the machine
  std::int64_t fail_safe = 50;         // [tick] without a command; paced
};

// The machine's side of the conversation.
template <int Nu, int Ny>
class MachineSession {
 public:
  using Command = Stimulus<Nu>;
  using Reply = Measurement<Ny>;

  enum class Act : std::uint8_t {
    none,    // nothing to do
    start,   // begin command.experiment at tick 0, then answer() with Answer::started
    hold,    // lockstep: hold command.u for one tick, then answer(); paced: it is kept for its tick, see command_of()
    stop,    // nothing moves any more; answer() with Answer::stopped
    repeat,  // send again()
    refuse,  // send refusal(command)
  };

  // `id` distinguishes this machine from any other and from itself after a restart: draw_id().
  MachineSession(std::int64_t id, const SessionOptions& options, FaultCounts& faults) noexcept
      : id_(id), options_(options), faults_(&faults) {}

  // `now` [ns] of any steady clock.
  Act hear(const Command& c, std::int64_t now) noexcept {
    if (c.session != session_ || !running_) {
      // A session that ended may still ask for the answer to its last order, or begin another experiment.
      if (c.session == session_ && c.seq <= last_) {
        return note(c, now) && c.seq == last_ ? Act::repeat : Act::none;
      }
      if (c.order != Order::start || (running_ && now - heard_ < options_.lease)) {
        faults_->note(Fault::session);
        return Act::refuse;
      }
      session_ = c.session;
      last_ = c.seq - 1;
      sent_ = 0;
      running_ = true;
      arrivals_.restart();
    }
    if (!note(c, now)) return Act::none;
    const bool paced = options_.pace == Pace::paced;
    const bool queued = paced && c.order == Order::hold && c.seq > held_first_;  // late ones too: they have their tick
    if (!queued && c.seq <= last_) return c.seq == last_ ? Act::repeat : Act::none;
    if (!paced && c.seq != last_ + 1) return fault(Fault::sequence);
    for (const double u : c.u) {
      if (!std::isfinite(u)) return fault(Fault::range);
    }
    last_ = c.seq > last_ ? c.seq : last_;
    switch (c.order) {
      case Order::start:
        experiment_ = c.experiment;
        queue_ = {};
        rest(c.seq);
        missing_ = 0;
        return Act::start;
      case Order::stop:
        running_ = false;
        rest(c.seq);
        return Act::stop;
      case Order::hold:
        break;
    }
    if (paced) {
      Slot& slot = queue_[static_cast<std::size_t>(c.tick) % queue_.size()];
      if (!slot.filled || slot.command.tick < c.tick) slot = {c, true};
    } else {
      held_ = c;
    }
    return Act::hold;
  }

  // Paced: what to hold from `tick` on: the command for it, else the last one, else (see missing()) zero.
  const std::array<double, Nu>& command_of(std::int64_t tick) noexcept {
    Slot& slot = queue_[static_cast<std::size_t>(tick) % queue_.size()];
    if (slot.filled && slot.command.tick == tick) {
      held_ = slot.command;
      slot.filled = false;
      missing_ = 0;
    } else {
      ++missing_;
      ++missed_;
      worst_age_ = missing_ > worst_age_ ? missing_ : worst_age_;
      if (failing()) held_.u = {};
      if (missing_ >= 2 * options_.fail_safe) running_ = false;  // to be said with Answer::stopped
    }
    return held_.u;
  }

  // Completes a reply and keeps it for again().
  const Reply& answer(const Reply& reply, Answer a) noexcept {
    reply_ = reply;
    reply_.answer = a;
    reply_.session = session_;
    reply_.seq = a == Answer::measured || a == Answer::fail_safe ? held_.seq : last_;
    reply_.machine = id_;
    return again();
  }
  const Reply& again() noexcept {
    reply_.sent = sent_++;
    return reply_;
  }
  Reply refusal(const Command& c) const noexcept {
    Reply r;
    r.answer = running_ && c.session != session_ ? Answer::busy : Answer::unknown;
    r.session = c.session;
    r.seq = c.seq;
    r.machine = id_;
    r.sent = -1;
    return r;
  }

  std::int64_t id() const noexcept { return id_; }
  std::int64_t session() const noexcept { return session_; }  // the present one, or the last
  bool running() const noexcept { return running_; }
  bool abandoned(std::int64_t now) const noexcept { return running_ && now - heard_ >= options_.lease; }
  std::int32_t experiment() const noexcept { return experiment_; }
  const Command& held() const noexcept { return held_; }
  std::int64_t missing() const noexcept { return missing_; }      // [tick] without a command in a row, up to now
  std::int64_t missed() const noexcept { return missed_; }        // [tick] without a command, ever
  std::int64_t worst_age() const noexcept { return worst_age_; }  // [tick] of a command held beyond its own
  bool failing() const noexcept { return missing_ >= options_.fail_safe; }

 private:
  Act fault(Fault f) noexcept {
    faults_->note(f);
    return Act::none;
  }
  // Zero from the order numbered `seq` on.
  void rest(std::int64_t seq) noexcept {
    held_ = Command{};
    held_.seq = held_first_ = seq;
  }
  bool note(const Command& c, std::int64_t now) noexcept {
    heard_ = now;
    return arrivals_.note(c.sent, *faults_);
  }

  struct Slot {
    Command command;
    bool filled = false;
  };

  std::int64_t id_;
  SessionOptions options_;
  FaultCounts* faults_;
  Arrivals arrivals_;
  std::int64_t session_ = 0, last_ = -1, sent_ = 0, heard_ = 0, held_first_ = -1;
  std::int32_t experiment_ = 0;
  bool running_ = false;
  Command held_;
  Reply reply_;
  std::array<Slot, 64> queue_{};  // by tick
  std::int64_t missing_ = 0, missed_ = 0, worst_age_ = 0;
};

// The experimenter's side.
template <int Nu, int Ny>
class ExperimenterSession {
 public:
  using Command = Stimulus<Nu>;
  using Reply = Measurement<Ny>;

  enum class News : std::uint8_t {
    none,      // nothing new
    answer,    // to the latest order
    measured,  // paced: the machine's measurement of some tick
    busy,      // another session holds the machine
    unknown,   // the machine we talked to does not know us (any more)
    stranger,  // a machine that is not the one we talked to does not know us: a second one, or ours after a restart
    stopped,   // the machine's fail-safe stopped it
  };

  ExperimenterSession(Pace pace, FaultCounts& faults) noexcept : pace_(pace), faults_(&faults) {}

  // A new session: `id` from draw_id().
  void open(std::int64_t id) noexcept {
    session_ = id;
    machine_ = 0;
    order_ = Command{};
    order_.seq = -1;
    order_.session = id;
    sent_ = 0;
    answered_ = true;
    arrivals_.restart();
  }

  // The next order, to be sent with again() until it is answered.
  void give(Order order, std::int32_t experiment, std::int64_t tick, const std::array<double, Nu>& u) noexcept {
    order_.order = order;
    order_.experiment = experiment;
    order_.tick = tick;
    order_.u = u;
    ++order_.seq;
    if (order == Order::start) start_seq_ = order_.seq;
    answered_ = false;
  }
  const Command& again() noexcept {
    order_.sent = sent_++;
    return order_;
  }

  News hear(const Reply& r) noexcept {
    if (r.session != session_) return fault(Fault::session);
    if (r.answer == Answer::busy || r.answer == Answer::unknown) {
      if (r.seq != order_.seq || answered_) return News::none;
      if (machine_ != 0 && r.machine != machine_) {
        faults_->note(Fault::session);
        return News::stranger;
      }
      return r.answer == Answer::busy ? News::busy : News::unknown;
    }
    if (machine_ != 0 && r.machine != machine_) return fault(Fault::session);
    if (!arrivals_.note(r.sent, *faults_)) return News::none;
    if (r.seq > order_.seq) return fault(Fault::sequence);
    for (const double y : r.y) {
      if (!std::isfinite(y) && usable(r.status) && r.status != Status::missing) return fault(Fault::range);
    }
    const bool asked = !answered_ && r.seq == order_.seq;
    if (r.answer == Answer::started || (r.answer == Answer::stopped && order_.order == Order::stop)) {
      if (!asked || (r.answer == Answer::started) != (order_.order == Order::start)) return News::none;
      machine_ = r.machine;
      answered_ = true;
      return News::answer;
    }
    if (r.answer == Answer::stopped) return News::stopped;
    if (pace_ == Pace::paced) return r.seq >= start_seq_ ? News::measured : News::none;
    if (!asked) return News::none;
    if (r.tick != order_.tick + 1) return fault(Fault::sequence);
    answered_ = true;
    return News::answer;
  }

  std::int64_t session() const noexcept { return session_; }
  std::int64_t machine() const noexcept { return machine_; }
  const Command& order() const noexcept { return order_; }

 private:
  News fault(Fault f) noexcept {
    faults_->note(f);
    return News::none;
  }

  Pace pace_;
  FaultCounts* faults_;
  Arrivals arrivals_;
  std::int64_t session_ = 0, machine_ = 0, sent_ = 0, start_seq_ = 0;
  bool answered_ = true;
  Command order_;
};

// A number that no other process draws: the time of day in nanoseconds, mixed with the process and a count.
std::int64_t draw_id() noexcept;

}  // namespace saltus
