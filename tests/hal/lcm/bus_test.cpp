#include "hal/lcm/bus.hpp"

#include <atomic>
#include <thread>

#include "hal/lcm/notice_board.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/loop.hpp"
#include "tests/support/malloc_guard.hpp"
#include "tests/support/network.hpp"

using namespace saltus;
using test::Hash;
using test::Plant;

namespace {

using ExperimenterEnd = BusEnd<Stimulus<1>, Measurement<2>>;
using MachineEnd = BusEnd<Measurement<2>, Stimulus<1>>;

// A plant on a thread of its own that answers until it is told to end.
class Rig {
 public:
  explicit Rig(MachineEnd& end, std::int64_t id = draw_id())
      : session_(id, {}, end.faults()), thread_([this, &end] {
          while (!done_.load()) {
            if (serve(end, session_, plant_, steady_ns()) == 0) end.await(1'000'000);
          }
        }) {}
  ~Rig() { stop(); }
  std::int64_t stop() {  // the steps taken
    done_ = true;
    if (thread_.joinable()) thread_.join();
    return plant_.steps;
  }

 private:
  Plant plant_;
  MachineSession<1, 2> session_;
  std::atomic<bool> done_{false};
  std::thread thread_;
};

}  // namespace

TEST_CASE("over memq, with one LCM for both ends, the trajectory is that without a link") {
  Bus bus("memq://");
  ExperimenterEnd here(bus, stimulus_channel, measurement_channel);
  MachineEnd there(bus, measurement_channel, stimulus_channel);
  bus.start();
  Rig rig(there);
  Lockstep<ExperimenterEnd, 1, 2> machine(here, here.faults(), {});
  Hash hash;
  CHECK(drive(machine, 500, hash) == Outcome::answered);
  CHECK(machine.stop() == Outcome::answered);
  CHECK(rig.stop() == 500);
  CHECK(hash.value == test::reference(500).value);
  CHECK(hash.value != test::reference(500, 1).value);
  CHECK(bus.unsent() == 0);
}

TEST_CASE("over udpm, with a bus for each end, the trajectory is that without a link") {
  SALTUS_OWN_NETWORK();
  Bus bus("udpm://"), other("udpm://239.255.76.67:7667?ttl=0");
  ExperimenterEnd here(bus, stimulus_channel, measurement_channel);
  MachineEnd there(other, measurement_channel, stimulus_channel);
  bus.start();
  other.start();
  Rig rig(there);
  Lockstep<ExperimenterEnd, 1, 2> machine(here, here.faults(), {});
  for (const std::int32_t experiment : {0, 3}) {
    Hash hash;
    CHECK(drive(machine, 1000, hash, experiment) == Outcome::answered);
    CHECK(hash.value == test::reference(1000, experiment).value);
  }
  CHECK(machine.stop() == Outcome::answered);
  CHECK(rig.stop() == 2000);
}
