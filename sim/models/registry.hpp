// Every model the program knows, in one list.
#pragma once

#include <string>
#include <string_view>

#include "bouncing_ball.hpp"
#include "compass_gait.hpp"
#include "compass_gait_robot.hpp"
#include "hopper_orbit.hpp"
#include "kneed_biped.hpp"
#include "leg_bench.hpp"
#include "pendulum.hpp"
#include "simplest_walker.hpp"
#include "zero_rank.hpp"

namespace saltus {

using KnownModels = List<Hopper<>, ZeroRank<>, KneedBiped<>, CompassGait<>, SimplestWalker<>, BouncingBall<>>;

// Models of real machines, for records of them: they have no rhythm without a controller, so that only what looks at
// records takes them.
using MachineModels = List<Pendulum<>, LegBench<>, CompassGaitRobot<>>;

// Calls f(M{}) for the model of that name; false when there is none.
template <class F>
bool visit_model(std::string_view name, F&& f) {
  bool found = false;
  visit_each(KnownModels{}, [&](auto m) {
    if (!found && decltype(m)::name == name) {
      found = true;
      f(m);
    }
  });
  return found;
}

// "hopper, kneed_biped, ..."
inline std::string known_models() {
  std::string s;
  visit_each(KnownModels{}, [&](auto m) { s += (s.empty() ? "" : ", ") + std::string(decltype(m)::name); });
  return s;
}

// "pendulum, leg_bench, ..."
inline std::string machine_models() {
  std::string s;
  visit_each(MachineModels{}, [&](auto m) { s += (s.empty() ? "" : ", ") + std::string(decltype(m)::name); });
  return s;
}

}  // namespace saltus
