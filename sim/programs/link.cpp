#include "link.hpp"

#include <csignal>
#include <cstdio>

namespace saltus::program {
namespace {

std::atomic<bool> stop_asked{false};
static_assert(std::atomic<bool>::is_always_lock_free);

extern "C" void ask_to_stop(int) { stop_asked.store(true, std::memory_order_relaxed); }

}  // namespace

StopSignal::StopSignal() {
  struct sigaction action {};
  action.sa_handler = &ask_to_stop;
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
}
const std::atomic<bool>& StopSignal::asked() noexcept { return stop_asked; }

void LinkOptions::add_to(CLI::App& command) {
  command.add_option("--log", log, "keep every message as an LCM event log")->type_name("FILE");
  command
      .add_option("--rate", rate,
                  "paced by the clock at so many ticks a second, both ends alike (default: lockstep, each tick as soon "
                  "as it is answered)")
      ->type_name("HZ")
      ->check(CLI::Range(0.01, 100000.0));
  command.add_option("--fail-safe", fail_safe, "paced: ticks without a word from the other side until zero stimulus")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  command.add_option("--priority", realtime.priority, "paced: SCHED_FIFO priority, 1 to 99")->check(CLI::Range(1, 99));
  command.add_option("--cpu", realtime.cpu, "paced: stay on this processor")->check(CLI::Range(0, 1023));
  command.add_flag("--lock-memory", realtime.lock_memory, "paced: keep all memory from being swapped out");
}

void LinkOptions::set_up() const {
  for (const std::string& message : set_up_realtime(realtime)) std::fprintf(stderr, "saltus: %s\n", message.c_str());
}

std::string describe(const FaultCounts& faults) {
  std::string s;
  for (std::size_t i = 0; i < fault_count; ++i) {
    const auto f = static_cast<Fault>(i);
    if (faults[f] != 0) s += (s.empty() ? "" : ", ") + std::to_string(faults[f]) + " " + std::string(name(f));
  }
  return s;
}

void copy(const FaultCounts& faults, Presence& to) {
  for (std::size_t i = 0; i < fault_count; ++i) to.faults[i] = faults[static_cast<Fault>(i)];
}

Presence presence_of(Role role, std::string_view program, std::string_view model, const LinkOptions& link) {
  Presence p;
  p.role = role;
  p.pace = link.pace();
  p.id = draw_id();
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  p.born = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
  p.who = who_am_i(program);
  p.model = model;
  return p;
}

void refuse_outcome(Outcome o, const std::string& url, const std::string& detail) {
  const std::string at = "--link " + url + ": ";
  const std::string more = detail.empty() ? "" : " (" + detail + ")";
  switch (o) {
    case Outcome::busy:
      throw RunError(at + "the machine refuses; " + detail + ": wait until it is free, or choose another port");
    case Outcome::restarted:
      throw RunError(at + "the machine was restarted again and again" + more + "; look at what it says");
    case Outcome::stopped:
      throw RunError(at + "the machine's fail-safe stopped it, for too many commands did not come in time" + more +
                     "; lower --rate, or raise --fail-safe");
    case Outcome::interrupted:
      throw RunError(at + "interrupted; the machine has been told to stop");
    case Outcome::silent:
    case Outcome::answered:
      break;
  }
  throw RunError(
      at + "no machine answers" + more +
      "; start one (saltus rig MODEL --link URL), and see what the network lacks with saltus link-test --link " + url);
}

}  // namespace saltus::program
