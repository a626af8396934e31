#include "core/tick.hpp"

#include <cmath>
#include <numbers>

#include "tests/support/catch.hpp"

using saltus::Timebase;

TEST_CASE("timebase: whole turns are exact however many, and time never stands still") {
  const Timebase base{0.1, 7};
  for (const std::int64_t turn : {std::int64_t{0}, std::int64_t{1}, std::int64_t{1000}, std::int64_t{1} << 40}) {
    CHECK(base.time(turn * 7) == static_cast<double>(turn) * 0.1);
    CHECK(base.phase(turn * 7) == 0.0);
  }
  bool rises = true;
  bool close = true;
  for (std::int64_t tick = 0; tick < 100000; ++tick) {
    rises = rises && base.time(tick + 1) > base.time(tick);
    close = close && std::abs(base.time(tick) - 0.1 * static_cast<double>(tick) / 7.0) < 1e-11;
  }
  CHECK(rises);
  CHECK(close);
  CHECK(base.dt() == 0.1 / 7.0);
}

TEST_CASE("timebase: the angle depends on the tick within its turn alone") {
  const Timebase base{2.0, 512};
  constexpr double turn = 2.0 * std::numbers::pi;
  bool same = true;
  for (std::int64_t tick = 0; tick < 512; ++tick) {
    const double expected = turn * static_cast<double>(tick) / 512.0;
    same = same && std::abs(base.phase(tick) - expected) < 1e-15;
    same = same && base.phase(tick + std::int64_t{512} * 1000000007) == base.phase(tick);
    same = same && base.phase(tick - 512 * 3) == base.phase(tick);
    same = same && base.phase(tick) >= 0.0 && base.phase(tick) < turn;
  }
  CHECK(same);
  CHECK(base.phase(256) == std::numbers::pi);
  CHECK(base.phase(-1) == base.phase(511));
}

TEST_CASE("timebase: time before the start") {
  const Timebase base{1.0, 10};
  CHECK(base.time(-10) == -1.0);
  CHECK(std::abs(base.time(-3) + 0.3) < 1e-15);
}
