// Everything the simplest walker may lack within a step.
#include "../diagnosis/machines.hpp"
#include "../diagnosis/model_machine.hpp"
#include "../models/simplest_walker.hpp"
#include "in_step.hpp"

namespace saltus::diagnosis {
std::unique_ptr<Machine> simplest_walker_machine() {
  using Model = InStep<SimplestWalker>;
  static_assert(check<Model>());
  return std::make_unique<ModelMachine<WithCandidates<Model>>>(Model{});
}
}  // namespace saltus::diagnosis
