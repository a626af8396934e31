#include "hal/lcm/bus.hpp"

#include <atomic>
#include <chrono>
#include <memory>
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

TEST_CASE("either side may start first, and either may be restarted in mid-experiment") {
  SALTUS_OWN_NETWORK();
  Bus bus("udpm://"), other("udpm://");
  ExperimenterEnd here(bus, stimulus_channel, measurement_channel);
  MachineEnd there(other, measurement_channel, stimulus_channel);
  bus.start();
  other.start();
  ExchangeOptions options;
  options.retry = 5'000'000;
  options.lapse = 50'000'000;
  Hash hash;
  Plant::Reply y;

  // The experimenter first: it waits.
  std::unique_ptr<Rig> rig;
  std::thread later([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    rig = std::make_unique<Rig>(there);
  });
  Lockstep<ExperimenterEnd, 1, 2> machine(here, here.faults(), options);
  CHECK(drive(machine, 100, hash) == Outcome::answered);
  later.join();
  CHECK(hash.value == test::reference(100).value);

  // Another machine in its place does not know what was before, and says so; the experiment begins again.
  CHECK(machine.exchange(100, {0.0}, y) == Outcome::answered);
  rig.reset();  // two would read one wire
  rig = std::make_unique<Rig>(there);
  CHECK(machine.exchange(101, {0.0}, y) == Outcome::restarted);
  hash = {};
  CHECK(drive(machine, 100, hash) == Outcome::answered);
  CHECK(hash.value == test::reference(100).value);

  // Another experimenter is refused while the first holds the machine, and told that it is held.
  Bus third("udpm://");
  ExperimenterEnd second(third, stimulus_channel, measurement_channel);
  third.start();
  options.yield = 100'000'000;
  Lockstep<ExperimenterEnd, 1, 2> intruder(second, second.faults(), options);
  CHECK(intruder.start(0, y) == Outcome::busy);
  CHECK(there.faults()[Fault::session] > 0);
  CHECK(machine.exchange(100, {0.0}, y) == Outcome::answered);

  // One that vanishes without a word loses it after the lease of two seconds.
  options.yield = 10'000'000'000;
  Lockstep<ExperimenterEnd, 1, 2> successor(second, second.faults(), options);
  hash = {};
  CHECK(drive(successor, 100, hash) == Outcome::answered);
  CHECK(hash.value == test::reference(100).value);
  CHECK(machine.exchange(101, {0.0}, y) != Outcome::answered);  // and learns of it
  CHECK(successor.stop() == Outcome::answered);
}

TEST_CASE("an experimenter without a machine gives up in its time, and where there is no route it is told the mend") {
  SALTUS_OWN_NETWORK(test::Multicasting::unrouted);
  try {
    Bus bus("udpm://");
    FAIL("there is no route");
  } catch (const LinkError& e) {
    CHECK(std::string(e.what()).find("ip route add 224.0.0.0/4 dev lo") != std::string::npos);
  }
  CHECK_FALSE(what_the_network_lacks({}).empty());
  Bus bus("memq://");
  ExperimenterEnd here(bus, stimulus_channel, measurement_channel);
  bus.start();
  ExchangeOptions options;
  options.patience = 100'000'000;
  Lockstep<ExperimenterEnd, 1, 2> machine(here, here.faults(), options);
  Plant::Reply y;
  CHECK(machine.start(0, y) == Outcome::silent);
}

TEST_CASE("addresses are read strictly") {
  const MulticastAddress a = MulticastAddress::parse("udpm://239.1.2.3:4567?ttl=1&recv_buf_size=100000");
  CHECK((a.group == 0xEF010203 && a.port == 4567 && a.ttl == 1 && a.receive_buffer == 100000));
  CHECK(a.text() == "239.1.2.3:4567");
  CHECK(MulticastAddress::parse("udpm://").text() == "239.255.76.67:7667");
  for (const char* wrong : {"", "tcpq://", "udpm://127.0.0.1:7667", "udpm://239.255.76.67:0", "udpm://239.255.76.67:x",
                            "udpm://?ttl=256", "udpm://?ttl", "udpm://?colour=red", "shm://", "mpudpm://"}) {
    CHECK_THROWS_AS(MulticastAddress::parse(wrong), LinkError);
  }
}

TEST_CASE("a million messages each way cost no allocation on any thread, and none is lost") {
  SALTUS_OWN_NETWORK();
  const std::int64_t count = test::counting() ? 1'000'000 : 20'000;
  Bus bus("udpm://"), other("udpm://");
  ExperimenterEnd here(bus, stimulus_channel, measurement_channel);
  MachineEnd there(other, measurement_channel, stimulus_channel);
  bus.start();
  other.start();
  std::atomic<bool> done{false};
  std::thread machine([&] {
    Plant plant;
    while (!done.load(std::memory_order_relaxed)) {
      Stimulus<1> s;
      while (there.try_receive(s)) {
        Measurement<2> y = plant.advance(s);
        y.seq = s.seq;
        while (!there.try_send(y)) std::this_thread::yield();
      }
      there.await(1'000'000);
    }
  });
  std::int64_t sent = 0, heard = 0, disorder = 0, allocated = 0;
  const auto run_to = [&](std::int64_t end) {
    for (std::int64_t idle = 0; heard < end && idle < 5000;) {
      Stimulus<1> s;
      s.seq = sent;
      if (sent < end && sent - heard < 32 && here.try_send(s)) {
        ++sent;
        continue;
      }
      Measurement<2> y;
      if (here.try_receive(y)) {
        disorder += y.seq == heard ? 0 : 1;
        ++heard;
        idle = 0;
      } else {
        here.await(1'000'000);
        ++idle;
      }
    }
  };
  run_to(1000);  // what is allocated once
  {
    const test::AllocationCount counter;
    run_to(count);
    allocated = counter();
  }
  done = true;
  machine.join();
  CHECK(heard == count);
  CHECK(disorder == 0);
  CHECK(allocated == 0);
}
