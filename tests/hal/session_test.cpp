#include "hal/session.hpp"

#include <algorithm>
#include <limits>

#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

using Machine = MachineSession<1, 1>;
using Experimenter = ExperimenterSession<1, 1>;
using Act = Machine::Act;
using News = Experimenter::News;
using Command = Stimulus<1>;
using Reply = Measurement<1>;

constexpr double no_number = std::numeric_limits<double>::quiet_NaN();

Command order(std::int64_t session, std::int64_t seq, Order o, std::int64_t sent, std::int64_t tick = 0,
              double u = 0.0) {
  Command c;
  c.session = session;
  c.seq = seq;
  c.tick = tick;
  c.u = {u};
  c.order = o;
  c.sent = sent;
  return c;
}

}  // namespace

TEST_CASE("numbers of messages tell what is missing, doubled, late") {
  FaultCounts faults;
  Arrivals arrivals;
  for (const std::int64_t n : {5, 6, 7}) CHECK(arrivals.note(n, faults));  // what was before the first is not missed
  CHECK(faults[Fault::gap] == 0);
  CHECK_FALSE(arrivals.note(6, faults));
  CHECK(faults[Fault::duplicate] == 1);
  CHECK(arrivals.note(10, faults));
  CHECK(faults[Fault::gap] == 2);
  CHECK(arrivals.note(8, faults));
  CHECK(faults[Fault::late] == 1);
  CHECK_FALSE(arrivals.note(8, faults));
  CHECK(faults[Fault::duplicate] == 2);
  CHECK(arrivals.note(1000, faults));  // beyond what it looks back
  CHECK(faults[Fault::gap] == 2 + 989);
  CHECK(arrivals.note(9, faults));
  CHECK(faults[Fault::late] == 2);
  arrivals.restart();
  CHECK(arrivals.note(3, faults));
  CHECK(faults[Fault::late] == 2);
}

TEST_CASE("in lockstep the machine obeys each order exactly once, and repeats its latest answer") {
  FaultCounts faults;
  Machine machine(77, {}, faults);
  CHECK(machine.hear(order(1, 0, Order::hold, 0), 0) == Act::refuse);  // who is that?
  CHECK(machine.refusal(order(1, 0, Order::hold, 0)).answer == Answer::unknown);
  CHECK(machine.hear(order(1, 0, Order::start, 0), 0) == Act::start);
  CHECK(machine.answer({}, Answer::started).machine == 77);
  CHECK(machine.hear(order(1, 1, Order::hold, 1, 0, 0.5), 1) == Act::hold);
  CHECK(machine.held().u[0] == 0.5);
  Reply y;
  y.tick = 1;
  y.y = {2.0};
  CHECK(machine.answer(y, Answer::measured).seq == 1);
  CHECK(machine.hear(order(1, 1, Order::hold, 1, 0, 0.5), 1) == Act::none);    // doubled on the way
  CHECK(machine.hear(order(1, 1, Order::hold, 2, 0, 0.5), 1) == Act::repeat);  // asked again
  CHECK(machine.again().y[0] == 2.0);
  CHECK(machine.again().sent == 3);
  CHECK(machine.hear(order(1, 0, Order::start, 3), 1) == Act::none);  // long answered
  CHECK(machine.hear(order(1, 3, Order::hold, 4), 1) == Act::none);   // cannot be: 2 has not been answered
  CHECK(faults[Fault::sequence] == 1);
  CHECK(machine.hear(order(1, 2, Order::hold, 5, 1, no_number), 1) == Act::none);
  CHECK(faults[Fault::range] == 1);
  CHECK(machine.hear(order(1, 2, Order::hold, 6, 1, 0.25), 1) == Act::hold);
  CHECK(machine.hear(order(1, 3, Order::stop, 7), 1) == Act::stop);
  CHECK(machine.held().u[0] == 0.0);
  CHECK_FALSE(machine.running());
  CHECK(machine.hear(order(1, 3, Order::stop, 8), 1) == Act::repeat);
  CHECK(machine.hear(order(1, 0, Order::start, 0), 1) == Act::none);  // a ghost of its beginning does not revive it
  CHECK_FALSE(machine.running());
  CHECK(machine.hear(order(1, 4, Order::start, 9), 1) == Act::start);  // but it may go on
}

TEST_CASE("a second experimenter is refused while the first speaks, and gets the machine when that is silent") {
  FaultCounts faults;
  SessionOptions options;
  options.lease = 1000;
  Machine machine(77, options, faults);
  CHECK(machine.hear(order(1, 0, Order::start, 0), 0) == Act::start);
  CHECK(machine.hear(order(2, 0, Order::start, 0), 999) == Act::refuse);
  const Reply no = machine.refusal(order(2, 0, Order::start, 0));
  CHECK(no.answer == Answer::busy);
  CHECK(no.session == 2);
  CHECK(machine.hear(order(1, 1, Order::hold, 1), 999) == Act::hold);
  CHECK(machine.hear(order(2, 0, Order::start, 1), 1500) == Act::refuse);
  CHECK(machine.hear(order(2, 0, Order::start, 2), 2000) == Act::start);
  CHECK(machine.hear(order(1, 2, Order::hold, 2), 2001) == Act::refuse);
  CHECK(faults[Fault::session] == 3);
}

