// saltus link-test: what a link is worth, and what the network lacks.
#include <algorithm>
#include <cstdio>

#include "link.hpp"

namespace saltus::program {
namespace {

constexpr char ping_channel[] = "SALTUS_PING", pong_channel[] = "SALTUS_PONG";
using PingEnd = BusEnd<Stimulus<1>, Measurement<2>, 1024>;
using PongEnd = BusEnd<Measurement<2>, Stimulus<1>, 1024>;

struct TestOptions {
  std::string url = "udpm://", json;
  int count = 2000;
  bool echo = false, remote = false;
};

// Sends back whatever comes, once, on a thread of its own.
class Echo {
 public:
  explicit Echo(const std::string& url)
      : bus_(url), end_(bus_, pong_channel, ping_channel), thread_([this] {
          while (!done_.load(std::memory_order_relaxed)) {
            Stimulus<1> s;
            while (end_.try_receive(s)) {
              (void)end_.try_send({s.session, s.seq, s.tick, {s.u[0], 0.0}, Status::ok, Answer::measured, 1, s.sent});
            }
            end_.await(10'000'000);
          }
        }) {
    bus_.start();
  }
  ~Echo() {
    done_ = true;
    thread_.join();
  }
  std::int64_t heard() const noexcept { return end_.received(); }

 private:
  Bus bus_;
  PongEnd end_;
  std::atomic<bool> done_{false};
  std::thread thread_;
};

struct Result {
  std::int64_t sent = 0, lost = 0;  // one after the other
  std::int64_t burst = 0, burst_lost = 0, reordered = 0, duplicates = 0;
  std::vector<double> round_trip;  // [us] sorted
  double at(double share) const {
    return round_trip.empty()
               ? 0.0
               : round_trip[static_cast<std::size_t>(share * static_cast<double>(round_trip.size() - 1))];
  }
};

Result measure(PingEnd& end, int count) {
  Result r;
  const std::int64_t session = draw_id();
  Stimulus<1> s;
  s.session = session;
  const auto receive = [&](std::int64_t until, Measurement<2>& m) {
    for (;;) {
      if (end.try_receive(m)) {
        if (m.session == session) return true;
        continue;
      }
      const std::int64_t left = until - steady_ns();
      if (left <= 0 || StopSignal::asked().load(std::memory_order_relaxed)) return false;
      end.await(left);
    }
  };
  for (int i = 0; i < count && !StopSignal::asked().load(); ++i, ++s.seq, ++s.sent) {
    const std::int64_t begun = steady_ns();
    (void)end.try_send(s);
    ++r.sent;
    Measurement<2> m;
    bool answered = false;
    while (!answered && receive(begun + 100'000'000, m)) {
      if (m.seq == s.seq)
        answered = true;
      else
        ++r.duplicates;
    }
    if (answered) {
      r.round_trip.push_back(1e-3 * static_cast<double>(steady_ns() - begun));
    } else if (++r.lost >= 20 && r.round_trip.empty()) {
      break;  // nobody there
    }
  }
  // In bursts, so that one can overtake another.
  FaultCounts faults;
  Arrivals arrivals;
  std::int64_t came = 0;
  const std::int64_t first = s.seq;
  for (int i = 0; i < count && !r.round_trip.empty() && !StopSignal::asked().load(); i += 32) {
    for (int k = 0; k < 32; ++k, ++s.seq, ++s.sent) (void)end.try_send(s);
    r.burst += 32;
    Measurement<2> m;
    const std::int64_t limit = steady_ns() + 50'000'000;
    for (std::int64_t in_burst = 0; in_burst < 32 && receive(limit, m); ++in_burst) {
      if (m.seq >= first && arrivals.note(m.seq, faults)) ++came;
    }
  }
  r.burst_lost = r.burst - came;
  r.reordered = faults[Fault::late];
  r.duplicates += faults[Fault::duplicate];
  std::sort(r.round_trip.begin(), r.round_trip.end());
  return r;
}

void report(const TestOptions& o, const Result& r) {
  const nlohmann::json j{
      {"link", o.url},
      {"exchanges", r.sent},
      {"lost", r.lost},
      {"round_trip_us", {{"min", r.at(0.0)}, {"median", r.at(0.5)}, {"p99", r.at(0.99)}, {"max", r.at(1.0)}}},
      {"burst", {{"sent", r.burst}, {"lost", r.burst_lost}, {"reordered", r.reordered}}},
      {"duplicates", r.duplicates}};
  if (!o.json.empty()) write_json(o.json, j);
  if (o.json == "-") return;
  std::printf("%s%s\n", o.url.c_str(), o.remote ? ", echoed elsewhere" : ", both ends in this process");
  std::printf("  one after the other  %lld exchanges, %lld lost\n", static_cast<long long>(r.sent),
              static_cast<long long>(r.lost));
  std::printf("  round trip           min %.1f, median %.1f, 99 %% below %.1f, max %.1f us\n", r.at(0.0), r.at(0.5),
              r.at(0.99), r.at(1.0));
  std::printf("  in bursts of 32      %lld messages, %lld lost, %lld overtaken, %lld doubled\n",
              static_cast<long long>(r.burst), static_cast<long long>(r.burst_lost),
              static_cast<long long>(r.reordered), static_cast<long long>(r.duplicates));
}

void run(const TestOptions& o) {
  const StopSignal signals;
  const std::string lacks = what_the_network_lacks(MulticastAddress::parse(o.url));
  if (!lacks.empty()) throw RunError(lacks);
  if (o.echo) {
    Echo echo(o.url);
    std::fprintf(stderr, "saltus link-test: echoes on %s; end with Ctrl-C\n", o.url.c_str());
    Doorbell rest;
    while (!StopSignal::asked().load()) rest.await(50'000'000);
    std::printf("%lld messages echoed\n", static_cast<long long>(echo.heard()));
    return;
  }
  std::unique_ptr<Echo> echo;
  if (!o.remote) echo = std::make_unique<Echo>(o.url);
  Bus bus(o.url);
  PingEnd end(bus, ping_channel, pong_channel);
  bus.start();
  const Result r = measure(end, o.count);
  report(o, r);
  if (r.round_trip.empty()) {
    throw RunError("--link " + o.url + ": nothing came back" +
                   (o.remote ? "; start saltus link-test --echo with the same --link on the other machine, with ttl=1 "
                               "on both, and a route for 224.0.0.0/4 to the network between them"
                             : ""));
  }
}

}  // namespace

void add_link_test(CLI::App& app) {
  auto* command = app.add_subcommand("link-test", "Round trip, loss and reordering of a link, and what it lacks");
  command->footer(
      "Examples: saltus link-test                                           on this machine\n"
      "          saltus link-test --link 'udpm://?ttl=1' --echo             on one machine, and on the other\n"
      "          saltus link-test --link 'udpm://?ttl=1' --remote");
  auto o = std::make_shared<TestOptions>();
  command->add_option("--link", o->url, "udpm://[GROUP:PORT][?ttl=N]")->capture_default_str();
  command->add_option("--count", o->count, "exchanges")->check(CLI::Range(1, 1000000))->capture_default_str();
  auto* echo = command->add_flag("--echo", o->echo, "only send back what comes, until stopped");
  command->add_flag("--remote", o->remote, "the echo is elsewhere")->excludes(echo);
  command->add_option("--json", o->json, "write JSON to FILE, - for standard output")->type_name("FILE");
  command->callback([o] { run(*o); });
}

}  // namespace saltus::program
