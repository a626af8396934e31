#include "core/trace/alarm.hpp"

#include "core/random.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

using Alarm = DriftAlarm<32, 2>;

// Cycles until the alarm, at most `most`; the residual of (section, output) is noise times scale plus shift(section, output).
template <class Shift>
std::int64_t cycles_until(Alarm& alarm, Random& random, double scale, const Shift& shift, std::int64_t most) {
  const Alarm::Sample noise{1e-3, 6e-3};
  while (alarm.cycles() < most && !alarm.state().raised) {
    for (int s = 0; s < 32; ++s) {
      Alarm::Sample e;
      for (int j = 0; j < 2; ++j) {
        const auto k = static_cast<std::size_t>(j);
        e[k] = noise[k] * (scale * random.normal() + shift(s, j));
      }
      alarm.push(s, e);
    }
  }
  return alarm.cycles();
}
Alarm ready(double false_alarm) {
  Alarm alarm;
  REQUIRE(alarm.configure(32, {1e-3, 6e-3}, false_alarm) == Status::ok);
  return alarm;
}

}  // namespace

TEST_CASE("without a cause alarms are as rare as asked") {
  Random random(7);
  const auto nothing = [](int, int) { return 0.0; };
  const double false_alarm = 1e-3;
  int alarms = 0;
  const int runs = 60;
  for (int run = 0; run < runs; ++run) {
    Alarm alarm = ready(false_alarm);
    cycles_until(alarm, random, 1.0, nothing, 200);
    alarms += alarm.state().raised;
  }
  // At most 60 * 200 * 1e-3 = 12 are expected; more than 22 has a probability below 0.5 %.
  CHECK(alarms <= 22);
}

TEST_CASE("a lasting shift of one section is found and named") {
  Random random(8);
  int named = 0;
  for (int run = 0; run < 20; ++run) {
    Alarm alarm = ready(1e-4);
    const auto at = cycles_until(alarm, random, 1.0, [](int s, int j) { return s == 21 && j == 1 ? 2.5 : 0.0; }, 400);
    CHECK(at < 60);
    named += alarm.state().section == 21 && alarm.state().output == 1;
  }
  CHECK(named >= 19);
}

TEST_CASE("more scatter than there should be is found") {
  Random random(9);
  for (int run = 0; run < 20; ++run) {
    Alarm alarm = ready(1e-4);
    CHECK(cycles_until(alarm, random, 1.2, [](int, int) { return 0.0; }, 400) < 60);
  }
}

TEST_CASE("what raised the alarm stays until it is restarted, missing samples are left out, misuse is refused") {
  Alarm alarm = ready(1e-4);
  Random random(10);
  cycles_until(alarm, random, 1.0, [](int s, int) { return s == 3 ? 5.0 : 0.0; }, 100);
  REQUIRE(alarm.state().raised);
  for (int c = 0; c < 200; ++c) {
    for (int s = 0; s < 32; ++s) alarm.push(s, {0.0, 0.0});
  }
  CHECK(alarm.state().raised);
  CHECK(alarm.state().section == 3);
  alarm.restart();
  CHECK(!alarm.state().raised);
  CHECK(alarm.push(0, {std::nan(""), 0.0}) == Status::missing);
  CHECK(alarm.push(32, {0.0, 0.0}) == Status::failed);
  CHECK(alarm.configure(33, {1.0, 1.0}) == Status::failed);
  CHECK(alarm.configure(32, {1.0, 0.0}) == Status::failed);
  CHECK(alarm.configure(32, {1.0, 1.0}, 0.0) == Status::failed);
}
