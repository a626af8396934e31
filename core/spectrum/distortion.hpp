// Nonlinear distortion, told from noise by the lines on which it falls.
//
// A stimulus of odd lines q with an even period P: a periodic system moves lines by multiples of P, which keeps parity,
// so distortion of even order (sums of an even number of tones) falls on even lines, distortion of odd order on odd
// ones. Even lines and odd classes left silent hold distortion and noise, no linear response; repeats tell the noise
// (Pintelon & Schoukens 2012, ch. 4, here for systems of period N).
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>

#include "../least_squares.hpp"
#include "../linalg.hpp"
#include "lines.hpp"
#include "noise.hpp"

namespace saltus {

enum class LineKind : std::uint8_t {
  excited,  // the linear response lies here
  even,     // silent, even: distortion of even order
  odd,      // silent, odd: distortion of odd order
  neither,  // class 0: the machine's own cycle lies here
};

// What output line `q` shows in an experiment with these tones, the period even.
inline LineKind line_kind(std::int64_t q, int period, std::span<const int> tones) noexcept {
  const int r = residue_class(q, period);
  for (const int tone : tones) {
    if (residue_class(tone, period) == r) return LineKind::excited;
  }
  if (r == 0) return LineKind::neither;
  return r % 2 == 0 ? LineKind::even : LineKind::odd;
}

// Mean power of the distortion on a set of silent lines.
class DistortionLevel {
 public:
  // The mean of a silent line over `periods` and the variance E |Y - mean|^2 of one period.
  void add(Complex mean, double variance, std::int64_t periods) noexcept {
    const double v = variance / static_cast<double>(periods);
    ++lines_;
    power_ += std::norm(mean);
    noise_ += v;
    freedom_ += static_cast<double>(periods - 1);
  }

  int lines() const noexcept { return lines_; }
  // Root mean square of the distortion of a line, noise taken off [output unit]; 0 where the noise covers it.
  double rms() const noexcept { return std::sqrt(std::fmax(0.0, power_ - noise_) / count()); }
  // Root mean square of the noise of the mean of a line [output unit].
  double noise() const noexcept { return std::sqrt(noise_ / count()); }
  // Standard error of rms() by the delta method: noise about a fixed distortion.
  double sigma() const noexcept {
    const double n = noise_ / count(), d = std::fmax(0.0, power_ - noise_) / count();
    const double variance = (n * n * (1.0 + count() / std::fmax(1.0, freedom_)) + 2.0 * n * d) / count();
    return rms() > 0.0 ? 0.5 * std::sqrt(variance) / rms() : std::sqrt(std::sqrt(variance));
  }
  // Probability of this much power or more from noise alone.
  double chance() const noexcept {
    return lines_ > 0 && noise_ > 0.0 ? chance_of(power_ / noise_, lines_, freedom_) : 1.0;
  }

 private:
  double count() const noexcept { return lines_ > 0 ? static_cast<double>(lines_) : 1.0; }

  int lines_ = 0;
  double power_ = 0.0, noise_ = 0.0, freedom_ = 0.0;
};

// A quantity measured at several amplitudes, extrapolated to amplitude zero: c0 + c1 A^2 + c2 A^4 (random or opposed
// phases leave even powers only), of the least degree that the standard errors allow.
struct ZeroAmplitude {
  Complex value{};
  double sigma = std::numeric_limits<double>::infinity();  // sqrt(E |error|^2)
  int degree = 0;                                          // 0 to 2, in A^2
  double chi_square = 0.0;                                 // of the fit, over its degrees of freedom
  bool fits = false;                                       // chi_square is what noise explains
};

// sigma[i] = sqrt(E |error|^2) of value[i], all positive; equal lengths.
inline ZeroAmplitude extrapolate_to_zero(std::span<const double> amplitude, std::span<const Complex> value,
                                         std::span<const double> sigma) noexcept {
  ZeroAmplitude best;
  double largest = 0.0;
  for (const double a : amplitude) largest = std::fmax(largest, std::fabs(a));
  if (!(largest > 0.0) || value.size() != amplitude.size() || sigma.size() != amplitude.size()) return best;
  for (int degree = 0; degree <= 2 && static_cast<std::size_t>(degree) < amplitude.size(); ++degree) {
    LeastSquares<3> re, im;
    for (std::size_t i = 0; i < amplitude.size(); ++i) {
      const double x = amplitude[i] * amplitude[i] / (largest * largest), w = 2.0 / (sigma[i] * sigma[i]);
      const std::array<double, 3> row{1.0, degree > 0 ? x : 0.0, degree > 1 ? x * x : 0.0};
      re.add(row, value[i].real(), w);
      im.add(row, value[i].imag(), w);
    }
    std::array<double, 3> a{}, b{};
    if (re.solve(a) != Status::ok || im.solve(b) != Status::ok) break;
    const double freedom = 2.0 * (static_cast<double>(amplitude.size()) - degree - 1);
    const double chi = re.rss() + im.rss();
    best.value = {a[0], b[0]};
    best.sigma = std::sqrt(re.covariance(0, 0) + im.covariance(0, 0));
    best.degree = degree;
    best.chi_square = freedom > 0.0 ? chi / freedom : 0.0;
    best.fits = freedom <= 0.0 || chance_of(best.chi_square, 0.5 * freedom, 1e15) > 0.05;
    if (best.fits) break;
  }
  return best;
}

}  // namespace saltus
