// Tail probabilities and thresholds: what may happen by chance.
#pragma once

#include <cmath>
#include <initializer_list>

namespace saltus {

// P(Z > z) of a standard normal number.
inline double normal_tail(double z) noexcept { return 0.5 * std::erfc(z / std::sqrt(2.0)); }

// z with P(Z > z) = p, 0 < p < 1; by bisection, to the last bits.
inline double normal_quantile(double p) noexcept {
  double low = -40.0, high = 40.0;
  for (int i = 0; i < 80; ++i) {
    const double mid = 0.5 * (low + high);
    (normal_tail(mid) > p ? low : high) = mid;
  }
  return 0.5 * (low + high);
}

// What the largest of n independent |Z| exceeds with probability alpha (one-sided: of n numbers Z).
inline double largest_of(int n, double alpha, bool one_sided = false) noexcept {
  const double each = -std::expm1(std::log1p(-alpha) / (n < 1 ? 1 : n));
  return normal_quantile(one_sided ? each : 0.5 * each);
}

// Regularised incomplete beta function I_x(a, b), by its continued fraction (Lentz; Press et al., sec. 6.4).
inline double incomplete_beta(double a, double b, double x) noexcept {
  if (!(x > 0.0)) return 0.0;
  if (x >= 1.0) return 1.0;
  if (x > (a + 1.0) / (a + b + 2.0)) return 1.0 - incomplete_beta(b, a, 1.0 - x);
  const double front = std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) + a * std::log(x) + b * std::log1p(-x)) / a;
  constexpr double tiny = 1e-300;
  double c = 1.0, d = 1.0 - (a + b) * x / (a + 1.0);
  d = 1.0 / (std::abs(d) < tiny ? tiny : d);
  double f = d;
  for (int m = 1; m <= 2000; ++m) {
    const double even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
    const double odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
    for (const double k : {even, odd}) {
      d = 1.0 + k * d;
      d = 1.0 / (std::abs(d) < tiny ? tiny : d);
      c = 1.0 + k / c;
      if (std::abs(c) < tiny) c = tiny;
      f *= c * d;
    }
    if (std::abs(c * d - 1.0) < 1e-14) break;
  }
  return front * f;
}

// P(F > f) of Fisher's ratio with d1 and d2 degrees of freedom.
inline double fisher_tail(double f, double d1, double d2) noexcept {
  if (!(f > 0.0)) return 1.0;
  return incomplete_beta(0.5 * d2, 0.5 * d1, d2 / (d2 + d1 * f));
}

// P(T > t) of Student's number with d degrees of freedom.
inline double student_tail(double t, double d) noexcept {
  const double half = 0.5 * incomplete_beta(0.5 * d, 0.5, d / (d + t * t));
  return t >= 0.0 ? half : 1.0 - half;
}

}  // namespace saltus
