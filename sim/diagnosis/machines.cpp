#include "machines.hpp"

namespace saltus::diagnosis {

std::unique_ptr<Machine> make_machine(const std::string& model) {
  if (model == "hopper") return hopper_machine();
  if (model == "bouncing_ball") return bouncing_ball_machine();
  return nullptr;
}

}  // namespace saltus::diagnosis
