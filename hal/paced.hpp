// Paced by the clock: orders leave ahead of the tick they are for, measurements are taken as they come, and what is not
// there in time is missing. The experimenter's end; the machine's is run_tick().
#pragma once

#include <limits>

#include "lockstep.hpp"
#include "pacer.hpp"

namespace saltus {

struct PacedOptions {
  std::int64_t lead = 4;        // [tick] that an order leaves before its own
  std::int64_t fail_safe = 50;  // [tick] without a measurement before giving up
};

template <class End, int Nu, int Ny>
class Paced {
 public:
  using Command = Stimulus<Nu>;
  using Reply = Measurement<Ny>;

  Paced(End& end, FaultCounts& faults, const ExchangeOptions& exchange, const PacedOptions& options,
        std::int64_t period) noexcept
      : end_(&end),
        exchange_(exchange),
        options_(options),
        pacer_(period, Pacer::Overrun::skip),
        session_(Pace::paced, faults) {}

  std::int64_t lead() const noexcept { return options_.lead; }

  // Takes the machine and begins an experiment; y is of tick 0, from when on the machine's time runs.
  Outcome start(std::int32_t experiment, Reply& y) noexcept {
    if (!open_) session_.open(draw_id());
    open_ = true;
    session_.give(Order::start, experiment, 0, {});
    tick_ = 0;
    ahead_ = Reply{};
    ahead_.tick = -1;
    pacer_.start();
    const Outcome o = ask(y, exchange_.patience);
    if (o == Outcome::restarted) open_ = false;
    return o;
  }

  // Sends u for the tick, without waiting.
  void give(std::int64_t tick, const std::array<double, Nu>& u) noexcept {
    session_.give(Order::hold, session_.order().experiment, tick, u);
    (void)end_->try_send(session_.again());
  }

  // Sends u for a tick, lead() ahead; y is the next measurement in order, of status `missing` where it did not come.
  Outcome exchange(std::int64_t tick, const std::array<double, Nu>& u, Reply& y) noexcept {
    give(tick, u);
    ++tick_;
    for (std::int64_t waited = 0; ahead_.tick < tick_;) {
      Reply r;
      if (!end_->try_receive(r)) {
        if (waited++ >= options_.fail_safe) return fail(Outcome::silent);
        if (exchange_.interrupt != nullptr && exchange_.interrupt->load(std::memory_order_relaxed)) {
          return fail(Outcome::interrupted);
        }
        pacer_.wait();
        continue;
      }
      switch (session_.hear(r)) {
        case News::measured:
          if (r.tick > ahead_.tick) ahead_ = r;
          break;
        case News::stopped:
          return fail(Outcome::stopped);
        case News::unknown:
        case News::stranger:
          return fail(Outcome::restarted);
        case News::busy:
          return fail(Outcome::busy);
        case News::answer:
        case News::none:
          break;
      }
    }
    if (ahead_.tick == tick_) {
      y = ahead_;
      fail_safe_ += y.answer == Answer::fail_safe ? 1 : 0;
      return Outcome::answered;
    }
    ++missed_;
    y = ahead_;
    y.tick = tick_;
    y.status = Status::missing;
    y.y.fill(std::numeric_limits<double>::quiet_NaN());
    return Outcome::answered;
  }

  Outcome stop() noexcept {
    if (!open_) return Outcome::answered;
    Reply ignored;
    session_.give(Order::stop, session_.order().experiment, tick_, {});
    exchange_.interrupt = nullptr;
    open_ = false;
    return ask(ignored, 10 * exchange_.retry);
  }

  const ExperimenterSession<Nu, Ny>& session() const noexcept { return session_; }
  const Pacer& pacer() const noexcept { return pacer_; }
  std::int64_t missed() const noexcept { return missed_; }        // [tick] without a measurement
  std::int64_t fail_safe() const noexcept { return fail_safe_; }  // [tick] the machine held zero in

 private:
  using News = typename ExperimenterSession<Nu, Ny>::News;

  // Nothing more is to be had from this run: the machine gets its zero at once rather than by its own fail-safe.
  Outcome fail(Outcome o) noexcept {
    if (o == Outcome::silent || o == Outcome::interrupted) (void)stop();
    open_ = false;
    return o;
  }

  Outcome ask(Reply& y, std::int64_t patience) noexcept {
    const std::int64_t begun = steady_ns();
    std::int64_t next = begun;
    bool busy = false;
    for (;;) {
      const std::int64_t now = steady_ns();
      if (now >= next) {
        if (exchange_.interrupt != nullptr && exchange_.interrupt->load(std::memory_order_relaxed)) {
          return Outcome::interrupted;
        }
        if (now - begun >= patience) return Outcome::silent;
        if (busy && now - begun >= exchange_.yield) return Outcome::busy;
        (void)end_->try_send(session_.again());
        next = now + exchange_.retry;
      }
      Reply r;
      if (!end_->try_receive(r)) {
        await(*end_, next - now);
        continue;
      }
      const News news = session_.hear(r);
      if (news == News::answer) {
        y = r;
        return Outcome::answered;
      }
      if (news == News::busy) busy = true;
      if (news == News::unknown) return Outcome::restarted;
      if (news == News::stopped && session_.order().order != Order::start) return Outcome::stopped;
    }
  }

  End* end_;
  ExchangeOptions exchange_;
  PacedOptions options_;
  Pacer pacer_;
  ExperimenterSession<Nu, Ny> session_;
  bool open_ = false;
  std::int64_t tick_ = 0, missed_ = 0, fail_safe_ = 0;
  Reply ahead_;  // the latest measurement heard
};

// The machine's end, once a tick: hears what has come, then holds the command of `tick` and measures. `tick` is that of
// the running experiment, and is counted on; a start sets it to 0.
template <class End, class Machine, int Nu, int Ny>
void run_tick(End& end, MachineSession<Nu, Ny>& session, Machine& machine, std::int64_t& tick,
              std::int64_t now) noexcept {
  using Act = typename MachineSession<Nu, Ny>::Act;
  Stimulus<Nu> c;
  bool begun = false;
  while (end.try_receive(c)) {
    switch (session.hear(c, now)) {
      case Act::start:
        tick = 0;
        begun = true;
        (void)end.try_send(session.answer(machine.start(c.experiment), Answer::started));
        break;
      case Act::stop:
        (void)end.try_send(session.answer(machine.rest(), Answer::stopped));
        break;
      case Act::repeat:
        (void)end.try_send(session.again());
        break;
      case Act::refuse:
        (void)end.try_send(session.refusal(c));
        break;
      case Act::hold:
      case Act::none:
        break;
    }
  }
  if (!session.running() || begun) return;
  Stimulus<Nu> held;
  held.u = session.command_of(tick);
  held.tick = tick;
  held.session = session.session();
  if (!session.running()) {
    (void)end.try_send(session.answer(machine.rest(), Answer::stopped));
    return;
  }
  ++tick;
  (void)end.try_send(session.answer(machine.advance(held), session.failing() ? Answer::fail_safe : Answer::measured));
}

}  // namespace saltus
