// One function a model, each in a source of its own under sim/effects.
#pragma once

#include "machine.hpp"

namespace saltus::diagnosis {

std::unique_ptr<Machine> hopper_machine();
std::unique_ptr<Machine> bouncing_ball_machine();
std::unique_ptr<Machine> pendulum_machine();
std::unique_ptr<Machine> leg_bench_machine();
std::unique_ptr<Machine> kneed_biped_machine();
std::unique_ptr<Machine> compass_gait_machine();
std::unique_ptr<Machine> simplest_walker_machine();
std::unique_ptr<Machine> compass_gait_robot_machine();
std::unique_ptr<Machine> compass_gait_robot_walker();
std::unique_ptr<Machine> compass_gait_walker();

// The machine of that name, paced by itself, with its own impacts where it has any, so that it runs on from step to
// step; null where there is none.
std::unique_ptr<Machine> make_walker(const std::string& model);

}  // namespace saltus::diagnosis
