// The far end of `saltus identify --link`: a machine over LCM, or the log of one.
#pragma once

#include <chrono>
#include <thread>

#include "../../hal/lcm/logged_run.hpp"
#include "../../hal/lcm/notice_board.hpp"
#include "../../hal/paced.hpp"
#include "../../hal/realtime.hpp"
#include "../identification.hpp"
#include "program.hpp"

namespace saltus::program {

// SIGINT and SIGTERM ask for an orderly end, from the construction of this on.
class StopSignal {
 public:
  StopSignal();
  static const std::atomic<bool>& asked() noexcept;
};

// What `saltus rig` and `saltus identify` have in common.
struct LinkOptions {
  std::string url = "inproc";
  std::string log;         // file
  double rate = 0.0;       // [tick/s]; 0: lockstep
  double patience = 10.0;  // [s]
  std::int64_t fail_safe = 50;
  RealtimeOptions realtime;

  void add_to(CLI::App& command);
  bool inproc() const { return url == "inproc"; }
  bool replay() const { return url.rfind("file://", 0) == 0; }
  Pace pace() const { return rate > 0.0 ? Pace::paced : Pace::lockstep; }
  std::int64_t period() const { return rate > 0.0 ? std::llround(1e9 / rate) : 0; }  // [ns]
  // Realtime set-up as asked; what was not permitted goes to standard error.
  void set_up() const;
};

// "12 lost: 3 checksum, 9 gap" of what a link counted; empty where there is nothing.
std::string describe(const FaultCounts& faults);
Presence presence_of(Role role, std::string_view program, std::string_view model, const LinkOptions& link);
void copy(const FaultCounts& faults, Presence& to);
[[noreturn]] void refuse_outcome(Outcome o, const std::string& url, const std::string& detail);

// Plays experiments to a machine over LCM. One for a whole campaign.
template <int Nu, int Ny>
class MachineOverLink {
 public:
  using End = BusEnd<Stimulus<Nu>, Measurement<Ny>>;

  MachineOverLink(const LinkOptions& options, const Presence& me)
      : options_(options),
        me_(me),
        log_(open_log(options)),
        bus_(options.url, {options.rate <= 0.0, log_.get()}),
        board_(bus_),
        end_(bus_, stimulus_channel, measurement_channel) {
    exchange_.interrupt = &StopSignal::asked();
    exchange_.patience = std::llround(1e9 * options.patience);
    bus_.start();
    if (options.rate > 0.0) {
      paced_.emplace(end_, end_.faults(), exchange_, PacedOptions{4, options.fail_safe}, options.period());
    } else {
      lockstep_.emplace(end_, end_.faults(), exchange_);
    }
  }

  // One experiment, from its beginning again where the machine was restarted in the middle of it. Throws RunError where
  // the machine cannot be had, and says who has it.
  template <class Estimator, class OnSample>
  Status play(std::int32_t experiment, std::span<const double> stimulus, std::span<const Complex> u,
              std::int64_t samples, std::int64_t settle, Estimator& estimator, OnSample&& on_sample) {
    for (int attempt = 0;; ++attempt) {
      say(Activity::running, experiment, 0);
      estimator.restart();
      Outcome outcome = Outcome::answered;
      const auto observe = [&](std::int64_t n, const auto& input, const auto& y) {
        on_sample(n, input, y);
        if (steady_ns() - said_ > 500'000'000) say(Activity::running, experiment, n);
        if (n < settle || !estimator.cycle_completed()) return;
        if (estimator.valid() && Nu == 1) publish(experiment, n, u, estimator);
      };
      const auto run = [&](auto& machine) {
        return play_experiment<Ny, Nu>(machine, experiment, stimulus, samples, settle, estimator, observe, outcome);
      };
      const Status s = paced_ ? run(*paced_) : run(*lockstep_);
      if (outcome == Outcome::answered) {
        if (experiment == 0 && attempt == 0) check_machine();
        return s;
      }
      if (outcome == Outcome::restarted && attempt < 5) {
        ++restarts_;
        continue;
      }
      say(Activity::gone, experiment, 0);
      refuse_outcome(outcome, options_.url, detail(outcome));
    }
  }

  void finish() {
    if (paced_) (void)paced_->stop();
    if (lockstep_) (void)lockstep_->stop();
    say(Activity::finished, me_.experiment, me_.tick);
    bus_.stop();
    if (log_ && log_->failed() > 0) {
      throw RunError(options_.log + ": " + std::to_string(log_->failed()) +
                     " events could not be written; check that there is room");
    }
  }

  // What happened on the way, for people.
  std::vector<std::string> notes() const {
    std::vector<std::string> all;
    const auto count = [&](std::int64_t n, const char* what) {
      if (n > 0) all.push_back(std::to_string(n) + " " + what);
    };
    if (lockstep_) count(lockstep_->repeats(), "orders sent again for want of an answer");
    count(restarts_, "experiments begun again, for the machine was restarted");
    if (paced_) {
      count(paced_->missed(), "measurements missing");
      count(paced_->fail_safe(), "measurements with the machine in fail-safe");
      count(paced_->pacer().late(), "late ticks");
    }
    if (const std::string faults = describe(faults_()); !faults.empty()) all.push_back("on the link: " + faults);
    count(bus_.unsent(), "messages the network did not take");
    count(bus_.malformed(), "packets that are none of LCM's");
    count(board_.dropped(), "estimates not published for want of room");
    return all;
  }

 private:
  static std::unique_ptr<EventLogWriter> open_log(const LinkOptions& o) {
    return o.log.empty() ? nullptr : std::make_unique<EventLogWriter>(o.log);
  }
  const FaultCounts& faults_() const { return const_cast<End&>(end_).faults(); }

