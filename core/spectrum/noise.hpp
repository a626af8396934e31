// What repeated stimulus periods say about the noise: the covariance of the lines of a residue class, confidence
// circles, coherence, and whether a harmonic is there at all. Noise comes from repeats, never from a fit.
#pragma once

#include <array>
#include <cmath>
#include <complex>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "../linalg.hpp"

namespace saltus {

// Mean and covariance of `Lines` complex numbers measured once a stimulus period, streaming, in constant memory. The
// lines q + l P of a class, over all outputs, are what a periodic system correlates: they belong in one vector.
template <int Lines>
class ClassNoise {
  static_assert(Lines >= 1);
  static constexpr auto size = static_cast<std::size_t>(Lines);

 public:
  // One period. Left out whole, and false, when a number is not finite.
  bool add(std::span<const Complex, size> y) noexcept {
    for (const Complex& x : y) {
      if (!std::isfinite(x.real()) || !std::isfinite(x.imag())) return false;
    }
    const double share = 1.0 / static_cast<double>(++periods_);
    std::array<Complex, size> before;
    for (std::size_t i = 0; i < size; ++i) {
      before[i] = y[i] - mean_[i];
      mean_[i] += before[i] * share;
    }
    for (std::size_t i = 0; i < size; ++i) {
      for (std::size_t j = 0; j <= i; ++j) scatter_[cell(i, j)] += before[i] * std::conj(y[j] - mean_[j]);
    }
    freedom_ = periods_ - 1;
    return true;
  }

  // Takes over the scatter of another class about its own mean: neighbours in frequency have nearly the same noise. The
  // mean stays that of this class.
  void pool(const ClassNoise& other) noexcept {
    for (std::size_t i = 0; i < scatter_.size(); ++i) scatter_[i] += other.scatter_[i];
    pooled_ += other.freedom();
  }

  std::int64_t periods() const noexcept { return periods_; }
  std::int64_t freedom() const noexcept { return freedom_ + pooled_; }  // complex degrees of freedom of the covariance
  Complex mean(int i) const noexcept { return mean_[static_cast<std::size_t>(i)]; }

  // Unbiased E (y_i - mean)(y_j - mean)* of one period; NaN before there is a degree of freedom. That of the mean is
  // smaller by periods().
  Complex covariance(int i, int j) const noexcept {
    if (freedom() < 1) return {std::numeric_limits<double>::quiet_NaN(), 0.0};
    const auto a = static_cast<std::size_t>(i), b = static_cast<std::size_t>(j);
    const Complex sum = a >= b ? scatter_[cell(a, b)] : std::conj(scatter_[cell(b, a)]);
    return sum / static_cast<double>(freedom());
  }

  // Standard error of the mean of line i, sqrt(E |error|^2).
  double sigma(int i) const noexcept { return std::sqrt(covariance(i, i).real() / static_cast<double>(periods_)); }

 private:
  static constexpr std::size_t cell(std::size_t i, std::size_t j) noexcept { return i * (i + 1) / 2 + j; }

  std::int64_t periods_ = 0, freedom_ = 0, pooled_ = 0;
  std::array<Complex, size> mean_{};
  std::array<Complex, size*(size + 1) / 2> scatter_{};  // lower triangle
};

// Radius of the confidence circle of a complex estimate, in units of its standard error sqrt(E |error|^2), where that
// is known to `freedom` complex degrees of freedom: |error|^2 / sigma^2 has the F distribution of (2, 2 freedom), whose
// quantile is closed. `level` in (0, 1); freedom infinite: sqrt(-ln(1 - level)).
inline double confidence_radius(double level, double freedom) noexcept {
  if (!(freedom < 1e12)) return std::sqrt(-std::log1p(-level));
  return std::sqrt(freedom * std::expm1(-std::log1p(-level) / freedom));
}

// Part of one period's power on a line that repeats, 0 to 1, from its mean over `periods` and the variance of one
// period; unbiased to first order.
inline double coherence(Complex mean, double variance, std::int64_t periods) noexcept {
  const double repeats = std::norm(mean) - variance / static_cast<double>(periods);
  return repeats > 0.0 ? repeats / (repeats + variance) : 0.0;
}

// Probability that noise alone gives a mean of |estimate|^2 / sigma^2 over `lines` as large as `mean_square`, the
// variances known to `freedom` complex degrees of freedom together: F of (2 lines, 2 freedom), by Paulson's
// approximation (good to 1e-3 for ten lines and more).
inline double chance_of(double mean_square, double lines, double freedom) noexcept {
  const double a = 1.0 / (9.0 * lines), b = freedom < 1e12 ? 1.0 / (9.0 * freedom) : 0.0;
  const double root = std::cbrt(mean_square);
  const double z = ((1.0 - b) * root - (1.0 - a)) / std::sqrt(b * root * root + a);
  return 0.5 * std::erfc(z / std::sqrt(2.0));
}

}  // namespace saltus
