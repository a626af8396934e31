// What an LCM event log tells of a run: every experiment as it went, to be replayed or kept as a record; and a record
// as an event log. What was heard goes through the same decoding as it did then.
#pragma once

#include <filesystem>
#include <map>
#include <vector>

#include "../event_log.hpp"
#include "../record.hpp"
#include "codec.hpp"

namespace saltus {

struct LoggedRun {
  // Between a tick and the next.
  struct Sample {
    std::array<double, max_inputs> u{};
    std::array<double, max_outputs> y{};  // measured at the tick
    Status status = Status::missing;      // of the machine at the tick; missing: there is no y
    bool told = false, measured = false;  // there is a u, there is a y
  };
  struct Played {
    std::int64_t session = 0;
    std::vector<Sample> samples;  // by tick
  };

  std::string file;
  std::map<std::int32_t, Played> experiments;  // the last attempt at each
  Presence machine, experimenter;              // as last said; id 0: nothing heard
  int inputs = 0, outputs = 0;
  std::int64_t events = 0, foreign = 0, refused = 0, skipped_bytes = 0;

  explicit LoggedRun(const std::filesystem::path& path);  // throws LogError
};

// True where the file begins as an event log does.
bool is_event_log(const std::filesystem::path& path);

// `inputs` and `outputs` name the channels; where they are empty these are u1, u2 ..., y1, y2 ... Throws LogError where
// there is no experiment in the log, or another number of channels.
Record record_of(const LoggedRun& run, const std::vector<Channel>& inputs = {},
                 const std::vector<Channel>& outputs = {});

// Throws LogError; RecordError where the record is not paced by a clock, or has too many channels.
void write_event_log(const std::filesystem::path& path, const Record& record);

// The machine of a log: answers each order as it was answered then. A Link for Lockstep.
template <int Nu, int Ny>
class ReplayEnd {
 public:
  explicit ReplayEnd(const LoggedRun& run) noexcept : run_(&run) {}

  [[nodiscard]] bool try_send(const Stimulus<Nu>& c) noexcept {
    experiment_ = c.order == Order::start ? c.experiment : experiment_;
    const auto played = run_->experiments.find(experiment_);
    if (c.order == Order::stop || played == run_->experiments.end()) return true;
    const auto& samples = played->second.samples;
    const std::size_t at = static_cast<std::size_t>(c.tick) + (c.order == Order::hold ? 1 : 0);
    if (at >= samples.size()) return true;
    if (c.order == Order::hold) {
      const LoggedRun::Sample& before = samples[at - 1];
      differs_ = differs_ || !before.told || !std::equal(c.u.begin(), c.u.end(), before.u.begin());
      if (differs_) return true;
    }
    reply_.session = c.session;
    reply_.seq = c.seq;
    reply_.tick = c.tick + (c.order == Order::hold ? 1 : 0);
    reply_.machine = 1;
    reply_.sent = sent_++;
    reply_.answer = c.order == Order::start ? Answer::started : Answer::measured;
    reply_.status = samples[at].status;
    std::copy(samples[at].y.begin(), samples[at].y.begin() + Ny, reply_.y.begin());
    waiting_ = true;
    return true;
  }
  [[nodiscard]] bool try_receive(Measurement<Ny>& m) noexcept {
    if (!waiting_) return false;
    m = reply_;
    waiting_ = false;
    return true;
  }

  bool differs() const noexcept { return differs_; }  // an order was not the one of the log

 private:
  const LoggedRun* run_;
  Measurement<Ny> reply_;
  std::int32_t experiment_ = 0;
  std::int64_t sent_ = 0;
  bool waiting_ = false, differs_ = false;
};

}  // namespace saltus
