// The compass-gait robot with the impacts of its straight legs, to be run from step to step.
#include "../diagnosis/machines.hpp"
#include "../diagnosis/model_machine.hpp"
#include "../models/compass_gait_robot.hpp"

namespace saltus::diagnosis {
std::unique_ptr<Machine> compass_gait_robot_walker() {
  return std::make_unique<ModelMachine<WithCandidates<CompassGaitRobot<>>>>(CompassGaitRobot<>{});
}
}  // namespace saltus::diagnosis
