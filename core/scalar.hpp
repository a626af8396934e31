// The scalars a model may be written in: double, float, and Dual<K>, a forward-mode dual number with K directions.
// Exact derivatives of a model come from running the same code on Dual; finite differences belong in tests.
//
// Dual is an own type, not Eigen's AutoDiffScalar: that one returns expression templates which hold references to
// temporaries, so that `const auto F = k * (l0 - y);` in a model would compile and then read freed memory.
#pragma once

#include <array>
#include <cmath>
#include <limits>

#include "exponential.hpp"
#include "linalg.hpp"
#include "trigonometry.hpp"

namespace saltus {

// value + sum_k gradient[k] eps_k, eps_k eps_l = 0. Comparisons look at the value alone.
// The gradient lies first, so that copies of the whole and sums of gradients move by the same pairs of numbers: behind
// the value each pair would be read across two that were just written, and wait for both.
template <int K>
struct Dual {
  std::array<double, static_cast<std::size_t>(K)> gradient{};
  double value = 0.0;

  constexpr Dual() noexcept = default;
  constexpr Dual(double v) noexcept : value(v) {}  // NOLINT(google-explicit-constructor): a constant is a dual number
  // The variable number `direction`, in [0, K).
  static constexpr Dual variable(double v, int direction) noexcept {
    Dual d(v);
    d.gradient[static_cast<std::size_t>(direction)] = 1.0;
    return d;
  }

  // f(x) with f' = slope: the chain rule, once for every elementary function.
  constexpr Dual chain(double f, double slope) const noexcept {
    Dual r(f);
    for (std::size_t k = 0; k < r.gradient.size(); ++k) r.gradient[k] = slope * gradient[k];
    return r;
  }

  constexpr Dual& operator+=(const Dual& o) noexcept {
    value += o.value;
    for (std::size_t k = 0; k < gradient.size(); ++k) gradient[k] += o.gradient[k];
    return *this;
  }
  constexpr Dual& operator-=(const Dual& o) noexcept {
    value -= o.value;
    for (std::size_t k = 0; k < gradient.size(); ++k) gradient[k] -= o.gradient[k];
    return *this;
  }
  constexpr Dual& operator*=(const Dual& o) noexcept {
    for (std::size_t k = 0; k < gradient.size(); ++k) gradient[k] = gradient[k] * o.value + value * o.gradient[k];
    value *= o.value;
    return *this;
  }
  constexpr Dual& operator/=(const Dual& o) noexcept {
    value /= o.value;
    const double share = 1.0 / o.value;
    for (std::size_t k = 0; k < gradient.size(); ++k) gradient[k] = (gradient[k] - value * o.gradient[k]) * share;
    return *this;
  }
  constexpr Dual& operator*=(double o) noexcept { return *this = chain(value * o, o); }

  friend constexpr Dual operator+(Dual a, const Dual& b) noexcept { return a += b; }
  friend constexpr Dual operator-(Dual a, const Dual& b) noexcept { return a -= b; }
  friend constexpr Dual operator*(Dual a, const Dual& b) noexcept { return a *= b; }
  friend constexpr Dual operator/(Dual a, const Dual& b) noexcept { return a /= b; }
  friend constexpr Dual operator+(Dual a, double b) noexcept { return a.value += b, a; }
  friend constexpr Dual operator+(double a, Dual b) noexcept { return b.value += a, b; }
  friend constexpr Dual operator-(Dual a, double b) noexcept { return a.value -= b, a; }
  friend constexpr Dual operator-(double a, const Dual& b) noexcept { return b.chain(a - b.value, -1.0); }
  friend constexpr Dual operator*(Dual a, double b) noexcept { return a *= b; }
  friend constexpr Dual operator*(double a, Dual b) noexcept { return b *= a; }
  friend constexpr Dual operator/(const Dual& a, double b) noexcept { return a.chain(a.value / b, 1.0 / b); }
  friend constexpr Dual operator/(double a, const Dual& b) noexcept { return Dual(a) /= b; }
  friend constexpr Dual operator-(const Dual& a) noexcept { return a.chain(-a.value, -1.0); }
  friend constexpr Dual operator+(const Dual& a) noexcept { return a; }

