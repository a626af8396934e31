// Exponential and hyperbolic tangent of their own, for the same reason as sine and cosine (trigonometry.hpp): the same
// argument gives the same bits everywhere. Error at most 1 ulp and 2.5 ulp.
#pragma once

#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>

namespace saltus {

namespace exponential {

// exp(x) = 2^power (1 + rise), |x| < 2000. For doubles, and for lanes of them (lanes.hpp).
template <class T>
struct Reduced {
  T rise;
  T power;  // an integer
};

template <class T>
[[gnu::always_inline]] inline Reduced<T> reduce(const T& x) noexcept {
  constexpr double ln2 = 0x1.62e42fefp-1, ln2_rest = 0x1.473de6af278edp-34;  // 33 bits, and the rest
  constexpr double to_integer = 0x1.8p52;                                    // added, it rounds to an integer
  const T n = (x * 0x1.71547652b82fep+0 + to_integer) - to_integer;
  const T high = x - n * ln2, low = n * ln2_rest;  // the first is exact
  const T r = high - low, rest = (high - r) - low;
  // (exp(r) - 1 - r) / r^2, minimax to 2^-57 (Remez's exchange).
  const T q = r * r, qq = q * q;
  const T p0 = 0x1.0000000000009p-1 + r * 0x1.5555555555558p-3;
  const T p1 = 0x1.555555555047cp-5 + r * 0x1.111111110f803p-7;
  const T p2 = 0x1.6c16c185e42b1p-10 + r * 0x1.a01a01b00c2c6p-13;
  const T p3 = 0x1.a01993fcd4479p-16 + r * 0x1.71ddf6b3f10d1p-19;
  const T p4 = 0x1.28b3d265d50cep-22 + r * 0x1.af632ad6abee8p-26;
  const T p = (p0 + q * p1) + qq * ((p2 + q * p3) + qq * p4);
  return {r + (q * p + rest), n};
}

// 2^n, -1022 <= n <= 1023.
inline double power_of_two(int n) noexcept { return std::bit_cast<double>(static_cast<std::uint64_t>(n + 1023) << 52); }

}  // namespace exponential

template <std::floating_point T>
T exp(T x) noexcept {
  const auto d = static_cast<double>(x);
  if (!(d < 709.79)) return d > 0.0 ? std::numeric_limits<T>::infinity() : x;  // not a number stays so
  if (d < -745.2) return T(0);
  const exponential::Reduced<double> r = exponential::reduce(d);
  const int power = static_cast<int>(r.power);
  const int half = power / 2;  // in two steps: what is below the normal numbers is rounded once
  return static_cast<T>((1.0 + r.rise) * exponential::power_of_two(half) * exponential::power_of_two(power - half));
}

template <std::floating_point T>
T tanh(T x) noexcept {
  const double d = std::fabs(static_cast<double>(x));
  if (!(d < 22.0)) return d > 0.0 ? std::copysign(T(1), x) : x;
  const exponential::Reduced<double> r = exponential::reduce(2.0 * d);
  const double scale = exponential::power_of_two(static_cast<int>(r.power));
  const double e = scale * r.rise + (scale - 1.0);                   // exp(2 |x|) - 1
  const double t = e > 2.0 ? 1.0 - 2.0 / (e + 2.0) : e / (e + 2.0);  // near 1 the first never falls
  return static_cast<T>(std::copysign(t, static_cast<double>(x)));
}

}  // namespace saltus
