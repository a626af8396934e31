// Where inside one step a guard falls through zero.
//
// The root is bracketed and bisected on the step's cubic Hermite, a fixed number of halvings that cost no evaluation of
// the flow, and then polished on re-integrated steps, still inside its bracket. The state found lies on the far side
// (guard <= 0), so that nothing has to nudge it. Guaranteed: a guard armed at the start and non-positive at the end of
// the step is never missed; a guard that dips below zero and returns within the step is found when the dip is its only
// one in the step, however shallow, down to 1e-6 of the guard's scale in the step; shallower ones are reported as
// grazing or, below the rounding of the cubic, not at all. When a guard falls twice in a step, the first fall counts.
// That holds as long as the cubic tells a guard to a hundredth of its scale. Of an oscillation that takes steps of up
// to 0.4 rad, and with Rk8, which looks closer (long_step.hpp), of up to 2 rad: 32 rad/s at 1/16 s.
#pragma once

#include <cmath>

#include "../status.hpp"
#include "rk4.hpp"

namespace saltus {

// One step of the flow in one chart, seen by the guards.
template <int N, class F, class Method = Rk4>
struct Step {
  const F& f;
  Hermite<N> curve;  // the step, and its length curve.h [s]
  Vec<N> end;        // the state handed on at the end: curve.x1, but for a clock that is set
  double moment;     // [s] how long a guard at zero has to rise to be armed; the whole interval is 2^20 moments

