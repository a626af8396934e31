// Everything the compass-gait robot may lack within a step.
#include "../diagnosis/machines.hpp"
#include "../diagnosis/model_machine.hpp"
#include "../models/compass_gait_robot.hpp"

namespace saltus {

// The robot between its impacts: which leg stands is for the record to say. Its legs shorten while they swing, and the
// record does not say by how much, so that no guard of straight legs would be met at the right time.
template <class S = double>
struct CompassGaitRobotInStep : CompassGaitRobot<S> {
  using Edges = List<>;
  static constexpr auto parameters() {
    using M = CompassGaitRobotInStep;
    constexpr auto own = CompassGaitRobot<S>::parameters();
    std::array<Parameter<M, S>, own.size()> all{};
    for (std::size_t i = 0; i < own.size(); ++i) all[i] = {own[i].name, own[i].unit, own[i].member};
    return all;
  }
};
static_assert(check<CompassGaitRobotInStep<>>());

}  // namespace saltus

namespace saltus::diagnosis {
std::unique_ptr<Machine> compass_gait_robot_machine() {
  return std::make_unique<ModelMachine<WithCandidates<CompassGaitRobotInStep<>>>>(CompassGaitRobotInStep<>{});
}
}  // namespace saltus::diagnosis
