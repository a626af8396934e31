// Everything the compass-gait biped may lack within a step.
#include "../diagnosis/machines.hpp"
#include "../diagnosis/model_machine.hpp"
#include "../models/compass_gait.hpp"
#include "in_step.hpp"

namespace saltus::diagnosis {
std::unique_ptr<Machine> compass_gait_machine() {
  using Model = InStep<CompassGait>;
  static_assert(check<Model>());
  return std::make_unique<ModelMachine<WithCandidates<Model>>>(Model{});
}
}  // namespace saltus::diagnosis
