// What `saltus rig` does with a model, once it is known. Included by one source for plain models and one for models
// with effects, for both are dear to compile.
#pragma once

#include <cmath>
#include <cstdio>

#include "../campaign.hpp"
#include "link.hpp"
#include "sections.hpp"

namespace saltus::program {

struct RigOptions {
  ModelChoice model;
  SectionChoice sections;
  LinkOptions link;
  std::vector<double> noise, quantum;
  std::vector<std::string> effects;
  int delay = 0;
  double jitter = 0.0;  // [s]
  std::uint64_t seed = 1;
};

template <class M>
Output<M> one_an_output(const std::vector<double>& values, const char* option) {
  Output<M> all = Output<M>::Zero();
  if (values.empty()) return all;
  if (values.size() != static_cast<std::size_t>(output_count<M>)) {
    throw UsageError(std::string(option) + ": " + std::string(M::name) + " has " + std::to_string(output_count<M>) +
                     " outputs; give one number for each");
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!(values[i] >= 0.0) || !std::isfinite(values[i])) {
      throw UsageError(std::string(option) + " " + number(values[i]) + ": write a finite number, 0 or above");
    }
    all[static_cast<int>(i)] = values[i];
  }
  return all;
}

// Keeps the others informed, and finds out whether this machine may be here at all.
class Announcer {
 public:
  Announcer(NoticeBoard& board, const Presence& me) : board_(board), me_(me) {}

  void say(Activity activity, const std::string& note) noexcept {
    me_.activity = activity;
    me_.note = note;
    (void)board_.post(me_);
    ++me_.sent;
    said_ = steady_ns();
  }
  bool due() const noexcept { return steady_ns() - said_ > 500'000'000; }
  Presence& me() noexcept { return me_; }

  // Of two machines on the same channels the later one goes.
  void check_alone(const std::string& url) const {
    for (const auto& n : board_.neighbours()) {
      const bool here = n.presence.activity != Activity::gone && steady_ns() - n.heard < 1'500'000'000;
      if (n.presence.role != Role::machine || !here || n.presence.born > me_.born) continue;
      throw RunError("--link " + url + ": " + std::string(n.presence.who.view()) +
                     " is the machine there already; stop it, or choose another port, for example "
                     "udpm://239.255.76.67:7668");
    }
  }

 private:
  NoticeBoard& board_;
  Presence me_;
  std::int64_t said_ = 0;
};

template <int Nu, int Ny>
class Server {
 public:
  using End = BusEnd<Measurement<Ny>, Stimulus<Nu>>;

