// Sine and cosine of their own: libm's differ between libraries, and within one between processors with and without
// fused multiply-adds. These take additions, products and comparisons only, so the same angle gives the same bits
// everywhere (with -ffp-contract=off), and they need no library at all.
//
// An angle is reduced to x - n pi/2 in [-pi/4, pi/4], carried with its rounding error, and handed to a polynomial. The
// polynomials are minimax (Remez's exchange) to 2^-58 and 2^-64. Error at most 0.85 ulp, 1.1 ulp at the numbers next
// to a multiple of pi/2. Beyond 2^50 rad, where neighbouring numbers are a quarter of a radian apart and more, a turn
// is the number nearest 2 pi. NaN for what is not finite.
#pragma once

#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>

namespace saltus {

namespace trigonometry {

// x = quadrant pi/2 + angle + rest, |angle| <= pi/4 but for rounding.
template <class T>
struct Reduced {
  T angle, rest;
  unsigned quadrant;  // 0 ... 3
};

// What follows is for doubles, and for lanes of them (lanes.hpp): the same operations in the same order.
template <class T>
struct Sum {
  T high, low;
};
// a - b and its rounding error, whichever is larger.
template <class T>
[[gnu::always_inline]] inline Sum<T> difference(const T& a, const T& b) noexcept {
  const T d = a - b, back = a - d;
  return {d, (back - b) + (a - (d + back))};
}

// An angle beyond 1.6e6 rad, less whole turns: rare, slow, bounded.
[[gnu::noinline]] inline Sum<double> within_turns(double x) noexcept {
  constexpr double turn = 0x1.921fb54442d18p+2, rest = 0x1.1a62633145c07p-52, last = -0x1.f1976b7ed8fbcp-108;
  constexpr double many = 0x1p50;
  if (!(std::fabs(x) <= std::numeric_limits<double>::max())) return {std::numeric_limits<double>::quiet_NaN(), 0.0};
  while (std::fabs(x) >= many) {
    double step = turn;
    while (std::fabs(x) / step >= many) step *= many;
    x = std::fma(-std::trunc(x / step), step, x);
  }
  const double n = std::trunc(x / turn);
  const double product = n * rest;
  const Sum<double> d = difference(std::fma(-n, turn, x), product);
  return {d.high, d.low - (std::fma(n, rest, -product) + n * last)};
}

inline constexpr double far = 0x1.921fb54442d18p+20;  // 2^20 quarter turns: the next two hold up to there

// An angle that is `beyond` further on, less quarter turns.
template <class T>
struct Turned {
  T angle, rest;
  T shown;  // the last two bits are the quadrant
};
template <class T>
[[gnu::always_inline]] inline Turned<T> turned(const T& x, const T& beyond) noexcept {
  constexpr double p1 = 0x1.921fb544p+0, p2 = 0x1.0b4611a6p-34, p3 = 0x1.3198a2e037073p-69;  // pi/2, 33 bits in each
  constexpr double two_over_pi = 0x1.45f306dc9c883p-1;
  constexpr double to_integer = 0x1.8p52;  // added, it rounds to an integer and shows it in the last bits
  const T shown = x * two_over_pi + to_integer;
  const T n = shown - to_integer;
  const Sum<T> d = difference<T>(x - n * p1, n * p2);  // exact but for the difference
  const T rest = d.low - n * p3 + beyond;
  const T angle = d.high + rest;
  return {angle, (d.high - angle) + rest, shown};
}

[[gnu::always_inline]] inline Reduced<double> reduce(double x) noexcept {
  double beyond = 0.0;
  if (!(std::fabs(x) <= far)) {
    const Sum<double> s = within_turns(x);
    x = s.high;
    beyond = s.low;
  }
  const Turned<double> t = turned(x, beyond);
  return {t.angle, t.rest, static_cast<unsigned>(std::bit_cast<std::uint64_t>(t.shown) & 3)};
}

// Of the angle y + rest.
template <class T>
[[gnu::always_inline]] inline T sine(const T& y, const T& y_rest) noexcept {
  const T z = y * y, zz = z * z;
  const T low = -0x1.5555555555549p-3 + z * 0x1.111111110f8a6p-7;
  const T mid = -0x1.a01a019c1619dp-13 + z * 0x1.71de357b1bdd3p-19;
  const T high = -0x1.ae5e689eed857p-26 + z * 0x1.5d93a46b49d34p-33;
  return y + (z * y * (low + zz * (mid + zz * high)) + y_rest * (1.0 - 0.5 * z));
}

template <class T>
[[gnu::always_inline]] inline T cosine(const T& y, const T& y_rest) noexcept {
  const T z = y * y, zz = z * z;
  const T low = 0x1.555555555554cp-5 - z * 0x1.6c16c16c1521fp-10;
  const T mid = 0x1.a01a019cbf629p-16 - z * 0x1.27e4f812b6690p-22;
  const T high = 0x1.1ee9f1528c0c8p-29 - z * 0x1.8fb130f863de5p-37;
  const T half = 0.5 * z, top = 1.0 - half;
  return top + (((1.0 - top) - half) + (zz * (low + zz * (mid + zz * high)) - y * y_rest));
}

inline double sine(const Reduced<double>& r) noexcept { return sine(r.angle, r.rest); }
inline double cosine(const Reduced<double>& r) noexcept { return cosine(r.angle, r.rest); }

// In single precision Taylor's polynomials do: what they leave out is below 2^-29 and 2^-33.
inline float sine(const Reduced<float>& r) noexcept {
  const float y = r.angle, z = y * y;
  const float sum = -1.0f / 6 + z * (1.0f / 120 + z * (-1.0f / 5040 + z * (1.0f / 362880)));
  return y + (z * y * sum + r.rest * (1.0f - 0.5f * z));
}

inline float cosine(const Reduced<float>& r) noexcept {
  const float y = r.angle, z = y * y, half = 0.5f * z, top = 1.0f - half;
  const float sum = 1.0f / 24 + z * (-1.0f / 720 + z * (1.0f / 40320 - z * (1.0f / 3628800)));
  return top + (((1.0f - top) - half) + (z * z * sum - y * r.rest));
}

}  // namespace trigonometry

// Templates, so that beside the C library's functions of the same name they are never ambiguous.
template <std::floating_point T>
T sin(T x) noexcept {
  const trigonometry::Reduced<double> r = trigonometry::reduce(static_cast<double>(x));
  const double s = r.quadrant % 2 == 0 ? trigonometry::sine(r) : trigonometry::cosine(r);
  return static_cast<T>(r.quadrant < 2 ? s : -s);
}

template <std::floating_point T>
T cos(T x) noexcept {
  const trigonometry::Reduced<double> r = trigonometry::reduce(static_cast<double>(x));
  const double c = r.quadrant % 2 == 0 ? trigonometry::cosine(r) : trigonometry::sine(r);
  return static_cast<T>(r.quadrant == 0 || r.quadrant == 3 ? c : -c);
}

// Both for one reduction: the point of the unit circle at an angle.
template <class T = double>
struct OnCircle {
  T cos, sin;
};
template <std::floating_point T>
OnCircle<T> on_circle(T x) noexcept {
  const trigonometry::Reduced<double> r = trigonometry::reduce(static_cast<double>(x));
  const T s = static_cast<T>(trigonometry::sine(r)), c = static_cast<T>(trigonometry::cosine(r));
  switch (r.quadrant) {
    case 0:
      return {c, s};
    case 1:
      return {-s, c};
    case 2:
      return {-c, -s};
    default:
      return {s, -c};
  }
}

}  // namespace saltus
