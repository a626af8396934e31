#include "machines.hpp"

#include "../format.hpp"

namespace saltus::diagnosis {

std::string name_of(const Machine& m, int coefficient) {
  const auto k = static_cast<std::size_t>(coefficient);
  return (k < m.declared && !m.coefficients[k].candidate ? "parameter:" : "") + m.coefficients[k].name;
}

std::vector<std::string> names_of(const Machine& m, const std::vector<int>& coefficients) {
  std::vector<std::string> r;
  for (const int c : coefficients) {
    if (m.coefficients[static_cast<std::size_t>(c)].sine_of.empty()) r.push_back(name_of(m, c));
  }
  return r;
}

std::string together(const std::vector<std::string>& effects) {
  return effects.empty() ? "no effect" : listed(effects, " + ");
}

std::unique_ptr<Machine> make_machine(const std::string& model) {
  if (model == "hopper") return hopper_machine();
  if (model == "bouncing_ball") return bouncing_ball_machine();
  if (model == "pendulum") return pendulum_machine();
  if (model == "leg_bench") return leg_bench_machine();
  if (model == "kneed_biped") return kneed_biped_machine();
  if (model == "compass_gait") return compass_gait_machine();
  if (model == "simplest_walker") return simplest_walker_machine();
  if (model == "compass_gait_robot") return compass_gait_robot_machine();
  return nullptr;
}

std::unique_ptr<Machine> make_walker(const std::string& model) {
  if (model == "compass_gait") return compass_gait_walker();
  if (model == "compass_gait_robot") return compass_gait_robot_walker();
  auto machine = make_machine(model);
  return machine != nullptr && machine->has_clock ? nullptr : std::move(machine);
}

}  // namespace saltus::diagnosis
