// The compass-gait biped with its impacts, to be run from step to step.
#include "../diagnosis/machines.hpp"
#include "../diagnosis/model_machine.hpp"
#include "../models/compass_gait.hpp"

namespace saltus::diagnosis {
std::unique_ptr<Machine> compass_gait_walker() {
  return std::make_unique<ModelMachine<WithCandidates<CompassGait<>>>>(CompassGait<>{});
}
}  // namespace saltus::diagnosis
