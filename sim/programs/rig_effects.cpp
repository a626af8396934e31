// saltus rig MODEL --effect: a machine that has what its declared model lacks.
#include "../diagnosis/model_machine.hpp"
#include "../effects/hopper_ground.hpp"
#include "rig.hpp"

namespace saltus::program {
namespace {

// The model to which effects are added: that of the hopper also has its ground.
template <class M>
auto grounded(const M& m) {
  return m;
}
HopperOnGround<> grounded(const Hopper<>& m) {
  HopperOnGround<> g;
  g.h = m;
  return g;
}

template <class M>
void set_effect(M& m, const std::string& text) {
  const Setting s = parse_setting(text, "--effect");
  bool known = false;
  std::string names;
  const auto offer = [&](const std::string& name, double& value) {
    if (name == s.name) {
      value = s.value;
      known = true;
    }
    names += (names.empty() ? "" : ", ") + name;
  };
  visit_parameters(m.model, [&](auto name, auto, double& value) {
    const bool structural = std::string_view(name) == "compliant_ground" || std::string_view(name) == "restitution";
    offer(structural ? std::string(name) : "parameter:" + std::string(name), value);
  });
  std::apply(
      [&](auto&... effect) {
        const auto visit = [&](auto& e) {
          int place = 0;
          visit_parameters(e, [&](auto, auto, double& value) {
            if (place++ == 0) offer(diagnosis::effect_name(e), value);
          });
        };
        (visit(effect), ...);
      },
      m.effects);
  if (!known) {
    throw UsageError("--effect " + text + ": " + std::string(M::name) + " has no effect '" + s.name + "'; it has " +
                     names);
  }
}

}  // namespace

void serve_with_effects(const RigOptions& o) {
  with_model(o.model, [&](auto m) {
    using M = decltype(m);
    if constexpr (input_count < M >> 0 && clocked<M>) {
      if (o.sections.family != "clock") throw UsageError("--effect: with effects the sections are those of the clock");
      using Grounded = decltype(grounded(m));
      WithCandidates<Grounded> machine;
      machine.model = grounded(m);
      for (const std::string& text : o.effects) set_effect(machine, text);
      machine.rest_idle();
      serve_model(machine, ClockPhases{sections_per_cycle}, o);
    } else {
      throw RunError(std::string(M::name) + " has no input to drive, or no clock; --effect needs both");
    }
  });
}

}  // namespace saltus::program
