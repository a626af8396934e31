#include "hal/loopback.hpp"

#include <cstddef>
#include <cstdint>
#include <thread>

#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;

namespace {

using Command = Stimulus<1>;
using Reply = Measurement<2>;
using Wire = Loopback<Command, Reply, 64>;

// The contract of a machine: hold u(n), advance one tick, answer with what is measured at tick n + 1.
struct Integrator {
  double y = 0.0;
  Reply step(const Command& command) {
    y += command.u[0];
    return {command.session, command.seq, command.tick + 1, {y, -y}, Status::ok};
  }
};

Command command(std::int64_t n) { return {7, n, 100 + n, {static_cast<double>(n % 5)}}; }

struct Blocking {
  bool try_send(const Command&);  // may throw
  bool try_receive(Reply&) noexcept;
};
struct Deaf {
  bool try_send(const Command&) noexcept;
};

}  // namespace

TEST_CASE("the two ends of a loopback are links of opposite direction") {
  STATIC_REQUIRE(Link<Wire::ExperimenterEnd, Command, Reply>);
  STATIC_REQUIRE(Link<Wire::MachineEnd, Reply, Command>);
  STATIC_REQUIRE_FALSE(Link<Wire::ExperimenterEnd, Reply, Command>);
  STATIC_REQUIRE_FALSE(Link<Wire::MachineEnd, Command, Reply>);
  STATIC_REQUIRE_FALSE(Link<Blocking, Command, Reply>);
  STATIC_REQUIRE_FALSE(Link<Deaf, Command, Reply>);
}

TEST_CASE("a machine without inputs or outputs still has its messages") {
  Loopback<Stimulus<0>, Measurement<0>, 2> wire;
  auto experimenter = wire.experimenter();
  auto machine = wire.machine();
  Stimulus<0> stimulus;
  Measurement<0> measurement;
  CHECK(measurement.seq == -1);  // answers no stimulus yet
  CHECK_FALSE(machine.try_receive(stimulus));
  CHECK(experimenter.try_send({1, 2, 3, {}}));
  CHECK(machine.try_receive(stimulus));
  CHECK(stimulus.tick == 3);
  CHECK(machine.try_send({1, 2, 4, {}, Status::missing}));
  CHECK(experimenter.try_receive(measurement));
  CHECK(measurement.status == Status::missing);
}

TEST_CASE("in lockstep the command of tick n comes back as the measurement of tick n + 1") {
  Wire wire;
  auto experimenter = wire.experimenter();
  auto machine = wire.machine();
  Integrator plant;
  double sum = 0.0;
  std::int64_t wrong = 0;
  const test::AllocationCount allocated;
  for (std::int64_t n = 0; n < 1000; ++n) {
    Command heard;
    Reply reply;
    const bool sent = experimenter.try_send(command(n));
    const bool passed = machine.try_receive(heard) && machine.try_send(plant.step(heard));
    const bool back = experimenter.try_receive(reply);
    sum += static_cast<double>(n % 5);
    wrong += sent && passed && back && reply.session == 7 && reply.seq == n && reply.tick == 101 + n &&
                     reply.y[0] == sum && reply.y[1] == -sum
                 ? 0
                 : 1;
  }
  CHECK(wrong == 0);
  CHECK(allocated() == 0);
}

TEST_CASE("each end counts what it could not send") {
  Wire wire;
  auto experimenter = wire.experimenter();
  auto machine = wire.machine();
  for (std::int64_t n = 0; n < 70; ++n) CHECK(experimenter.try_send(command(n)) == (n < 64));
  CHECK(experimenter.dropped() == 6);
  CHECK(machine.dropped() == 0);
  Command heard;
  std::int64_t received = 0;
  for (; machine.try_receive(heard); ++received) CHECK(heard.seq == received);  // the oldest are kept
  CHECK(received == 64);
}

TEST_CASE("a machine on another thread answers every command, in order") {
  constexpr std::int64_t count = 20'000;
  Wire wire;
  std::thread thread([end = wire.machine()]() mutable {
    Integrator plant;
    for (std::int64_t n = 0; n < count;) {
      Command heard;
      if (!end.try_receive(heard)) {
        std::this_thread::yield();
        continue;
      }
      const Reply reply = plant.step(heard);
      while (!end.try_send(reply)) std::this_thread::yield();
      ++n;
    }
  });
  auto end = wire.experimenter();
  double sum = 0.0;
  std::int64_t wrong = 0;
  for (std::int64_t sent = 0, heard = 0; heard < count;) {
    bool idle = true;
    if (sent < count && end.try_send(command(sent))) {
      ++sent;
      idle = false;
    }
    Reply reply;
    if (end.try_receive(reply)) {
      sum += static_cast<double>(heard % 5);
      wrong += reply.seq == heard && reply.tick == 101 + heard && reply.y[0] == sum ? 0 : 1;
      ++heard;
      idle = false;
    }
    if (idle) std::this_thread::yield();
  }
  thread.join();
  CHECK(wrong == 0);
}
