// Where inside one step a guard falls through zero.
//
// The root is bracketed and bisected on the step's cubic Hermite, a fixed number of halvings that cost no evaluation of
// the flow, and then polished on re-integrated steps, still inside its bracket. The state found lies on the far side
// (guard <= 0), so that nothing has to nudge it. Guaranteed: a guard armed at the start and non-positive at the end of
// the step is never missed; a guard that dips below zero and returns within the step is found when the dip is its only
// one in the step and deeper than the error of the cubic, and reported as grazing when it is about as deep.
#pragma once

#include <cmath>

#include "../status.hpp"
#include "rk4.hpp"

namespace saltus {

// One step of the flow in one chart, seen by the guards.
template <int N, class F>
struct Step {
  const F& f;
  Hermite<N> curve;  // the step, and its length curve.h [s]

  Vec<N> reintegrated(double s) const noexcept { return rk4<N, double>(f, curve.x0, curve.f0, s * curve.h); }
};

// Found or not, and where.
template <int N>
struct Crossing {
  enum class Kind : unsigned char { none, crossed, escaped, diverged };
  Kind kind = Kind::none;
  bool grazing = false;  // the crossing is nearly tangential: its time is ill-conditioned
  double s = 2.0;        // [-] fraction of the step
  Vec<N> x;              // the state at s, guard(x) <= 0
};

namespace crossing {
inline constexpr double moment = 0x1p-20;     // [-] of a step: how long a guard at zero has to rise to be armed
inline constexpr int halvings = 52;           // on the cubic
inline constexpr int polishes = 6;            // re-integrated steps, at most, before bisection by re-integration
inline constexpr double hair = 0x1p-50;       // [-] of a step: the aim beyond the root, so that the far side is reached
inline constexpr double tangential = 1e-5;    // [-] slope at the crossing over the steepest slope of the step
inline constexpr double doubtful_dip = 1e-6;  // [-] of the guard's scale: a dip this shallow is reported as grazing

// Smallest value of g along the cubic near its local minimum, if it has one inside the step: s, or -1.
// g0, g1: guard at the ends; d0, d1: its slopes there per unit of s.
inline double dip(double g0, double d0, double g1, double d1) noexcept {
  // g(s) = g0 + d0 s + c2 s^2 + c3 s^3, and its minimum where the derivative vanishes with positive curvature.
  const double c2 = 3.0 * (g1 - g0) - 2.0 * d0 - d1;
  const double c3 = d0 + d1 - 2.0 * (g1 - g0);
  const double disc = c2 * c2 - 3.0 * c3 * d0;
  if (!(disc > 0.0)) return -1.0;
  const double root = std::sqrt(disc);
  // (-c2 + root) / (3 c3) is the minimum; written so that c3 -> 0 is harmless.
  const double s = c2 > 0.0 ? -d0 / (c2 + root) : (c3 != 0.0 ? (root - c2) / (3.0 * c3) : -1.0);
  return s > 0.0 && s < 1.0 ? s : -1.0;
}
}  // namespace crossing

// First fall of `guard` through zero in (0, 1] of the step. `guard` maps a state (N) to a number, positive inside.
template <int N, class F, class G>
Crossing<N> locate(const Step<N, F>& step, const G& guard) noexcept {
  using Kind = typename Crossing<N>::Kind;
  constexpr double moment = crossing::moment;
  Crossing<N> found;
  const auto& curve = step.curve;
  const auto on_curve = [&](double s) { return guard(curve(s)); };

  const double g0 = guard(curve.x0);
  const double ga = on_curve(moment);
  const double gb = on_curve(1.0 - moment);
  const double g1 = guard(curve.x1);
  if (!(std::isfinite(g0) && std::isfinite(ga) && std::isfinite(gb) && std::isfinite(g1))) {
    found.kind = Kind::diverged;
    return found;
  }
  if (!(g0 > 0.0) && !(ga > 0.0)) {  // unarmed
    if (g1 < 0.0) found.kind = Kind::escaped;
    return found;
  }

  const double d0 = (ga - g0) / moment;  // slopes per unit of s
  const double d1 = (g1 - gb) / moment;
  const double scale = std::fmax(std::fmax(std::abs(g0), std::abs(g1)), std::fmax(std::abs(d0), std::abs(d1)));
  double lo = g0 > 0.0 ? 0.0 : moment;
  double hi = 1.0;
  if (g1 > 0.0) {
    // Both ends inside: has it dipped below zero between them?
    const double s = crossing::dip(g0, d0, g1, d1);
    if (s < 0.0) return found;
    double left = std::fmax(lo, s - 0.25);
    double right = std::fmin(1.0, s + 0.25);
    for (int i = 0; i < crossing::halvings / 2; ++i) {  // bisection on the slope: half the digits give all of the depth
      const double mid = 0.5 * (left + right);
      const double before = std::fmax(0.0, mid - moment);
      const double after = std::fmin(1.0, mid + moment);
      (on_curve(after) > on_curve(before) ? right : left) = mid;
    }
    hi = 0.5 * (left + right);
    double depth = on_curve(hi);
    if (depth > crossing::doubtful_dip * 10.0 * scale) return found;
    depth = guard(step.reintegrated(hi));  // near zero the cubic is not trusted
    found.grazing = std::abs(depth) < crossing::doubtful_dip * scale;
    if (!(depth <= 0.0)) return found;
    if (on_curve(hi) > 0.0) {  // the cubic stays above zero, the flow does not: the bottom is the crossing
      found.kind = Kind::crossed;
      found.s = hi;
      found.x = step.reintegrated(hi);
      return found;
    }
  }

  for (int i = 0; i < crossing::halvings; ++i) {
    const double mid = 0.5 * (lo + hi);
    (on_curve(mid) > 0.0 ? lo : hi) = mid;
  }
  // Polish on the step itself. The bracket is opened again: the cubic is off by its own error.
  double s = hi;
  const double slope = (on_curve(std::fmin(1.0, s + moment)) - on_curve(std::fmax(0.0, s - moment))) /
                       (std::fmin(1.0, s + moment) - std::fmax(0.0, s - moment));
  found.grazing = found.grazing || std::abs(slope) < crossing::tangential * scale;
  lo = g0 > 0.0 ? 0.0 : moment;
  hi = 1.0;
  bool far = g1 <= 0.0;  // hi is known to lie on the far side
  Vec<N> x = curve.x1;
  double aim = crossing::hair;
  for (int i = 0; i < crossing::polishes; ++i) {
    const Vec<N> trial = step.reintegrated(s);
    const double g = guard(trial);
    if (g <= 0.0) {
      hi = s;
      far = true;
      x = trial;
    } else {
      lo = s;
      aim *= 2.0;
    }
    const double correction = slope < 0.0 ? -g / slope : 0.0;
    if (g <= 0.0 && std::abs(correction) < 4.0 * aim) {
      found.kind = Kind::crossed;
      found.s = s;
      found.x = trial;
      return found;
    }
    double next = s + correction + aim;
    if (!(next > lo && next < hi)) next = far && !(s == hi && next >= hi) ? 0.5 * (lo + hi) : std::fmin(1.0, next);
    if (next > 1.0) next = 1.0;
    s = next;
  }
  // Slow or hardly falling: plain bisection by re-integration. Rare, and bounded all the same.
  if (!far) {
    found.kind = Kind::none;
    found.grazing = true;
    return found;
  }
  for (int i = 0; i < crossing::halvings; ++i) {
    const double mid = 0.5 * (lo + hi);
    const Vec<N> trial = step.reintegrated(mid);
    if (guard(trial) > 0.0) {
      lo = mid;
    } else {
      hi = mid;
      x = trial;
    }
  }
  found.kind = Kind::crossed;
  found.s = hi;
  found.x = x;
  return found;
}

}  // namespace saltus
