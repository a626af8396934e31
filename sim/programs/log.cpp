// saltus log: LCM event logs to CSV records and back, what is in one, and a logger that loses nothing.
#include <cstdio>
#include <map>

#include "any_record.hpp"
#include "link.hpp"

namespace saltus::program {
namespace {

struct LogOptions {
  std::string from, to, url, json;
  bool append = false;
};

void convert(const LogOptions& o) {
  if (is_event_log(o.from)) {
    const LoggedRun run(o.from);
    const Record record = record_of_log(run);
    write_record(std::filesystem::path(o.to), record);
    std::fprintf(stderr, "%s: %zu experiments, %zu rows\n", o.to.c_str(), run.experiments.size(), record.rows());
  } else {
    const Record record = read_record(std::filesystem::path(o.from));
    write_event_log(o.to, record);
    std::fprintf(stderr, "%s: %zu experiments\n", o.to.c_str(), experiments(record).size());
  }
}

void describe_log(const LogOptions& o) {
  EventLogReader reader(o.from);
  std::map<std::string, std::int64_t> channels;
  LoggedEvent event;
  std::int64_t first = 0, last = 0, events = 0;
  for (; reader.next(event); ++events) {
    ++channels[event.channel];
    if (events == 0) first = event.time;
    last = std::max(last, event.time);
  }
  const LoggedRun run(o.from);
  const double seconds = 1e-6 * static_cast<double>(last - first);
  nlohmann::json j{{"events", events},       {"seconds", seconds},
                   {"channels", channels},   {"damaged_bytes", reader.skipped()},
                   {"refused", run.refused}, {"experiments", nlohmann::json::array()}};
  for (const auto& [e, played] : run.experiments) {
    std::int64_t missing = 0;
    for (const LoggedRun::Sample& s : played.samples) missing += s.measured ? 0 : 1;
    j["experiments"].push_back({{"experiment", e}, {"ticks", played.samples.size()}, {"missing", missing}});
  }
  j["model"] = run.experimenter.id != 0 ? run.experimenter.model.view() : run.machine.model.view();
  if (!o.json.empty()) write_json(o.json, j);
  if (o.json == "-") return;
  std::printf("%s: %lld events in %.3f s%s%s\n", o.from.c_str(), static_cast<long long>(events), seconds,
              j["model"].get<std::string>().empty() ? "" : ", of the model ", j["model"].get<std::string>().c_str());
  for (const auto& [channel, count] : channels) {
    std::printf("  %-16s %10lld\n", channel.c_str(), static_cast<long long>(count));
  }
  for (const auto& e : j["experiments"]) {
    std::printf("  experiment %-5d %10lld ticks, %lld of them without a measurement\n", e["experiment"].get<int>(),
                e["ticks"].get<long long>(), e["missing"].get<long long>());
  }
  if (reader.skipped() > 0) {
    std::printf("  %lld bytes are damaged and were skipped\n", static_cast<long long>(reader.skipped()));
  }
  if (run.refused > 0) std::printf("  %lld messages fail their checks\n", static_cast<long long>(run.refused));
}

// Everything on SALTUS_ channels goes into the log by way of the bus; this only keeps count.
class Listener final : public Port {
 public:
  std::string_view hears() const noexcept override { return {}; }
  std::string_view says() const noexcept override { return {}; }
  std::size_t next(std::span<std::uint8_t>) noexcept override { return 0; }
  void heard(std::string_view, std::span<const std::uint8_t>) noexcept override { ++heard_; }
  std::int64_t heard() const noexcept { return heard_; }

 private:
  std::atomic<std::int64_t> heard_{0};
};

void keep(const LogOptions& o) {
  const StopSignal signals;
  EventLogWriter log(o.from, o.append ? EventLogWriter::Existing::append : EventLogWriter::Existing::replace);
  Listener all;
  Bus bus(o.url, {true, &log});
  bus.attach(all);
  bus.start();
  std::fprintf(stderr, "saltus log: keeps what is said on %s in %s; end with Ctrl-C\n", o.url.c_str(), o.from.c_str());
  Doorbell rest;
  while (!StopSignal::asked().load(std::memory_order_relaxed)) rest.await(50'000'000);
  bus.stop();
  std::printf("%lld messages\n", static_cast<long long>(all.heard()));
  if (log.failed() > 0) {
    throw RunError(o.from + ": " + std::to_string(log.failed()) +
                   " events could not be written; check that there is "
                   "room");
  }
}

void run(const LogOptions& o) {
  if (!o.url.empty()) {
    if (!o.to.empty()) throw UsageError("--link: name one file, the log to write");
    keep(o);
  } else if (!o.to.empty()) {
    if (!o.json.empty()) throw UsageError("--json: it describes one log; leave out the second file");
    convert(o);
  } else {
    describe_log(o);
  }
}

}  // namespace

void add_log(CLI::App& app) {
  auto* command = app.add_subcommand("log", "LCM event logs to CSV records and back; what is in one; a logger");
  command->footer(
      "Examples: saltus log run.lcm                        what is in it\n"
      "          saltus log run.lcm run.csv                the same run as a record\n"
      "          saltus log run.csv run.lcm                and back\n"
      "          saltus log --link udpm:// all.lcm         keep every message, until stopped");
  auto o = std::make_shared<LogOptions>();
  command->add_option("FROM", o->from, "an LCM event log or a CSV record; with --link the log to write")->required();
  command->add_option("TO", o->to, "what to make of it: the other kind");
  command->add_option("--link", o->url, "listen to udpm://[GROUP:PORT][?ttl=N]");
  command->add_flag("--append", o->append, "with --link: go on at the end of the log");
  command->add_option("--json", o->json, "write what is in the log as JSON to FILE, - for standard output")
      ->type_name("FILE");
  command->callback([o] { run(*o); });
}

}  // namespace saltus::program