  Vec<N> reintegrated(double s) const noexcept {
    return Method::template step<N, double>(f, curve.x0, curve.f0, s * curve.h);
  }
};

// Found or not, and where.
template <int N>
struct Crossing {
  enum class Kind : unsigned char {
    none,
    crossed,   // at s = 0: the step starts on the guard, to rounding, and leaves through it
    unarmed,   // positive neither at the start nor a moment later: fine unless it ends below zero
    escaped,   // the whole interval began below zero
    diverged,  // the guard is not finite
  };
  Kind kind = Kind::none;
  bool grazing = false;  // the crossing, or a miss, is nearly tangential: its time is ill-conditioned
  double s = 2.0;        // [-] fraction of the step; of a miss that grazes, its bottom
  Vec<N> x;              // the state at s, guard(x) <= 0
};

namespace crossing {
inline constexpr double moment = 0x1p-20;     // [-] of an interval: how long a guard at zero has to rise to be armed
inline constexpr double sliver = 0x1p-20;     // [-] of a step, for the slope of a guard
inline constexpr int halvings = 52;           // of a bracket, to the last bits
inline constexpr int polishes = 6;            // re-integrated steps by the slope, at most, before halving with them
inline constexpr double hair = 0x1p-48;       // [-] of a step: the aim beyond the root, so that the far side is reached
inline constexpr double close = 0x1p-44;      // [-] of a step: this close beyond the root is good enough
inline constexpr double tangential = 1e-5;    // [-] slope at the crossing over the steepest slope of the step
inline constexpr double near = 1e-2;          // [-] of the guard's scale: the cubic alone is not trusted below this
inline constexpr double doubtful_dip = 1e-6;  // [-] of the guard's scale: a dip this shallow is reported as grazing
inline constexpr double outside = 1e-9;       // [-] of the guard's scale: a start this far below zero is no rounding

// Local minimum of a guard inside a step.
struct Dip {
  double s = -1.0;     // [-] fraction of the step; -1: there is none
  double reach = 0.0;  // [-] how far around it the slope rises: to the inflection
};

// That of the cubic through two values and two slopes per unit of s.
inline Dip dip(double g0, double d0, double g1, double d1) noexcept {
  // g(s) = g0 + d0 s + c2 s^2 + c3 s^3, and its minimum where the derivative vanishes with positive curvature.
  const double c2 = 3.0 * (g1 - g0) - 2.0 * d0 - d1;
  const double c3 = d0 + d1 - 2.0 * (g1 - g0);
  const double disc = c2 * c2 - 3.0 * c3 * d0;
  if (!(disc > 0.0)) return {};
  const double root = std::sqrt(disc);
  // (-c2 + root) / (3 c3) is the minimum; written so that c3 -> 0 is harmless.
  const double s = c2 > 0.0 ? -d0 / (c2 + root) : (c3 != 0.0 ? (root - c2) / (3.0 * c3) : -1.0);
  if (!(s > 0.0 && s < 1.0)) return {};
  return {s, root < 0.75 * std::abs(c3) ? root / (3.0 * std::abs(c3)) : 0.25};
}

// A guard along a step, and its slope per unit of s, at both ends.
struct Ends {
  double g0, d0, g1, d1;
};

// The second half of `locate` for a method whose steps are long, in long_step.hpp. `found` has what is known so far;
// the guard is positive at lo.
template <int N, class F, class Method, class G>
void in_long_step(const Step<N, F, Method>& step, const G& guard, const Ends& ends, double scale, double lo,
                  Crossing<N>& found) noexcept;
}  // namespace crossing

// First fall of `guard` through zero in the step. `guard` maps a state (N) to a number, positive inside.
template <int N, class F, class Method, class G>
Crossing<N> locate(const Step<N, F, Method>& step, const G& guard) noexcept {
  using Kind = typename Crossing<N>::Kind;
  constexpr double sliver = crossing::sliver;
  Crossing<N> found;
  const auto& curve = step.curve;
  const auto on_curve = [&](double s) { return guard(curve(s)); };
  const auto slope_at = [&](double s) {
    const double before = std::fmax(0.0, s - sliver);
    const double after = std::fmin(1.0, s + sliver);
    return (on_curve(after) - on_curve(before)) / (after - before);
  };

  const double g0 = guard(curve.x0);
  const double g1 = guard(step.end);
  double d0, d1;                       // slopes per unit of s
  if constexpr (Method::long_steps) {  // the ends alone: the curve is not needed
    const double per = curve.h / step.moment;
    d0 = (guard(Vec<N>(curve.x0 + curve.f0 * step.moment)) - g0) * per;
    d1 = (g1 - guard(Vec<N>(step.end - curve.f1 * step.moment))) * per;
  } else {
    d0 = (on_curve(sliver) - g0) / sliver;
    d1 = (g1 - on_curve(1.0 - sliver)) / sliver;
  }
  const double scale = std::fmax(std::fmax(std::abs(g0), std::abs(g1)), std::fmax(std::abs(d0), std::abs(d1)));
  if (!(std::isfinite(g0) && std::isfinite(g1) && std::isfinite(d0) && std::isfinite(d1))) {
    found.kind = Kind::diverged;
    return found;
  }
  double lo = 0.0;
  if (!(g0 > 0.0)) {
    lo = step.moment / curve.h;
    if (!(lo < 1.0 && on_curve(lo) > 0.0)) {  // unarmed
      const double whole = step.moment / crossing::moment;
      const auto falls = [&](double t) { return g0 - guard(Vec<N>(curve.x0 + curve.f0 * t)); };
      const double fall = falls(whole);
      const bool steady = falls(whole / 1024.0) > fall / 2048.0;  // at the start already, not only later
      if (fall > crossing::tangential * scale && steady && -g0 <= crossing::outside * fall) {
        found.kind = Kind::crossed;
        found.s = 0.0;
        found.x = curve.x0;
      } else if (curve.h >= whole && g0 < -crossing::outside * scale) {
        found.kind = Kind::escaped;
      } else if (lo < 1.0) {
        found.kind = Kind::unarmed;
      }
      return found;
    }
  }

  if constexpr (Method::long_steps) {
    crossing::in_long_step<N>(step, guard, {g0, d0, g1, d1}, scale, lo, found);
    return found;
  }

  // The far end of the bracket: the bottom of a dip that reaches below zero, else the end of the step.
  double hi = 1.0;
  found.x = step.end;
  if (const crossing::Dip dip = crossing::dip(g0, d0, g1, d1); dip.s > lo) {
    double left = std::fmax(lo, dip.s - dip.reach);
    double right = std::fmin(1.0, dip.s + dip.reach);
    for (int i = 0; i < crossing::halvings / 2; ++i) {  // bisection on the slope: half the digits give all of the depth
      const double mid = 0.5 * (left + right);
      (slope_at(mid) > 0.0 ? right : left) = mid;
    }
    const double bottom = 0.5 * (left + right);
    if (!(on_curve(bottom) > crossing::near * scale)) {
      const Vec<N> x = step.reintegrated(bottom);
      const double depth = guard(x);
      found.grazing = std::abs(depth) < crossing::doubtful_dip * scale;
      if (found.grazing) found.s = bottom;
      if (!(depth > 0.0)) {
        hi = bottom;
        found.x = x;
      }
    }
  }
  if (hi == 1.0 && g1 > 0.0) {
    // The bottom may lie where this step meets the next.
    if (g1 < crossing::doubtful_dip * scale && std::abs(d1) < crossing::tangential * scale) {
      found.grazing = true;
      found.s = 1.0;
    }
    return found;
  }

  double inner = lo;
  double s = hi;
  for (int i = 0; i < crossing::halvings; ++i) {
    const double mid = 0.5 * (inner + s);
    (on_curve(mid) > 0.0 ? inner : s) = mid;
  }
  // Polish on the step itself. The bracket is opened again: the cubic is off by its own error.
  double slope = slope_at(s);
  double aim = crossing::hair;
  s = std::fmin(s, hi - 2.0 * aim);
  for (int i = 0; i < crossing::polishes + crossing::halvings && hi - lo > 4.0 * crossing::hair; ++i) {
    if (!(s > lo && s < hi)) s = 0.5 * (lo + hi);
    const Vec<N> trial = step.reintegrated(s);
    const double g = guard(trial);
    if (g > 0.0) {
      lo = s;
      aim *= 2.0;
    } else {
      hi = s;
      found.x = trial;
    }
    if (i == 0) {  // the cubic's error goes as s^2 (1 - s)^2: what it is here tells what it is in the slope
      const double mend = g * (2.0 / s - 2.0 / (1.0 - s));
      if (std::abs(mend) < -0.5 * slope) slope += mend;
    }
    if (!(slope < 0.0) || i >= crossing::polishes) {  // slow or hardly falling: plain bisection, rare and bounded
      s = lo;
    } else {
      const double correction = -g / slope;
      if (g <= 0.0 && std::abs(correction) < crossing::close) break;
      s += correction + aim + std::fmin(0x1p-25 * std::abs(correction), 0.5 * crossing::close);
    }
  }
  found.s = hi;
  found.grazing = found.grazing || slope_at(hi) > -crossing::tangential * scale;
  found.kind = guard(found.x) <= 0.0 ? Kind::crossed : Kind::diverged;
  return found;
}

}  // namespace saltus
