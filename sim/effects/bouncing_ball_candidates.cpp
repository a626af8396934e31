// Everything the bouncing ball may lack.
#include "../diagnosis/machines.hpp"
#include "../diagnosis/model_machine.hpp"
#include "../models/bouncing_ball.hpp"

namespace saltus {
namespace effects {

// The restitution falls by s for every m/s of closing speed beyond the reference.
template <class S = double>
struct VelocityDependentRestitution {
  static constexpr std::string_view law = "velocity_dependent_restitution";
  static constexpr double reference = 5.45;  // [m/s]
  S s = 0.0;                                 // [s/m]
  static constexpr auto parameters() { return std::array{Parameter{"s", "s/m", &VelocityDependentRestitution::s}}; }
  template <class U>
  Vec<3, S> reset(const BouncingBall<S>& m, bouncing_ball::Impact, const Vec<3, S>& before, const Vec<3, S>& after,
                  const U&) const noexcept {
    const S closing = m.A * m.omega * cos(before[2]) - before[1];
    return {after[0], after[1] - s * (closing - reference) * closing, after[2]};
  }
};

}  // namespace effects

template <class S>
struct OwnEffects<BouncingBall<S>> {
  using type = List<effects::VelocityDependentRestitution<S>>;
};

}  // namespace saltus

namespace saltus::diagnosis {
std::unique_ptr<Machine> bouncing_ball_machine() {
  return std::make_unique<ModelMachine<WithCandidates<BouncingBall<>>>>(BouncingBall<>{});
}
}  // namespace saltus::diagnosis
