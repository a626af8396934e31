// saltus_bridge URL COMMAND [ARGUMENT...]: puts a controller on a serial line onto the bus. Runs the command with the
// line on descriptor 3, takes its orders from there, has them obeyed by the machine at URL in lockstep, and sends back
// what was measured. Exits as the command does; 1 when the machine cannot be had.
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>

#include "hal/lcm/bus.hpp"
#include "hal/lockstep.hpp"
#include "serial.hpp"

namespace {

using namespace saltus;
using End = BusEnd<serial::Order, serial::Reply>;

constexpr int line_of_command = 3;

// The command, with one end of a new line; the other end is `line`. It does not outlive this program.
pid_t launch(char** command, int& line) {
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM, 0, ends) != 0) return -1;
  line = ends[0];
  const pid_t child = ::fork();
  if (child == 0) {
    (void)::prctl(PR_SET_PDEATHSIG, SIGKILL);
    ::close(ends[0]);
    if (ends[1] != line_of_command) {
      (void)::dup2(ends[1], line_of_command);
      ::close(ends[1]);
    }
    ::execvp(command[0], command);
    std::perror(command[0]);
    ::_exit(127);
  }
  ::close(ends[1]);
  return child;
}

// All of it, or false.
bool read_all(int line, std::span<std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::read(line, bytes.data(), bytes.size());
    if (n <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  return true;
}
bool write_all(int line, std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::send(line, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (n <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  return true;
}

// Until the command closes its end, or something fails: then the command hears of a machine that stopped, and ends.
bool serve_line(int line, Lockstep<End, 1, 2>& machine, std::int64_t& exchanges) {
  serial::Frame<serial::Order> frame;
  while (read_all(line, frame)) {
    serial::Order order;
    serial::Reply reply;
    Outcome outcome = Outcome::stopped;
    if (!serial::unframed(frame, order)) {
      std::fprintf(stderr, "bridge: a damaged order came over the line\n");
    } else if (order.order == Order::start) {
      outcome = machine.start(order.experiment, reply);
    } else {
      outcome = machine.exchange(order.tick, order.u, reply);
      ++exchanges;
    }
    if (outcome != Outcome::answered) {
      std::fprintf(stderr, "bridge: the machine is %s\n", std::string(name(outcome)).c_str());
      reply.answer = Answer::stopped;
      reply.status = Status::failed;
    }
    if (!write_all(line, serial::framed(reply)) || outcome != Outcome::answered) return false;
  }
  return true;
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc < 3) {
    std::fprintf(stderr, "usage: saltus_bridge URL COMMAND [ARGUMENT...]\n");
    return 2;
  }
  Bus bus(argv[1]);
  End end(bus, stimulus_channel, measurement_channel);
  int line = -1;
  const pid_t command = launch(argv + 2, line);
  if (command < 0) throw LinkError("no line and no process to be had");
  bus.start();
  Lockstep<End, 1, 2> machine(end, end.faults(), {});
  std::int64_t exchanges = 0;
  const std::int64_t begun = steady_ns();
  const bool good = serve_line(line, machine, exchanges);
  const double seconds = 1e-9 * static_cast<double>(steady_ns() - begun);
  (void)machine.stop();
  int status = 0;
  (void)::waitpid(command, &status, 0);
  std::printf("%lld exchanges, %.0f a second, %lld orders sent again\n", static_cast<long long>(exchanges),
              static_cast<double>(exchanges) / seconds, static_cast<long long>(machine.repeats()));
  if (!good) return 1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
} catch (const LinkError& e) {
  std::fprintf(stderr, "bridge: %s\n", e.what());
  return 1;
}
