// Paced runs, by the real clock: what is asserted is logic, never a latency.
#include "hal/paced.hpp"

#include <atomic>
#include <thread>

#include "hal/loopback.hpp"
#include "hal/realtime.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/loop.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;
using test::Plant;

namespace {

using Wire = Loopback<Stimulus<1>, Measurement<2>, 1024>;
constexpr std::int64_t millisecond = 1'000'000;  // [ns]

SessionOptions paced(std::int64_t fail_safe) {
  SessionOptions o;
  o.pace = Pace::paced;
  o.fail_safe = fail_safe;
  return o;
}

}  // namespace

TEST_CASE("a pacer keeps its deadlines by count, and counts what is late") {
  Pacer pacer(millisecond);
  pacer.start();
  const std::int64_t begun = steady_ns();
  for (int i = 0; i < 20; ++i) CHECK(pacer.wait() >= 0);
  CHECK(steady_ns() - begun >= 19 * millisecond);
  CHECK(pacer.ticks() == 20);
  const std::int64_t late = pacer.late();
  std::this_thread::sleep_for(std::chrono::milliseconds(10));
  for (int i = 0; i < 5; ++i) pacer.wait();  // these have passed already: each is late, none is left out
  CHECK(pacer.late() >= late + 5);
  CHECK(pacer.worst() >= 5 * millisecond);

  Pacer skipping(millisecond, Pacer::Overrun::skip);
  skipping.start();
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  const std::int64_t before = steady_ns();
  skipping.wait();
  for (int i = 0; i < 5; ++i) skipping.wait();
  CHECK(steady_ns() - before >= 4 * millisecond);  // what has passed is left out
  CHECK(skipping.late() >= 1);
}

TEST_CASE("real-time set-up says what is not permitted, and why") {
  CHECK(set_up_realtime({}).empty());
  const std::vector<std::string> messages = set_up_realtime({0, 1023, false});
  REQUIRE(messages.size() == 1);
  CHECK(messages[0].find("1023") != std::string::npos);
}

TEST_CASE("paced, every tick is measured, commands come in their time, and no tick allocates") {
  constexpr std::int64_t ticks = 300;
  Wire wire;
  auto end = wire.machine();
  FaultCounts machine_faults, faults;
  MachineSession<1, 2> session(77, paced(100000), machine_faults);
  std::atomic<bool> done{false};
  Plant plant;
  std::thread thread([&] {
    Pacer pacer(millisecond);
    pacer.start();
    for (std::int64_t tick = 0; !done.load();) {
      pacer.wait();
      run_tick(end, session, plant, tick, steady_ns());
    }
  });
  auto here = wire.experimenter();
  Paced<Wire::ExperimenterEnd, 1, 2> machine(here, faults, {}, {20, 100000}, millisecond);
  Plant::Reply y;
  REQUIRE(machine.start(0, y) == Outcome::answered);
  CHECK(y.tick == 0);
  for (std::int64_t n = 0; n < machine.lead(); ++n) machine.give(n, {1.0});
  std::int64_t wrong = 0, measured = 0;
  const test::AllocationCount allocated;
  for (std::int64_t n = 0; n < ticks; ++n) {
    wrong += machine.exchange(n + machine.lead(), {1.0}, y) == Outcome::answered && y.tick == n + 1 ? 0 : 1;
    measured += y.status == Status::ok ? 1 : 0;
  }
  const std::int64_t count = allocated();
  CHECK(wrong == 0);
  CHECK(measured + machine.missed() == ticks);
  CHECK(count == 0);
  CHECK(machine.stop() == Outcome::answered);
  done = true;
  thread.join();
  CHECK_FALSE(session.running());
}

TEST_CASE("when the experimenter falls silent the machine holds zero, then stops, and says both") {
  Wire wire;
  auto end = wire.machine();
  auto here = wire.experimenter();
  FaultCounts machine_faults, faults;
  MachineSession<1, 2> session(77, paced(5), machine_faults);
  Paced<Wire::ExperimenterEnd, 1, 2> machine(here, faults, {}, {0, 1000}, millisecond);
  Plant plant;
  std::int64_t tick = 0, now = 0;
  ExperimenterSession<1, 2> talk(Pace::paced, faults);
  talk.open(9);
  talk.give(Order::start, 0, 0, {});
  REQUIRE(here.try_send(talk.again()));
  run_tick(end, session, plant, tick, ++now);
  Plant::Reply y;
  REQUIRE(here.try_receive(y));
  CHECK(talk.hear(y) == ExperimenterSession<1, 2>::News::answer);
  for (std::int64_t n = 0; n < 3; ++n) {
    talk.give(Order::hold, 0, n, {1.0});
    REQUIRE(here.try_send(talk.again()));
  }
  std::array<int, 6> said{};
  for (int n = 0; n < 30; ++n) {
    run_tick(end, session, plant, tick, ++now);
    while (here.try_receive(y)) ++said[static_cast<std::size_t>(y.answer)];
  }
  CHECK(said[static_cast<std::size_t>(Answer::measured)] == 3 + 4);
  CHECK(said[static_cast<std::size_t>(Answer::fail_safe)] == 5);
  CHECK(said[static_cast<std::size_t>(Answer::stopped)] == 1);
  CHECK_FALSE(session.running());
  CHECK(plant.steps == 12);
  CHECK(session.held().u[0] == 0.0);
}

TEST_CASE("when the machine falls silent the experimenter says so") {
  Wire wire;
  auto end = wire.machine();
  auto here = wire.experimenter();
  FaultCounts machine_faults, faults;
  MachineSession<1, 2> session(77, paced(5), machine_faults);
  ExchangeOptions options;
  options.retry = millisecond;
  Paced<Wire::ExperimenterEnd, 1, 2> machine(here, faults, options, {4, 10}, millisecond);
  std::atomic<bool> done{false};
  std::thread thread([&] {
    Plant plant;
    for (std::int64_t tick = 0; !done.load() && tick < 20;) {
      run_tick(end, session, plant, tick, steady_ns());
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  Plant::Reply y;
  REQUIRE(machine.start(0, y) == Outcome::answered);
  Outcome o = Outcome::answered;
  for (std::int64_t n = 0; n < 1000 && o == Outcome::answered; ++n) o = machine.exchange(n + 4, {1.0}, y);
  done = true;
  thread.join();
  CHECK((o == Outcome::silent || o == Outcome::stopped));
}
