// A closed loop for tests of links: a plant that forgets nothing, so that one wrong bit in one message shows in all
// that follows, and the hash of its trajectory.
#pragma once

#include <bit>
#include <cstdint>

#include "hal/lockstep.hpp"

namespace saltus::test {

// FNV-1a over the bits of what is fed to it.
struct Hash {
  std::uint64_t value = 0xcbf29ce484222325;
  void add(double x) noexcept {
    for (auto bits = std::bit_cast<std::uint64_t>(x), i = std::uint64_t{0}; i < 8; ++i, bits >>= 8) {
      value = (value ^ (bits & 0xff)) * 0x100000001b3;
    }
  }
};

// A driven map, chaotic but bounded, in operations that every machine rounds alike.
struct Plant {
  using Command = Stimulus<1>;
  using Reply = Measurement<2>;
  double x = 0.1, v = 0.0;
  std::int64_t tick = 0, steps = 0;

  Reply measure() const noexcept {
    Reply r;
    r.tick = tick;
    r.y = {x, v};
    return r;
  }
  Reply start(std::int32_t experiment) noexcept {
    x = 0.1 + 0.01 * experiment;
    v = 0.0;
    tick = 0;
    return measure();
  }
  Reply advance(const Command& c) noexcept {
    const double before = x;
    x = 1.0 - 1.4 * x * x + v + 0.001 * c.u[0];
    v = 0.3 * before;
    ++tick;
    ++steps;
    return measure();
  }
  Reply rest() noexcept { return measure(); }
};

// Feedback of what was measured, so that damage in either direction goes round.
inline double control(const Plant::Reply& y) noexcept { return 0.5 * y.y[0] - 0.25 * y.y[1]; }

// The trajectory without any link.
inline Hash reference(std::int64_t ticks, std::int32_t experiment = 0) {
  Plant plant;
  Hash hash;
  Plant::Reply y = plant.start(experiment);
  for (std::int64_t n = 0; n < ticks; ++n) {
    Plant::Command c;
    c.u[0] = control(y);
    y = plant.advance(c);
    hash.add(y.y[0]);
    hash.add(y.y[1]);
  }
  return hash;
}

// The same through a lockstep conversation; ends early, with its outcome, where that does.
template <class End>
Outcome drive(Lockstep<End, 1, 2>& machine, std::int64_t ticks, Hash& hash, std::int32_t experiment = 0) {
  Plant::Reply y;
  if (const Outcome o = machine.start(experiment, y); o != Outcome::answered) return o;
  for (std::int64_t n = 0; n < ticks; ++n) {
    if (const Outcome o = machine.exchange(n, {control(y)}, y); o != Outcome::answered) return o;
    hash.add(y.y[0]);
    hash.add(y.y[1]);
  }
  return Outcome::answered;
}

}  // namespace saltus::test
