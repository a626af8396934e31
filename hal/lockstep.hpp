// Lockstep over any link: one order, repeated until it is answered; then the next. The trajectory is the same, bit for
// bit, as without a wire. And the machine's answer to it.
#pragma once

#include <algorithm>
#include <chrono>
#include <thread>

#include "session.hpp"

namespace saltus {

inline std::int64_t steady_ns() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

// Sleeps until there may be something to receive, `ns` at most, where the link can; else leaves the processor.
template <class End>
void await(End& end, std::int64_t ns) noexcept {
  if constexpr (requires { end.await(ns); }) {
    end.await(ns);
  } else {
    std::this_thread::yield();
  }
}

// How an exchange ended.
enum class Outcome : std::uint8_t {
  answered,
  silent,       // no valid answer in `patience`
  busy,         // another experimenter has the machine
  restarted,    // the machine was restarted, or forgot us after a silence: the experiment must begin again
  stopped,      // the machine's fail-safe stopped it
  interrupted,  // asked to by `interrupt`
};

constexpr std::string_view name(Outcome o) noexcept {
  constexpr std::array<std::string_view, 6> names{"answered", "silent", "busy", "restarted", "stopped", "interrupted"};
  return names[static_cast<std::size_t>(o)];
}

struct ExchangeOptions {
  std::int64_t retry = 20'000'000;         // [ns] between repeats of an order
  std::int64_t patience = 10'000'000'000;  // [ns] until the machine counts as silent
  std::int64_t lapse = 500'000'000;        // [ns] without our machine after which another one's claim is believed
  std::int64_t yield = 3'000'000'000;      // [ns] of being refused; longer than the lease of one who died
  const std::atomic<bool>* interrupt = nullptr;
};

// The experimenter's end. Blocks its thread while it waits; allocates nothing.
template <class End, int Nu, int Ny>
class Lockstep {
 public:
  using Command = Stimulus<Nu>;
  using Reply = Measurement<Ny>;
  static_assert(Link<End, Command, Reply>);

  Lockstep(End& end, FaultCounts& faults, const ExchangeOptions& options) noexcept
      : end_(&end), options_(options), session_(Pace::lockstep, faults) {}

  // Takes the machine, if this session does not have it yet, and begins an experiment; y is of tick 0. Waits for a
  // machine that is not there yet.
  Outcome start(std::int32_t experiment, Reply& y) noexcept {
    if (!open_) session_.open(draw_id());
    open_ = true;
    session_.give(Order::start, experiment, 0, {});
    return settle(y);
  }

  // Holds u for the tick; y is of the next one.
  Outcome exchange(std::int64_t tick, const std::array<double, Nu>& u, Reply& y) noexcept {
    session_.give(Order::hold, session_.order().experiment, tick, u);
    return settle(y);
  }

  // Frees the machine.
  Outcome stop() noexcept {
    if (!open_) return Outcome::answered;
    Reply ignored;
    session_.give(Order::stop, session_.order().experiment, session_.order().tick, {});
    const std::int64_t patience = options_.patience;
    options_.patience = std::min<std::int64_t>(patience, 10 * options_.retry);
    options_.interrupt = nullptr;
    const Outcome o = settle(ignored);
    options_.patience = patience;
    open_ = false;
    return o;
  }

  const ExperimenterSession<Nu, Ny>& session() const noexcept { return session_; }
  std::int64_t repeats() const noexcept { return repeats_; }  // orders sent again

 private:
  Outcome settle(Reply& y) noexcept {
    const Outcome o = ask(y);
    if (o == Outcome::restarted) open_ = false;
    return o;
  }

  Outcome ask(Reply& y) noexcept {
    using News = typename ExperimenterSession<Nu, Ny>::News;
    const std::int64_t begun = steady_ns();
    std::int64_t next = begun;
    bool stranger = false, busy = false;
    for (bool first = true;;) {
      const std::int64_t now = steady_ns();
      if (now >= next) {
        if (options_.interrupt != nullptr && options_.interrupt->load(std::memory_order_relaxed)) {
          return Outcome::interrupted;
        }
        if (now - begun >= options_.patience) return Outcome::silent;
        if (busy && now - begun >= options_.yield) return Outcome::busy;
        if (stranger && now - begun >= options_.lapse) return Outcome::restarted;
        (void)end_->try_send(session_.again());  // when there was no room the next repeat will do
        repeats_ += first ? 0 : 1;
        first = false;
        next = now + options_.retry;
      }
      Reply r;
      if (!end_->try_receive(r)) {
        await(*end_, next - now);
        continue;
      }
      switch (session_.hear(r)) {
        case News::answer:
          y = r;
          return Outcome::answered;
        case News::busy:
          busy = true;
          break;
        case News::unknown:
          return Outcome::restarted;
        case News::stopped:
          return Outcome::stopped;
        case News::stranger:
          stranger = true;
          break;
        case News::none:
        case News::measured:
          break;
      }
    }
  }

  End* end_;
  ExchangeOptions options_;
  ExperimenterSession<Nu, Ny> session_;
  bool open_ = false;
  std::int64_t repeats_ = 0;
};

// The machine's end: answers everything that waits on `end`. The machine is
//   Measurement<Ny> start(std::int32_t experiment)     begin at tick 0 and measure
//   Measurement<Ny> advance(const Stimulus<Nu>&)       hold u for a tick and measure
//   Measurement<Ny> rest()                             no stimulus any more
// Returns the number of messages answered or ignored.
template <class End, class Machine, int Nu, int Ny>
int serve(End& end, MachineSession<Nu, Ny>& session, Machine& machine, std::int64_t now) noexcept {
  using Act = typename MachineSession<Nu, Ny>::Act;
  Stimulus<Nu> c;
  int heard = 0;
  for (; end.try_receive(c); ++heard) {
    switch (session.hear(c, now)) {
      case Act::start:
        (void)end.try_send(session.answer(machine.start(c.experiment), Answer::started));
        break;
      case Act::hold:
        (void)end.try_send(session.answer(machine.advance(c), Answer::measured));
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
      case Act::none:
        break;
    }
  }
  return heard;
}

}  // namespace saltus
