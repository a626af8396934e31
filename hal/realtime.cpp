#include "realtime.hpp"

#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>

namespace saltus {
namespace {

// Touches the stack that the loop will use, so that its pages are there before it starts.
void touch_stack() noexcept {
  std::array<volatile std::uint8_t, 256 * 1024> pages;
  for (std::size_t i = 0; i < pages.size(); i += 1024) pages[i] = 0;
}

}  // namespace

std::vector<std::string> set_up_realtime(const RealtimeOptions& options) {
  std::vector<std::string> messages;
  const auto complain = [&](const std::string& what, const std::string& mend) {
    messages.push_back(what + " (" + std::strerror(errno) + "); " + mend);
  };
  if (options.lock_memory) {
    if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
      complain("memory is not locked",
               "raise the limit (ulimit -l unlimited) or run: sudo setcap cap_ipc_lock,"
               "cap_sys_nice+ep PROGRAM");
    } else {
      touch_stack();
    }
  }
  if (options.cpu >= 0) {
    cpu_set_t one;
    CPU_ZERO(&one);
    if (options.cpu < CPU_SETSIZE) CPU_SET(static_cast<unsigned>(options.cpu), &one);
    if (::sched_setaffinity(0, sizeof one, &one) != 0) {
      complain("not kept on processor " + std::to_string(options.cpu),
               "this machine has processors 0 to " + std::to_string(::sysconf(_SC_NPROCESSORS_ONLN) - 1));
    }
  }
  if (options.priority > 0) {
    sched_param p{};
    p.sched_priority = options.priority;
    if (::sched_setscheduler(0, SCHED_FIFO, &p) != 0) {
      complain("scheduling stays ordinary, without priority " + std::to_string(options.priority),
               "allow it (ulimit -r 99) or run: sudo setcap cap_sys_nice+ep PROGRAM");
    }
  }
  return messages;
}

}  // namespace saltus