  friend constexpr bool operator==(const Dual& a, const Dual& b) noexcept { return a.value == b.value; }
  friend constexpr auto operator<=>(const Dual& a, const Dual& b) noexcept { return a.value <=> b.value; }
};

// The elementary functions of a model, for every scalar. A model outside this namespace writes `using saltus::sin;`.
// sin, cos, exp and tanh are own ones, equal to the last bit on every processor; atan2 and log are std's.
using std::abs;
using std::atan2;
using std::log;
using std::sqrt;

template <int K>
Dual<K> sin(const Dual<K>& x) noexcept {
  const auto p = on_circle(x.value);
  return x.chain(p.sin, p.cos);
}
template <int K>
Dual<K> cos(const Dual<K>& x) noexcept {
  const auto p = on_circle(x.value);
  return x.chain(p.cos, -p.sin);
}
template <int K>
OnCircle<Dual<K>> on_circle(const Dual<K>& x) noexcept {
  const auto p = on_circle(x.value);
  return {x.chain(p.cos, -p.sin), x.chain(p.sin, p.cos)};
}
template <int K>
Dual<K> exp(const Dual<K>& x) noexcept {
  const double e = exp(x.value);
  return x.chain(e, e);
}
template <int K>
Dual<K> log(const Dual<K>& x) noexcept {
  return x.chain(log(x.value), 1.0 / x.value);
}
template <int K>
Dual<K> tanh(const Dual<K>& x) noexcept {
  const double t = tanh(x.value);
  return x.chain(t, 1.0 - t * t);
}
// At zero a direction in which x does not move does not move the root either: infinity times zero is zero here, so that
// the length of a vector may vanish.
template <int K>
Dual<K> sqrt(const Dual<K>& x) noexcept {
  const double r = sqrt(x.value);
  if (r > 0.0) return x.chain(r, 0.5 / r);
  Dual<K> d(r);
  for (std::size_t k = 0; k < d.gradient.size(); ++k)
    d.gradient[k] = x.gradient[k] == 0.0 ? 0.0 : 0.5 / r * x.gradient[k];
  return d;
}
// The slope at zero is taken as 0 (the mean of both sides).
template <int K>
Dual<K> abs(const Dual<K>& x) noexcept {
  return x.chain(abs(x.value), x.value > 0.0 ? 1.0 : (x.value < 0.0 ? -1.0 : 0.0));
}
template <int K>
Dual<K> atan2(const Dual<K>& y, const Dual<K>& x) noexcept {
  const double rr = x.value * x.value + y.value * y.value;
  Dual<K> r(atan2(y.value, x.value));
  for (std::size_t k = 0; k < r.gradient.size(); ++k) {
    r.gradient[k] = (x.value * y.gradient[k] - y.value * x.gradient[k]) / rr;
  }
  return r;
}

inline constexpr double value_of(double x) noexcept { return x; }
inline constexpr double value_of(float x) noexcept { return static_cast<double>(x); }
template <int K>
constexpr double value_of(const Dual<K>& x) noexcept {
  return x.value;
}

// The value of each entry, and the K gradients as the columns of a matrix (N x K).
template <int N, class S>
Vec<N> value_of(const Vec<N, S>& x) noexcept {
  Vec<N> r;
  for (int i = 0; i < N; ++i) r[i] = value_of(x[i]);
  return r;
}
template <int N, int K>
Mat<N, K> gradient_of(const Vec<N, Dual<K>>& x) noexcept {
  Mat<N, K> r;
  for (int i = 0; i < N; ++i) {
    for (int k = 0; k < K; ++k) r(i, k) = x[i].gradient[static_cast<std::size_t>(k)];
  }
  return r;
}

}  // namespace saltus

template <int K>
struct Eigen::NumTraits<saltus::Dual<K>> : Eigen::GenericNumTraits<double> {
  using Real = saltus::Dual<K>;
  using NonInteger = saltus::Dual<K>;
  using Nested = saltus::Dual<K>;
  using Literal = double;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 1,
    ReadCost = K,
    AddCost = K,
    MulCost = 3 * K
  };
};
template <int K, class Op>
struct Eigen::ScalarBinaryOpTraits<saltus::Dual<K>, double, Op> {
  using ReturnType = saltus::Dual<K>;
};
template <int K, class Op>
struct Eigen::ScalarBinaryOpTraits<double, saltus::Dual<K>, Op> {
  using ReturnType = saltus::Dual<K>;
};
