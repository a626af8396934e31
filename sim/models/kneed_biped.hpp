// Planar biped with locking knees that walks as if down a slope (controlled symmetry). Wendel & Ames 2010, sec. 5.2;
// the slope is not printed there and was inferred from its states. Angles are counted from the vertical of the leg's
// frame, positive leaning in the walking direction; s is the stance leg, ns the swing thigh, k the swing calf. Thigh
// and calf are half a leg each.
#pragma once

#include "core/hybrid/model.hpp"
#include "linkage.hpp"

namespace saltus {

namespace kneed_biped {
struct Unlocked : Chart<6> {};  // (s, ns, k [rad], their rates [rad/s]): the swing knee bends freely
struct Locked : Chart<4> {};    // (s, ns [rad], their rates [rad/s])
struct KneeStrike : Edge<Unlocked, Locked> {};
struct FootStrike : Edge<Locked, Unlocked> {};
struct Ankle {    // the stance leg against the ground
  static constexpr bool rotary = true;
};
struct Hip {      // the swing thigh against the stance leg
  static constexpr bool internal = true;
  static constexpr bool rotary = true;
};
struct Knee {  // the swing calf against its thigh
  static constexpr bool internal = true;
  static constexpr bool rotary = true;
};
}  // namespace kneed_biped

template <class S = double>
struct KneedBiped {
  using Unlocked = kneed_biped::Unlocked;
  using Locked = kneed_biped::Locked;
  using KneeStrike = kneed_biped::KneeStrike;
  using FootStrike = kneed_biped::FootStrike;
  using Charts = List<Unlocked, Locked>;
  using Edges = List<KneeStrike, FootStrike>;
  using Ports = List<kneed_biped::Ankle, kneed_biped::Hip, kneed_biped::Knee>;
  using U = Vec<0, S>;
  using V2 = Vec<2, S>;
  using V3 = Vec<3, S>;
  using V4 = Vec<4, S>;
  using V6 = Vec<6, S>;
  static constexpr std::string_view name = "kneed_biped";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"theta_s", "rad"},   Quantity{"theta_ns", "rad"},
                                      Quantity{"theta_k", "rad"},   Quantity{"rate_s", "rad/s"},
                                      Quantity{"rate_ns", "rad/s"}, Quantity{"rate_k", "rad/s"}};
  static constexpr std::string_view note =
      "Wendel & Ames 2010, sec. 5.2, print 0.58775 +- 0.50861i, 0.16871 for DP_u and 0.58836 +- 0.50742i, 0.16930 for "
      "DP_l, which must be equal, and states that are not yet periodic: they are unconverged by about 1e-3. Their "
      "sigma(Dphi_l) is 1.2765, -0.23479, 0.41277, 8.8e-17. There is a second, shorter gait, unstable: "
      "--start -0.235,0.235,0.235,1.22,0.27,3.17 finds it.";

  S hip_mass = 5.0;     // [kg]
  S thigh_mass = 5.0;   // [kg]
  S calf_mass = 0.5;    // [kg]
  S leg_length = 1.0;   // [m]
  S calf_com = 0.375;   // [m]   from the foot
  S thigh_com = 0.175;  // [m]   from the knee
  S slope = 0.0504;     // [rad] of the controlled symmetry
  S g = 9.81;           // [m/s^2]

  static constexpr auto parameters() {
    return std::array{
        Parameter{"hip_mass", "kg", &KneedBiped::hip_mass},   Parameter{"thigh_mass", "kg", &KneedBiped::thigh_mass},
        Parameter{"calf_mass", "kg", &KneedBiped::calf_mass}, Parameter{"leg_length", "m", &KneedBiped::leg_length},
        Parameter{"calf_com", "m", &KneedBiped::calf_com},    Parameter{"thigh_com", "m", &KneedBiped::thigh_com},
        Parameter{"slope", "rad", &KneedBiped::slope},        Parameter{"g", "m/s^2", &KneedBiped::g}};
  }

  V6 flow(Unlocked, const V6& x, const U&) const noexcept {
    const V3 a = unlocked().acceleration(angles(x), rates(x), g, slope);
    return {x[3], x[4], x[5], a[0], a[1], a[2]};
  }
  V4 flow(Locked, const V4& x, const U&) const noexcept {
    const V2 a = locked().acceleration(angles(x), rates(x), g, slope);
    return {x[2], x[3], a[0], a[1]};
  }

  // The knee is straight.
  S guard(KneeStrike, const V6& x, const U&) const noexcept { return x[2] - x[1]; }
  // The swing foot is on the ground.
  S guard(FootStrike, const V4& x, const U&) const noexcept { return leg_length * (cos(x[0]) - cos(x[1])); }

  // The knee locks: a plastic impact at the knee, M_l v+ = J^T M_u v-, J = [1 0; 0 1; 0 1].
  V4 reset(KneeStrike, const V6& x, const U&) const noexcept {
    const V3 p = unlocked().mass(angles(x)) * rates(x);
    const V2 v = locked().mass_inverse(V2{x[0], x[1]}) * V2{p[0], p[1] + p[2]};
    return {x[0], x[1], v[0], v[1]};
  }
  // The swing foot stops and becomes the pivot, the legs change names, and the trailing knee is free at once.
  V6 reset(FootStrike, const V4& x, const U&) const noexcept {
    const S px = leg_length * (cos(x[0]) * x[2] - cos(x[1]) * x[3]);
    const S py = leg_length * (sin(x[1]) * x[3] - sin(x[0]) * x[2]);
    const V3 q{x[1], x[0], x[0]};
    const V3 v = unlocked().stopped(q, V3{x[3], x[2], x[2]}, px, py);
    return {q[0], q[1], q[2], v[0], v[1], v[2]};
  }

  V6 output(Unlocked, const V6& x, const U&) const noexcept { return x; }
  V6 output(Locked, const V4& x, const U&) const noexcept { return {x[0], x[1], x[1], x[2], x[3], x[3]}; }

  // Torques at the joints [N m].
  Motion<S, 6> port(kneed_biped::Ankle, Unlocked, const V6& x) const noexcept {
    return {x[0], x[3], torque(x, V3{1.0, 0.0, 0.0})};
  }
  Motion<S, 6> port(kneed_biped::Hip, Unlocked, const V6& x) const noexcept {
    return {x[1] - x[0], x[4] - x[3], torque(x, V3{-1.0, 1.0, 0.0})};
  }
  Motion<S, 6> port(kneed_biped::Knee, Unlocked, const V6& x) const noexcept {
    return {x[2] - x[1], x[5] - x[4], torque(x, V3{0.0, -1.0, 1.0})};
  }
  Motion<S, 4> port(kneed_biped::Ankle, Locked, const V4& x) const noexcept {
    return {x[0], x[2], torque(x, V2{1.0, 0.0})};
  }
  Motion<S, 4> port(kneed_biped::Hip, Locked, const V4& x) const noexcept {
    return {x[1] - x[0], x[3] - x[2], torque(x, V2{-1.0, 1.0})};
  }

  // [J], counted from the stance foot: constant along the flow.
  S energy(Unlocked, const V6& x) const noexcept { return unlocked().energy(angles(x), rates(x), g, slope); }
  S energy(Locked, const V4& x) const noexcept { return locked().energy(angles(x), rates(x), g, slope); }
  // [m], the hip over the ground: a walker below it has fallen.
  template <class C>
  S upright(C, const Vec<C::dim, S>& x) const noexcept {
    return leg_length * cos(x[0]);
  }

  Start<Unlocked, S> start() const noexcept { return {V6{-0.2372, 0.2372, 0.2372, 1.1304, -0.0552, 3.7164}}; }

 private:
  template <int N>
  static Vec<N / 2, S> angles(const Vec<N, S>& x) noexcept {
    return x.template head<N / 2>();
  }
  template <int N>
  static Vec<N / 2, S> rates(const Vec<N, S>& x) noexcept {
    return x.template tail<N / 2>();
  }
  Linkage<3, S> unlocked() const noexcept {
    const S half = leg_length * 0.5;
    Linkage<3, S> r;
    r.add(calf_mass, V3{calf_com, 0.0, 0.0});
    r.add(thigh_mass, V3{half + thigh_com, 0.0, 0.0});
    r.add(hip_mass, V3{leg_length, 0.0, 0.0});
    r.add(thigh_mass, V3{leg_length, thigh_com - half, 0.0});
    r.add(calf_mass, V3{leg_length, -half, calf_com - half});
    return r;
  }
  Linkage<2, S> locked() const noexcept {
    const S half = leg_length * 0.5;
    Linkage<2, S> r;
    r.add(calf_mass, V2{calf_com, 0.0});
    r.add(thigh_mass, V2{half + thigh_com, 0.0});
    r.add(hip_mass, V2{leg_length, 0.0});
    r.add(thigh_mass, V2{leg_length, thigh_com - half});
    r.add(calf_mass, V2{leg_length, calf_com - leg_length});
    return r;
  }
  V6 torque(const V6& x, const V3& joint) const noexcept {
    const V3 a = unlocked().mass_inverse(angles(x)) * joint;
    return {0.0, 0.0, 0.0, a[0], a[1], a[2]};
  }
  V4 torque(const V4& x, const V2& joint) const noexcept {
    const V2 a = locked().mass_inverse(angles(x)) * joint;
    return {0.0, 0.0, a[0], a[1]};
  }
};
static_assert(check<KneedBiped<>>());

}  // namespace saltus
