// Makes this process fit to keep time, as far as it may.
#pragma once

#include <string>
#include <vector>

namespace saltus {

struct RealtimeOptions {
  int priority = 0;          // of SCHED_FIFO, 1 to 99; 0: leave the scheduling as it is
  int cpu = -1;              // to stay on; -1: any
  bool lock_memory = false;  // no page of this process, present or future, leaves the memory
};

// For the calling thread and those it starts later: so call it first. What is not permitted is left as it was; each
// message says what that is and the mend.
std::vector<std::string> set_up_realtime(const RealtimeOptions& options);

}  // namespace saltus