  const ExperimenterSession<Nu, Ny>& session() const { return paced_ ? paced_->session() : lockstep_->session(); }

  void say(Activity activity, std::int32_t experiment, std::int64_t tick) noexcept {
    me_.activity = activity;
    me_.experiment = experiment;
    me_.tick = tick;
    me_.session = session().session();
    copy(faults_(), me_);
    (void)board_.post(me_);
    ++me_.sent;
    said_ = steady_ns();
  }

  template <class Estimator>
  void publish(std::int32_t experiment, std::int64_t tick, std::span<const Complex> u,
               const Estimator& estimator) noexcept {
    HtfBins h;
    h.session = session().session();
    h.tick = tick;
    h.experiment = experiment;
    h.sections = estimator.sections();
    h.period = estimator.period();
    h.tones = estimator.tones();
    for (int m = -estimator.harmonics(); m <= estimator.harmonics(); ++m) {
      for (int c = 0; c < Ny; ++c) {
        h.harmonic = m;
        h.output = c;
        h.sent = published_++;
        for (int k = 0; k < estimator.tones(); ++k) {
          const auto i = static_cast<std::size_t>(k);
          h.line[i] = estimator.tone_line(k);
          const bool alone = identifiable(h.line[i], h.period);  // else it takes more experiments than this one
          h.value[i] = alone ? estimator.line(k, m, c) / u[i] : Complex(std::nan(""), std::nan(""));
        }
        (void)board_.post(h);
      }
    }
  }

  // The machine says what it is; where it does not, its numbers of inputs and outputs were right at least.
  void check_machine() const {
    const std::optional<Presence> machine = board_.find(session().machine());
    if (!machine) return;
    const std::string who(machine->who.view());
    const auto differ = [&](const std::string& what, const std::string& theirs, const std::string& ours) {
      throw RunError("--link " + options_.url + ": " + who + " has " + what + " " + theirs + ", not " + ours +
                     "; start both with the same model and options");
    };
    if (machine->model.view() != me_.model.view()) {
      differ("the model", std::string(machine->model.view()), std::string(me_.model.view()));
    }
    if (machine->sections != 0 && machine->sections != me_.sections) {
      differ("a number of sections a cycle of", std::to_string(machine->sections), std::to_string(me_.sections));
    }
    if (machine->pace != me_.pace) {
      differ("the pace", machine->pace == Pace::paced ? "of a clock (--rate)" : "of lockstep",
             me_.pace == Pace::paced ? "of a clock (--rate)" : "of lockstep");
    }
  }

  std::string detail(Outcome o) const {
    if (o == Outcome::busy) {
      // Whoever holds it says so twice a second.
      for (const std::int64_t begin = steady_ns(); steady_ns() - begin < 2'000'000'000;) {
        for (const auto& n : board_.neighbours()) {
          if (n.presence.role == Role::experimenter && n.presence.session != session().session() &&
              n.presence.activity == Activity::running) {
            return "it is held by " + std::string(n.presence.who.view());
          }
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
      }
      return "it is held by another experimenter";
    }
    return describe(faults_());
  }

  LinkOptions options_;
  Presence me_;
  std::unique_ptr<EventLogWriter> log_;
  Bus bus_;
  NoticeBoard board_;
  End end_;
  ExchangeOptions exchange_;
  std::optional<Lockstep<End, Nu, Ny>> lockstep_;
  std::optional<Paced<End, Nu, Ny>> paced_;
  std::int64_t said_ = 0, published_ = 0, restarts_ = 0;
};

// Plays experiments to the log of a machine.
template <int Nu, int Ny>
class MachineOfLog {
 public:
  MachineOfLog(const LinkOptions& options, const Presence& me)
      : url_(options.url), run_(options.url.substr(7)), end_(run_), lockstep_(end_, faults_, {1'000'000, 20'000'000}) {
    if (!run_.experimenter.model.view().empty() && run_.experimenter.model.view() != me.model.view()) {
      throw RunError(run_.file + ": it is the log of the model " + std::string(run_.experimenter.model.view()));
    }
  }

  template <class Estimator, class OnSample>
  Status play(std::int32_t experiment, std::span<const double> stimulus, std::span<const Complex>, std::int64_t samples,
              std::int64_t settle, Estimator& estimator, OnSample&& on_sample) {
    Outcome outcome = Outcome::answered;
    const auto observe = [&](std::int64_t n, const auto& input, const auto& y) {
      reached_ = n;
      on_sample(n, input, y);
    };
    const Status s =
        play_experiment<Ny, Nu>(lockstep_, experiment, stimulus, samples, settle, estimator, observe, outcome);
    if (outcome == Outcome::answered) return s;
    if (end_.differs()) {
      throw RunError(run_.file + ": in experiment " + std::to_string(experiment) +
                     " another stimulus was played; give "
                     "the options of that run (--seed, --amplitude, --period, --subsets, ...)");
    }
    throw RunError(run_.file + ": the log ends in experiment " + std::to_string(experiment) + ", at tick " +
                   std::to_string(reached_) + " of " + std::to_string(samples) +
                   "; what is there can be had by --record " + run_.file);
  }

  void finish() {}
  std::vector<std::string> notes() const {
    std::vector<std::string> all;
    if (run_.skipped_bytes > 0) all.push_back(std::to_string(run_.skipped_bytes) + " bytes of the log are damaged");
    if (run_.refused > 0) all.push_back(std::to_string(run_.refused) + " messages of the log were refused");
    return all;
  }

 private:
  std::string url_;
  LoggedRun run_;
  FaultCounts faults_;
  ReplayEnd<Nu, Ny> end_;
  Lockstep<ReplayEnd<Nu, Ny>, Nu, Ny> lockstep_;
  std::int64_t reached_ = 0;
};

}  // namespace saltus::program
