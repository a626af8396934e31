#include "logged_run.hpp"

#include <cmath>
#include <fstream>
#include <limits>
#include <set>
#include <utility>

namespace saltus {
namespace {

constexpr std::int64_t longest = std::int64_t{1} << 24;  // [tick] of an experiment
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// Follows the conversation event by event.
class Follower {
 public:
  explicit Follower(LoggedRun& run) : run_(run) {}

  void stimulus(std::span<const std::uint8_t> bytes) {
    Stimulus<max_inputs> s;
    int inputs = 0;
    if (!decode(bytes, s, inputs).good) {
      ++run_.refused;
      return;
    }
    Talk& talk = talks_[s.session];
    if (s.order == Order::start && talk.starts.insert(s.seq).second) {
      talk.start = s.seq;
      talk.experiment = s.experiment;
      run_.experiments[s.experiment] = {s.session, {}};
      run_.inputs = inputs;
    }
    if (s.order != Order::hold || talk.start < 0 || s.seq < talk.start) return;
    LoggedRun::Played& played = run_.experiments[talk.experiment];
    if (played.session != s.session || s.tick >= longest) return;
    LoggedRun::Sample& sample = at(played, s.tick);
    if (sample.told) return;
    sample.u = s.u;
    sample.told = true;
  }

  void measurement(std::span<const std::uint8_t> bytes) {
    Measurement<max_outputs> m;
    int outputs = 0;
    if (!decode(bytes, m, outputs).good) {
      ++run_.refused;
      return;
    }
    const bool of_a_tick = m.answer == Answer::measured || m.answer == Answer::started || m.answer == Answer::fail_safe;
    const auto found = talks_.find(m.session);
    if (!of_a_tick || found == talks_.end() || found->second.start < 0 || m.seq < found->second.start) return;
    LoggedRun::Played& played = run_.experiments[found->second.experiment];
    if (played.session != m.session || m.tick >= longest) return;
    LoggedRun::Sample& sample = at(played, m.tick);
    if (sample.measured) return;
    run_.outputs = outputs;
    sample.y = m.y;
    sample.status = m.status;
    sample.measured = true;
  }

  void presence(std::span<const std::uint8_t> bytes) {
    Presence p;
    if (!decode(bytes, p).good) {
      ++run_.refused;
      return;
    }
    (p.role == Role::machine ? run_.machine : run_.experimenter) = p;
  }

 private:
  struct Talk {
    std::int64_t start = -1;  // seq
    std::int32_t experiment = 0;
    std::set<std::int64_t> starts;
  };

  static LoggedRun::Sample& at(LoggedRun::Played& played, std::int64_t tick) {
    const auto i = static_cast<std::size_t>(tick);
    while (played.samples.size() <= i) {
      played.samples.emplace_back().y.fill(nan);
      played.samples.back().u.fill(nan);
    }
    return played.samples[i];
  }

