// Everything the kneed biped may lack within a step.
#include "../diagnosis/machines.hpp"
#include "../diagnosis/model_machine.hpp"
#include "../models/kneed_biped.hpp"
#include "in_step.hpp"

namespace saltus::diagnosis {
std::unique_ptr<Machine> kneed_biped_machine() {
  using Model = InStep<KneedBiped>;
  static_assert(check<Model>());
  return std::make_unique<ModelMachine<WithCandidates<Model>>>(Model{});
}
}  // namespace saltus::diagnosis
