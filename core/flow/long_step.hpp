// Where inside a long step a guard falls through zero: the second half of `locate` for methods of high order.
//
// The cubic through the ends of such a step is off by a hundredth of it and only says where to look, and integrating
// again is dear. So it is done once, to the cubic's root or to the bottom of its dip, and what is left is made up for
// by Newton's method in short steps from there, so short that order four is off by less than the long step is itself.
#pragma once

#include "crossing.hpp"

namespace saltus::crossing {

inline constexpr double off = 0x1p-4;        // [-] of the guard's scale: the cubic is not trusted below this
inline constexpr double short_way = 0x1p-5;  // [-] of a step: made by order four
inline constexpr double straight = 0x1p-24;  // [-] of a step: so far a path is straight, to rounding
inline constexpr int guesses = 13;           // halvings of the cubic, which is no better

// A guard along a step.
template <int N, class F, class Method, class G>
struct LongStep {
  const Step<N, F, Method>& step;
  const G& guard;
  Ends ends;
  double scale;  // of the guard

  // A state on the path of the step.
  struct Stand {
    double s;  // [-] fraction of the step
    Vec<N> x, rate;
  };
  Stand at(double s) const noexcept {
    const Vec<N> x = step.reintegrated(s);
    return {s, x, step.f(x)};
  }
  Stand from(const Stand& a, double s) const noexcept {
    if (!(std::abs(s - a.s) < short_way)) return at(s);
    const Vec<N> x = rk4<N, double>(step.f, a.x, a.rate, (s - a.s) * step.curve.h);
    return {s, x, step.f(x)};
  }
  // Of the guard along the path, per unit of s. A moment is long enough for that even where the step is a last rest.
  double slope(const Vec<N>& x, const Vec<N>& rate) const noexcept {
    const Vec<N> d = rate * step.moment;
    return (guard(Vec<N>(x + d)) - guard(Vec<N>(x - d))) * (0.5 * step.curve.h / step.moment);
  }

  // The cubic through the ends, and its second derivative.
  double c2() const noexcept { return 3.0 * (ends.g1 - ends.g0) - 2.0 * ends.d0 - ends.d1; }
  double c3() const noexcept { return ends.d0 + ends.d1 - 2.0 * (ends.g1 - ends.g0); }
  double cubic(double s) const noexcept { return ends.g0 + s * (ends.d0 + s * (c2() + s * c3())); }
  double bend(double s) const noexcept { return 2.0 * c2() + 6.0 * c3() * s; }

  // Of a dip whose bottom is at s by the cubic.
  Stand bottom(double s, double lo) const noexcept {
    const double b = bend(s);
    Stand a = at(s);
    for (int i = 0; i < polishes; ++i) {
      const double d = slope(a.x, a.rate);
      if (!(d * d > 0.1 * doubtful_dip * scale * b)) break;  // what is left to fall is d^2 / (2 b)
      const double to = a.s - d / b;
      a = from(a, to < lo ? 0.5 * (lo + a.s) : to > 1.0 ? 0.5 * (1.0 + a.s) : to);
    }
    return a;
  }

  // The cubic's root; its guard is positive at lo.
  double guess(double lo) const noexcept {
    double hi = 1.0;
    for (int i = 0; i < guesses; ++i) {
      const double mid = 0.5 * (lo + hi);
      (cubic(mid) > 0.0 ? lo : hi) = mid;
    }
    return hi;
  }

  // The far end itself is known: a hair before it is as good.
  static double within(double s, double lo, double hi) noexcept {
    s = std::fmin(s, hi - 2.0 * hair);
    return s > lo ? s : 0.5 * (lo + hi);
  }

  // Newton's method from near the root. Narrows the bracket, its far state being x; true when it is the root, in which
  // case d is the slope there.
  bool settled(Stand a, double& lo, double& hi, Vec<N>& x, double& d) const noexcept {
    for (int i = 0; i < polishes; ++i) {
      const double g = guard(a.x);
      d = slope(a.x, a.rate);
      if (g > 0.0) {
        lo = a.s;
      } else {
        hi = a.s;
        x = a.x;
      }
      if (!(hi - lo > 4.0 * hair)) return true;
      const double by = -g / d;
      if (!(d < 0.0 && std::abs(by) < 1.0)) return false;
      if (g <= 0.0 && -by < close) return true;
      if (std::abs(by) < straight) {
        for (double aim = hair; aim < close; aim *= 2.0) {
          const double to = a.s + by + aim;
          if (to >= hi) return to - hi < close;
          const Vec<N> trial = a.x + a.rate * ((by + aim) * step.curve.h);
          if (to > lo && guard(trial) <= 0.0) {
            hi = to;
            x = trial;
            return true;
          }
        }
        return false;
      }
      const double to = a.s + by - 0.5 * bend(a.s) * by * by / d;
      a = from(a, within(to, lo, hi));
    }
    return false;
  }

  // For a kink, a jump or a bottom: rare and bounded.
  void halve(double lo, double& hi, Vec<N>& x) const noexcept {
    for (int i = 0; i < halvings && hi - lo > hair; ++i) {
      const double mid = 0.5 * (lo + hi);
      const Vec<N> trial = step.reintegrated(mid);
      if (guard(trial) > 0.0) {
        lo = mid;
      } else {
        hi = mid;
        x = trial;
      }
    }
  }
};

template <int N, class F, class Method, class G>
void in_long_step(const Step<N, F, Method>& step, const G& guard, const Ends& ends, double scale, double lo,
                  Crossing<N>& found) noexcept {
  const LongStep<N, F, Method, G> along{step, guard, ends, scale};
  double hi = 1.0;
  double s = -1.0;
  found.x = step.end;
  if (const Dip low = dip(ends.g0, ends.d0, ends.g1, ends.d1); low.s > lo && !(along.cubic(low.s) > off * scale)) {
    const auto bottom = along.bottom(low.s, lo);
    const double depth = guard(bottom.x);
    found.grazing = std::abs(depth) < doubtful_dip * scale;
    if (found.grazing) found.s = bottom.s;
    if (!(depth > 0.0)) {
      hi = bottom.s;
      found.x = bottom.x;
      s = hi - std::sqrt(-2.0 * depth / along.bend(low.s));
    }
  }
  if (hi == 1.0) {
    if (ends.g1 > 0.0) {
      // The bottom may lie where this step meets the next.
      if (ends.g1 < doubtful_dip * scale && std::abs(along.slope(step.end, step.f(step.end))) < tangential * scale) {
        found.grazing = true;
        found.s = 1.0;
      }
      return;
    }
    s = along.guess(lo);
  }
  double slope = 0.0;
  if (!along.settled(along.at(along.within(s, lo, hi)), lo, hi, found.x, slope)) {
    along.halve(lo, hi, found.x);
    slope = along.slope(found.x, step.f(found.x));
  }
  found.s = hi;
  found.grazing = found.grazing || slope > -tangential * scale;
  found.kind = guard(found.x) <= 0.0 ? Crossing<N>::Kind::crossed : Crossing<N>::Kind::diverged;
}

}  // namespace saltus::crossing