  Server(const LinkOptions& link, const Presence& me)
      : link_(link),
        log_(link.log.empty() ? nullptr : std::make_unique<EventLogWriter>(link.log)),
        bus_(link.url, {link.rate <= 0.0, log_.get()}),
        board_(bus_),
        end_(bus_, measurement_channel, stimulus_channel),
        session_(me.id, {link.pace(), 2'000'000'000, link.fail_safe}, end_.faults()),
        announcer_(board_, me),
        pacer_(link.period()) {
    bus_.start();
  }

  // Until a signal.
  template <class R>
  void run(R& rig) {
    announcer_.say(Activity::idle, "waits for an experimenter");
    pacer_.start();
    std::int64_t tick = 0;
    for (std::int64_t looked = 0; !StopSignal::asked().load(std::memory_order_relaxed);) {
      const std::int64_t now = steady_ns();
      if (link_.pace() == Pace::paced) {
        pacer_.wait();
        run_tick(end_, session_, rig, tick, steady_ns());
      } else if (serve(end_, session_, rig, now) == 0) {
        end_.await(20'000'000);
      }
      report(tick);
      if (now - looked < 200'000'000) continue;
      looked = now;
      if (!session_.running() || link_.pace() == Pace::lockstep) announcer_.check_alone(link_.url);
    }
    announcer_.say(Activity::gone, "stopped by a signal");
    bus_.stop();
  }

  void print() {
    std::printf("%lld messages heard", static_cast<long long>(end_.received()));
    const std::string faults = describe(end_.faults());
    std::printf("%s%s", faults.empty() ? "" : "; on the link: ", faults.c_str());
    if (bus_.unsent() + bus_.malformed() > 0) {
      std::printf("; %lld not taken by the network, %lld packets none of LCM's", static_cast<long long>(bus_.unsent()),
                  static_cast<long long>(bus_.malformed()));
    }
    std::printf("\n");
    if (link_.pace() == Pace::paced) {
      std::printf(
          "%lld ticks, %lld of them late (mean %.0f us, worst %.0f us); %lld without a command of their own, up "
          "to %lld in a row; fail-safe %lld times\n",
          static_cast<long long>(pacer_.ticks()), static_cast<long long>(pacer_.late()), 1e-3 * pacer_.mean(),
          1e-3 * static_cast<double>(pacer_.worst()), static_cast<long long>(session_.missed()),
          static_cast<long long>(session_.worst_age()), static_cast<long long>(fail_safes_));
    }
    if (log_ && log_->failed() > 0) {
      throw RunError(link_.log + ": " + std::to_string(log_->failed()) +
                     " events could not be written; check that there is room");
    }
  }

 private:
  void report(std::int64_t tick) {
    const bool running = session_.running(), failing = running && session_.failing();
    const bool changed = running != running_ || failing != failing_ || session_.session() != said_session_ ||
                         session_.experiment() != announcer_.me().experiment;
    if (!changed && !announcer_.due()) return;
    if (failing && !failing_) ++fail_safes_;
    Presence& me = announcer_.me();
    me.session = session_.session();
    me.experiment = session_.experiment();
    me.tick = tick;
    me.missed = session_.missed();
    copy(end_.faults(), me);
    const bool stopped_itself = running_ && !running && failing_;
    announcer_.say(failing   ? Activity::fail_safe
                   : running ? Activity::running
                             : Activity::idle,
                   failing          ? "holds zero, for no commands come"
                   : running        ? "in an experiment"
                   : stopped_itself ? "stopped, for no commands came"
                                    : "waits for an experimenter");
    if (changed) {
      std::fprintf(stderr, "saltus rig: %s%s\n", me.note.chars.data(),
                   running ? (", number " + std::to_string(me.experiment)).c_str() : "");
    }
    running_ = running;
    failing_ = failing;
    said_session_ = session_.session();
  }

  LinkOptions link_;
  std::unique_ptr<EventLogWriter> log_;
  Bus bus_;
  NoticeBoard board_;
  End end_;
  MachineSession<Nu, Ny> session_;
  Announcer announcer_;
  Pacer pacer_;
  bool running_ = false, failing_ = false;
  std::int64_t said_session_ = 0, fail_safes_ = 0;
};

template <class M, class Family>
void serve_model(const M& m, const Family& family, const RigOptions& o) {
  constexpr int nu = input_count<M>, ny = output_count<M>;
  const Timebase base = timebase_of(m, o.model.ticks);
  const auto system = std::make_unique<LdtpOf<M, sections_per_cycle>>();
  const auto orbit = find_orbit<sections_per_cycle>(m, base, family, *system);
  if (orbit.status != Status::ok) {
    throw RunError(std::string(M::name) + ": no limit cycle found (" + std::string(name(orbit.status)) +
                   "); change --set or --effect");
  }
  Run<M> start;
  start.at = orbit.point[0];
  const auto rig =
      std::make_unique<Rig<M, Family>>(m, base, family, start, one_an_output<M>(o.noise, "--noise"), o.seed);
  rig->degrade(one_an_output<M>(o.quantum, "--quantum"), o.delay);
  rig->jitter(o.jitter);

  const StopSignal signals;
  o.link.set_up();
  Presence me = presence_of(Role::machine, "rig", M::name, o.link);
  me.sections = sections_per_cycle;
  me.cycle_period = base.period;
  const auto server = std::make_unique<Server<nu, ny>>(o.link, me);
  std::printf("%s on %s, %s; end with Ctrl-C\n", std::string(me.who.view()).c_str(), o.link.url.c_str(),
              o.link.pace() == Pace::paced ? (number(o.link.rate) + " ticks a second").c_str() : "lockstep");
  std::fflush(stdout);
  server->run(*rig);
  server->print();
}

// Calls serve_model with the chosen model and the effects of --effect added.
void serve_with_effects(const RigOptions& o);

}  // namespace saltus::program
