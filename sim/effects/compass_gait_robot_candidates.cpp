// Everything the compass-gait robot may lack within a step.
#include "../diagnosis/machines.hpp"
#include "../diagnosis/model_machine.hpp"
#include "../models/compass_gait_robot.hpp"
#include "in_step.hpp"

namespace saltus::diagnosis {
std::unique_ptr<Machine> compass_gait_robot_machine() {
  using Model = InStep<CompassGaitRobot>;
  static_assert(check<Model>());
  return std::make_unique<ModelMachine<WithCandidates<Model>>>(Model{});
}
}  // namespace saltus::diagnosis
