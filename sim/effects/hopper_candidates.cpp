// Everything the hopper may lack.
#include "../diagnosis/machines.hpp"
#include "../diagnosis/model_machine.hpp"
#include "hopper_ground.hpp"

namespace saltus::diagnosis {
std::unique_ptr<Machine> hopper_machine() {
  return std::make_unique<ModelMachine<WithCandidates<HopperOnGround<>>>>(HopperOnGround<>{});
}
}  // namespace saltus::diagnosis
