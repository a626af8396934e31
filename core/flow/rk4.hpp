// The classical fixed-step Runge-Kutta method of order four, and the cubic that joins the two ends of a step.
#pragma once

#include "../linalg.hpp"

namespace saltus {

// State after a step of length h [s] from x, where f0 = f(x) is already known: three evaluations of f.
template <int N, class S, class F, class H>
Vec<N, S> rk4(const F& f, const Vec<N, S>& x, const Vec<N, S>& f0, const H& h) noexcept {
  const H half = h * 0.5;
  const Vec<N, S> k2 = f(Vec<N, S>(x + f0 * half));
  const Vec<N, S> k3 = f(Vec<N, S>(x + k2 * half));
  const Vec<N, S> k4 = f(Vec<N, S>(x + k3 * h));
  return x + (f0 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
}

// The same as a method for `advance` and what stands on it: the default. Rk8 is the other.
struct Rk4 {
  static constexpr bool long_steps = false;  // the cubic through the ends is nearly as good as the step

  // Sets f1, the rate at the end.
  template <int N, class S, class F, class H>
  static Vec<N, S> step(const F& f, const Vec<N, S>& x, const Vec<N, S>& f0, const H& h, Vec<N, S>& f1) noexcept {
    const Vec<N, S> x1 = step<N, S>(f, x, f0, h);
    f1 = f(x1);
    return x1;
  }
  template <int N, class S, class F, class H>
  static Vec<N, S> step(const F& f, const Vec<N, S>& x, const Vec<N, S>& f0, const H& h) noexcept {
    return rk4<N, S>(f, x, f0, h);
  }
};

// The cubic Hermite interpolant of a step: order four at every point inside it, no further evaluation of f.
template <int N, class S = double>
struct Hermite {
  Vec<N, S> x0, f0, x1, f1;  // ends of the step and the rates there
  double h;                  // [s]

  // s in [0, 1], the fraction of the step.
  Vec<N, S> operator()(double s) const noexcept {
    const double r = 1.0 - s;
    const double b0 = r * r * (1.0 + 2.0 * s);
    const double b1 = s * s * (1.0 + 2.0 * r);
    const double d0 = h * s * r * r;
    const double d1 = h * s * s * r;
    return b0 * x0 + b1 * x1 + d0 * f0 - d1 * f1;
  }
};

}  // namespace saltus