  LoggedRun& run_;
  std::map<std::int64_t, Talk> talks_;
};

std::vector<Channel> channels(const LoggedRun& run, const std::vector<Channel>& names, int count, const char* what) {
  std::vector<Channel> all = names;
  if (all.empty()) {
    for (int i = 1; i <= count; ++i) all.push_back({what + std::to_string(i), "", {}});
  }
  if (all.size() != static_cast<std::size_t>(count)) {
    throw LogError(run.file + ": its messages carry " + std::to_string(count) + " values of " + what +
                   ", but there are " + std::to_string(all.size()) + " names; name the model that was driven");
  }
  return all;
}

}  // namespace

LoggedRun::LoggedRun(const std::filesystem::path& path) : file(path.string()) {
  EventLogReader reader(path);
  Follower follower(*this);
  LoggedEvent event;
  while (reader.next(event)) {
    ++events;
    if (event.channel == stimulus_channel) {
      follower.stimulus(event.data);
    } else if (event.channel == measurement_channel) {
      follower.measurement(event.data);
    } else if (event.channel == status_channel) {
      follower.presence(event.data);
    } else if (event.channel != htf_channel) {
      ++foreign;
    }
  }
  skipped_bytes = reader.skipped();
}

bool is_event_log(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::array<char, 4> head{};
  in.read(head.data(), head.size());
  return in && head == std::array{'\xED', '\xA1', '\xDA', '\x01'};
}

Record record_of(const LoggedRun& run, const std::vector<Channel>& inputs, const std::vector<Channel>& outputs) {
  if (run.experiments.empty()) {
    throw LogError(run.file + ": there is no experiment in it; it holds " + std::to_string(run.events) +
                   " events, of which those on " + stimulus_channel + " and " + measurement_channel + " would count");
  }
  Record r;
  r.name = run.file;
  const Presence& by = run.experimenter.id != 0 ? run.experimenter : run.machine;
  r.model = by.model.view();
  r.sections = "clock";
  if (by.sections > 0) r.sections_per_cycle = by.sections;
  if (by.cycle_period > 0.0) r.cycle_period = by.cycle_period;
  if (by.stimulus_period > 0) {
    r.stimulus_period_cycles = by.stimulus_period;
    r.settle_cycles = by.settle;
  }
  r.inputs = channels(run, inputs, run.inputs, "u");
  r.outputs = channels(run, outputs, run.outputs, "y");
  const int sections = by.sections > 0 ? by.sections : 1;
  const double period = by.cycle_period > 0.0 ? by.cycle_period : sections;
  for (const auto& [e, played] : run.experiments) {
    for (std::size_t n = 0; n < played.samples.size(); ++n) {
      const LoggedRun::Sample& s = played.samples[n];
      if (!s.told && n + 1 == played.samples.size()) continue;  // the answer to the last order: nothing is held from it
      r.experiment.push_back(e);
      r.cycle.push_back(static_cast<int>(n) / sections);
      r.section.push_back(static_cast<int>(n) % sections);
      r.t.push_back(static_cast<double>(n) * period / sections);
      for (std::size_t i = 0; i < r.inputs.size(); ++i) r.inputs[i].values.push_back(s.u[i]);
      for (std::size_t i = 0; i < r.outputs.size(); ++i) {
        r.outputs[i].values.push_back(s.status == Status::missing ? nan : s.y[i]);
      }
    }
  }
  if (!r.sections_per_cycle) {
    r.sections.clear();
    r.cycle.clear();
    r.section.clear();
  }
  return r;
}

void write_event_log(const std::filesystem::path& path, const Record& record) {
  const auto refuse = [&](const std::string& what, const std::string& mend) {
    throw RecordError(record.name, what, mend);
  };
  if (!record.clock_paced()) {
    refuse("it has no sections, so that its rows have no ticks", "add `# sections-per-cycle` and the like");
  }
  if (record.inputs.size() > max_inputs || record.outputs.size() > max_outputs) {
    refuse("a message holds " + std::to_string(max_inputs) + " inputs and " + std::to_string(max_outputs) + " outputs",
           "leave out what is not needed");
  }
  EventLogWriter log(path);
  std::array<std::uint8_t, largest_message> bytes{};
  bool good = true;
  const auto write = [&](double t, std::string_view channel, std::size_t size) {
    good = good && log.write(std::llround(1e6 * t), channel, std::span(bytes).first(size));
  };
  const auto inputs = static_cast<int>(record.inputs.size()), outputs = static_cast<int>(record.outputs.size());
  Presence by;
  by.role = Role::experimenter;
  by.activity = Activity::finished;
  by.id = by.session = 1;
  by.sections = *record.sections_per_cycle;
  by.cycle_period = record.cycle_period.value_or(0.0);
  by.stimulus_period = record.stimulus_period_cycles.value_or(0);
  by.settle = record.settle_cycles.value_or(0);
  by.who = std::string_view("saltus log");
  by.model = record.model;
  write(0.0, status_channel, encode(by, bytes));

  std::int64_t seq = -1, sent = 0;
  double begun = 0.0;  // [s] experiments follow one another in the log's time
  for (const Experiment& e : experiments(record)) {
    const Grid grid = on_grid(record, e);
    const auto samples = static_cast<std::int64_t>(grid.cycles) * grid.sections;
    const double step = by.cycle_period > 0.0 ? by.cycle_period / by.sections : 1.0;
    const auto row = [&](std::int64_t n) { return static_cast<std::size_t>(n); };
    const auto measurement = [&](std::int64_t n, Answer answer) {
      Measurement<max_outputs> m{1, seq, n, {}, Status::ok, answer, 1, sent++};
      for (std::size_t i = 0; i < record.outputs.size(); ++i) {
        m.y[i] = grid.outputs[i][row(n)];
        if (!std::isfinite(m.y[i])) m.status = Status::missing;
      }
      write(begun + static_cast<double>(n) * step, measurement_channel, encode(m, outputs, bytes));
    };
    Stimulus<max_inputs> s{1, ++seq, 0, {}, Order::start, e.id, seq};
    write(begun, stimulus_channel, encode(s, inputs, bytes));
    measurement(0, Answer::started);
    for (std::int64_t n = 0; n < samples; ++n) {
      s = {1, ++seq, n, {}, Order::hold, e.id, seq};
      for (std::size_t i = 0; i < record.inputs.size(); ++i) s.u[i] = grid.inputs[i][row(n)];
      write(begun + static_cast<double>(n) * step, stimulus_channel, encode(s, inputs, bytes));
      if (n + 1 < samples) measurement(n + 1, Answer::measured);
    }
    begun += static_cast<double>(samples) * step;
  }
  if (!good) throw LogError(path.string() + ": the log could not be written to its end; check that there is room");
}

}  // namespace saltus
