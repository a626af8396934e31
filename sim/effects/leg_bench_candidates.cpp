// Everything the leg on its bench may lack.
#include "../diagnosis/machines.hpp"
#include "../diagnosis/model_machine.hpp"
#include "../models/leg_bench.hpp"

namespace saltus::diagnosis {
std::unique_ptr<Machine> leg_bench_machine() {
  return std::make_unique<ModelMachine<WithCandidates<LegBench<>>>>(LegBench<>{});
}
}  // namespace saltus::diagnosis
