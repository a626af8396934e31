// Everything the pendulum may lack.
#include "../diagnosis/machines.hpp"
#include "../diagnosis/model_machine.hpp"
#include "../models/pendulum.hpp"

namespace saltus::diagnosis {
std::unique_ptr<Machine> pendulum_machine() {
  return std::make_unique<ModelMachine<WithCandidates<Pendulum<>>>>(Pendulum<>{});
}
}  // namespace saltus::diagnosis