TEST_CASE("the experimenter takes an answer once, from its own machine, to its latest order") {
  FaultCounts faults;
  Experimenter e(Pace::lockstep, faults);
  e.open(9);
  e.give(Order::start, 4, 0, {});
  CHECK(e.again().sent == 0);
  CHECK(e.again().sent == 1);
  Reply y{9, 0, 0, {1.0}, Status::ok, Answer::started, 77, 0};
  CHECK(e.hear(y) == News::answer);
  CHECK(e.machine() == 77);
  y.sent = 1;
  CHECK(e.hear(y) == News::none);  // the answer to its repeat
  e.give(Order::hold, 4, 0, {0.5});
  y = {9, 1, 1, {1.5}, Status::ok, Answer::measured, 78, 0};
  CHECK(e.hear(y) == News::none);  // another machine
  y.session = 8;
  CHECK(e.hear(y) == News::none);
  CHECK(faults[Fault::session] == 2);
  y = {9, 1, 1, {no_number}, Status::ok, Answer::measured, 77, 2};
  CHECK(e.hear(y) == News::none);
  CHECK(faults[Fault::range] == 1);
  y = {9, 1, 3, {1.5}, Status::ok, Answer::measured, 77, 3};  // not of the next tick
  CHECK(e.hear(y) == News::none);
  y = {9, 2, 1, {1.5}, Status::ok, Answer::measured, 77, 4};  // to an order not given
  CHECK(e.hear(y) == News::none);
  CHECK(faults[Fault::sequence] == 2);
  y = {9, 1, 1, {no_number}, Status::missing, Answer::measured, 77, 5};  // it says itself that there is none
  CHECK(e.hear(y) == News::answer);
  e.give(Order::hold, 4, 1, {0.5});
  CHECK(e.hear({9, 2, 0, {}, Status::ok, Answer::unknown, 78, -1}) == News::stranger);
  CHECK(e.hear({9, 2, 0, {}, Status::ok, Answer::unknown, 77, -1}) == News::unknown);
}

TEST_CASE("paced, a command is held from its tick on, its age counted, then zero, then nothing") {
  FaultCounts faults;
  SessionOptions options;
  options.pace = Pace::paced;
  options.fail_safe = 3;
  Machine machine(77, options, faults);
  CHECK(machine.hear(order(1, 0, Order::start, 0), 0) == Act::start);
  CHECK(machine.hear(order(1, 2, Order::hold, 2, 1, 0.2), 0) == Act::hold);  // overtook the one before
  CHECK(machine.hear(order(1, 1, Order::hold, 1, 0, 0.1), 0) == Act::hold);
  CHECK(machine.hear(order(1, 1, Order::hold, 1, 0, 0.1), 0) == Act::none);
  CHECK(faults[Fault::gap] == 1);
  CHECK(faults[Fault::late] == 1);
  CHECK(faults[Fault::duplicate] == 1);
  CHECK(machine.command_of(0)[0] == 0.1);
  CHECK(machine.command_of(1)[0] == 0.2);
  CHECK(machine.answer({}, Answer::measured).seq == 2);
  CHECK(machine.command_of(2)[0] == 0.2);  // none came: the last one is held
  CHECK(machine.missing() == 1);
  CHECK(machine.hear(order(1, 4, Order::hold, 4, 3, 0.4), 0) == Act::hold);
  CHECK(machine.command_of(3)[0] == 0.4);
  CHECK(machine.missing() == 0);
  CHECK(machine.command_of(4)[0] == 0.4);
  CHECK(machine.command_of(5)[0] == 0.4);
  CHECK_FALSE(machine.failing());
  CHECK(machine.command_of(6)[0] == 0.0);
  CHECK(machine.failing());
  CHECK(machine.running());
  CHECK(machine.command_of(7)[0] == 0.0);
  CHECK(machine.command_of(8)[0] == 0.0);
  CHECK(machine.command_of(9)[0] == 0.0);
  CHECK_FALSE(machine.running());
  CHECK(machine.missed() == 7);
  CHECK(machine.worst_age() == 6);
  CHECK(machine.hear(order(1, 5, Order::start, 5), 0) == Act::start);
  CHECK_FALSE(machine.failing());
}

TEST_CASE("no two draws of an id agree") {
  std::array<std::int64_t, 1000> ids{};
  for (auto& id : ids) id = draw_id();
  std::sort(ids.begin(), ids.end());
  CHECK(std::adjacent_find(ids.begin(), ids.end()) == ids.end());
  CHECK(ids.front() > 0);
}
