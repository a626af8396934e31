// Parametric fits of the fundamental harmonic transfer function H_0, and the Floquet multipliers they hold.
// Ankarali & Cowan 2014, VI.C.3: the poles of H_0 are N-th roots of the eigenvalues of the return map.
#pragma once

#include "../least_squares.hpp"
#include "../linalg.hpp"
#include "../status.hpp"
#include "twiddles.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <utility>

namespace saltus {

// One measured value of a frequency response. The weight is an inverse variance, up to a common factor.
struct ResponseSample {
  double omega = 0.0;  // [rad/sample], 2 pi f / N for f cycles per period
  Complex value{};
  double weight = 1.0;
};

// H(z) = sum_j b[j] z^-(First+j) / (1 + sum_k a[k] z^-(Stride (k+1))),  z = e^(i omega), with R poles in z^Stride.
template <int N, int Stride, int R, int First, int Taps>
struct TransferFit {
  static_assert(N >= 1 && R >= 1 && R <= 4 && Taps >= 1 && N % Stride == 0);

  std::array<double, static_cast<std::size_t>(Taps)> b{};
  std::array<double, static_cast<std::size_t>(R)> a{};
  std::array<Complex, static_cast<std::size_t>(R)> poles{};        // in z^Stride, falling modulus, conjugates +i first
  std::array<Complex, static_cast<std::size_t>(R)> multipliers{};  // poles^(N/Stride): one period
  // Standard errors of the multipliers, sqrt(E |error|^2), where the residual is white noise; misfit is not in them.
  std::array<double, static_cast<std::size_t>(R)> sigma{};
  double cost = std::numeric_limits<double>::infinity();  // sum of weight |value - H|^2
  double rms = std::numeric_limits<double>::infinity();   // sqrt(cost / sum of weights)
  int iterations = 0;                                     // linear problems solved
  Status status = Status::failed;  // missing: a sample was left out. failed: not converged, or too few samples for all
                                   // coefficients (an R above the number of multipliers, too); sigma is infinite
};

// Two poles and a zero, H(z) = (b[0] z + b[1]) / (z^2 + a[0] z + a[1]).
template <int N>
using RationalFit = TransferFit<N, 1, 2, 1, 2>;

// The form that H_0 of a linear discrete-time system of period N with R non-zero multipliers has exactly: after N
// samples the nilpotent part has died out, and h[n] + a_1 h[n-N] + ... + a_R h[n-RN] = 0 from n = (R+1) N on
// (Cayley-Hamilton). Each multiplier brings N image poles, and the roots in z^N are the multipliers themselves.
template <int N, int R>
using ImagePoleFit = TransferFit<N, N, R, 0, (R + 1) * N>;

// Value of a fitted form at omega [rad/sample]. Outside the band of the samples only RationalFit is to be trusted.
template <int N, int Stride, int R, int First, int Taps>
Complex evaluate(const TransferFit<N, Stride, R, First, Taps>& fit, double omega) noexcept {
  Complex numerator{};
  Complex denominator = 1.0;
  for (int j = 0; j < Taps; ++j) numerator += fit.b[static_cast<std::size_t>(j)] * phasor(-omega * (First + j));
  for (int k = 0; k < R; ++k) {
    denominator += fit.a[static_cast<std::size_t>(k)] * phasor(-omega * (Stride * (k + 1)));
  }
  return numerator / denominator;
}

// Roots of x^R + a[0] x^(R-1) + ... + a[R-1] by Weierstrass' simultaneous iteration; falling modulus, conjugates +i
// first.
template <std::size_t R>
std::array<Complex, R> roots(const std::array<double, R>& a) noexcept {
  double radius = 0.0;
  for (std::size_t k = 0; k < R; ++k) {
    radius = std::max(radius, std::pow(std::abs(a[k]), 1.0 / static_cast<double>(k + 1)));
  }
  std::array<Complex, R> x{};
  if (!(radius > 0.0) || !std::isfinite(radius)) return x;
  for (std::size_t i = 0; i < R; ++i) x[i] = radius * phasor(0.4 + 2.0 * static_cast<double>(i));
  for (int sweep = 0; sweep < 100; ++sweep) {
    double change = 0.0;
    for (std::size_t i = 0; i < R; ++i) {
      Complex value = 1.0;
      Complex product = 1.0;
      for (std::size_t k = 0; k < R; ++k) value = value * x[i] + a[k];
      for (std::size_t k = 0; k < R; ++k) {
        if (k != i) product *= x[i] - x[k];
      }
      if (product == Complex{}) product = std::numeric_limits<double>::epsilon() * radius;
      x[i] -= value / product;
      change = std::max(change, std::abs(value / product));
    }
    if (change <= 1e-16 * radius) break;
  }
  for (Complex& root : x) {
    if (std::abs(root.imag()) < 1e-15 * radius) root = root.real();  // real but for rounding
  }
  const auto precedes = [](Complex p, Complex q) {
    const double gap = std::abs(p) - std::abs(q);
    return std::abs(gap) > 1e-12 * std::abs(p) ? gap > 0.0 : p.imag() > q.imag();
  };
  for (std::size_t i = 1; i < R; ++i) {
    for (std::size_t k = i; k > 0 && precedes(x[k], x[k - 1]); --k) std::swap(x[k], x[k - 1]);
  }
  return x;
}

// The search behind both fits: Levy's linear problem, Sanathanan-Koerner reweighting of it, then Gauss-Newton with
// Levenberg-Marquardt damping on the cost itself. All three are one linear problem,
//   (1 / |A|) ( A value + G sum_k da_k z^-(Stride k) - sum_j b_j z^-(First+j) ) -> 0   over da and b,
// around the denominator A at hand, with G the measured value (Sanathanan-Koerner) or the fitted one (Gauss-Newton).
template <class Fit>
class TransferSearch;

template <int N, int Stride, int R, int First, int Taps>
class TransferSearch<TransferFit<N, Stride, R, First, Taps>> {
 public:
  using Fit = TransferFit<N, Stride, R, First, Taps>;

  static Fit run(std::span<const ResponseSample> samples, bool bounded) noexcept {
    TransferSearch work(samples, bounded);
    Fit fit;
    if (2 * work.count_ > columns) fit = work.search();
    work.conclude(fit);
    return fit;
  }

 private:
  static constexpr std::size_t columns = static_cast<std::size_t>(Taps + R);
  static constexpr int reweightings = 12;
  static constexpr int refinements = 100;
  static constexpr std::size_t taps = static_cast<std::size_t>(Taps);
  static constexpr std::size_t order = static_cast<std::size_t>(R);
  static constexpr std::size_t stride = static_cast<std::size_t>(Stride);
  static constexpr std::size_t first = static_cast<std::size_t>(First);
  static constexpr std::size_t top = std::max(first + taps - 1, stride* order);

  // A fit at one sample.
  struct Point {
    std::array<Complex, top + 1> power;  // z^-j
    Complex numerator, denominator;
  };

  // `bounded`: the samples leave some taps free, which a ridge then bounds.
  TransferSearch(std::span<const ResponseSample> samples, bool bounded) noexcept : samples_(samples) {
    for (const ResponseSample& s : samples_) {
      if (!valid(s)) continue;
      ++count_;
      weight_ += s.weight;
      energy_ += s.weight * std::norm(s.value);
    }
    if (bounded) ridge_ = 1e-18 * weight_;
  }

  static bool valid(const ResponseSample& s) noexcept {
    return std::isfinite(s.omega) && std::isfinite(std::abs(s.value)) && std::isfinite(s.weight) && s.weight > 0.0;
  }

  static Point at(const Fit& fit, double omega) noexcept {
    Point p;
    p.power[0] = 1.0;
    p.power[1] = phasor(-omega);
    for (std::size_t j = 2; j <= top; ++j) p.power[j] = p.power[j / 2] * p.power[j - j / 2];
    p.numerator = 0.0;
    p.denominator = 1.0;
    for (std::size_t j = 0; j < taps; ++j) p.numerator += fit.b[j] * p.power[first + j];
    for (std::size_t k = 0; k < order; ++k) p.denominator += fit.a[k] * p.power[stride * (k + 1)];
    return p;
  }

  // Solves the linear problem around `fit`; the answer carries its own cost.
  Fit step(const Fit& fit, bool modelled, double damping) noexcept {
    solver_.reset();
    std::array<double, taps + order> row{}, imaginary{};
    std::array<double, order> norm{};
    for (const ResponseSample& s : samples_) {
      if (!valid(s)) continue;
      const Point p = at(fit, s.omega);
      const Complex g = modelled ? p.numerator / p.denominator : s.value;
      const Complex rhs = p.denominator * s.value;
      const double weight = s.weight / std::norm(p.denominator);
      for (std::size_t j = 0; j < taps; ++j) {
        row[j] = p.power[first + j].real();
        imaginary[j] = p.power[first + j].imag();
      }
      for (std::size_t k = 0; k < order; ++k) {
        const Complex c = -g * p.power[stride * (k + 1)];
        row[taps + k] = c.real();
        imaginary[taps + k] = c.imag();
        norm[k] += weight * std::norm(c);
      }
      solver_.add(row, rhs.real(), weight);
      solver_.add(imaginary, rhs.imag(), weight);
    }
    row = {};
    for (std::size_t i = 0; i < taps + order; ++i) {
      row[i] = 1.0;
      solver_.add(row, 0.0, i < taps ? ridge_ : damping * norm[i - taps]);
      row[i] = 0.0;
    }
    std::array<double, taps + order> x{};
    solver_.solve(x);
    Fit next;
    for (std::size_t j = 0; j < taps; ++j) next.b[j] = x[j];
    for (std::size_t k = 0; k < order; ++k) next.a[k] = fit.a[k] + x[taps + k];
    next.cost = 0.0;
    for (const ResponseSample& s : samples_) {
      if (!valid(s)) continue;
      const Point p = at(next, s.omega);
      next.cost += s.weight * std::norm(s.value - p.numerator / p.denominator);
    }
    ++iterations_;
    return next;
  }

  // True where the denominator no longer moves.
  static bool settled(const Fit& from, const Fit& to, double tolerance) noexcept {
    double change = 0.0;
    double size = 1.0;
    for (std::size_t k = 0; k < order; ++k) {
      change = std::max(change, std::abs(to.a[k] - from.a[k]));
      size = std::max(size, std::abs(to.a[k]));
    }
    return change <= tolerance * size;
  }

  // What the refinement minimises.
  double objective(const Fit& fit) const noexcept {
    double squares = 0.0;
    for (const double b : fit.b) squares += b * b;
    return fit.cost + ridge_ * squares;
  }

  // Variance of the noise on a real number of weight 1. The ridge spends less than one degree of freedom on a tap: the
  // trace of the hat matrix.
  double noise(const Fit& fit) const noexcept {
    double freedom = 2.0 * static_cast<double>(count_) - solver_.rank();
    for (int j = 0; j < Taps && ridge_ > 0.0; ++j) freedom += ridge_ * solver_.covariance(j, j);
    return fit.cost / freedom;
  }

  Fit search() noexcept {
    Fit best;
    Fit now;
    for (int i = 0; i < reweightings; ++i) {
      const Fit next = step(now, false, 0.0);
      const bool done = settled(now, next, 1e-6);
      now = next;
      if (now.cost < best.cost) best = now;
      if (done) break;
    }
    // From here on the ridge is the prior that taps are as large as the response: by Parseval, the mean square of H
    // over their number. Then free taps cost no more bias than the noise costs variance, and sigma holds both.
    if (ridge_ > 0.0) ridge_ = std::max(ridge_ * 1e-8, Taps * noise(now) * weight_ / energy_);
    double damping = 0.0;
    for (int i = 0; i < refinements; ++i) {
      const Fit next = step(best, true, damping);
      // A two-pole fit misfits, so its undamped steps need not shrink; the exact form must settle without damping.
      const bool free = ridge_ > 0.0;
      const bool done = (free ? damping == 0.0 : damping < 1.0) && settled(best, next, 1e-10);
      if (done || objective(next) <= objective(best) * (1.0 + 1e-12)) {  // a flat minimum rounds
        best = next;
        damping = damping > (free ? 1e-4 : 1e-9) ? (free ? 0.1 : 0.3) * damping : 0.0;
      } else {
        damping = std::max(1e-3, 10.0 * damping);
      }
      if (!done) continue;
      best.status = Status::ok;
      break;
    }
    return best;
  }

  static Complex whole_power(Complex x, int n) noexcept {
    Complex y = 1.0;
    while (n-- > 0) y *= x;
    return y;
  }

  // What follows from the coefficients, and from the factor of the last linear problem.
  void conclude(Fit& fit) const noexcept {
    fit.iterations = iterations_;
    fit.sigma.fill(std::numeric_limits<double>::infinity());
    fit.rms = std::sqrt(fit.cost / weight_);
    if (solver_.rank() < Taps + R) fit.status = Status::failed;
    if (fit.status == Status::ok && count_ < samples_.size()) fit.status = Status::missing;
    fit.poles = roots(fit.a);
    for (std::size_t i = 0; i < order; ++i) fit.multipliers[i] = whole_power(fit.poles[i], N / Stride);
    if (fit.status == Status::failed) return;
    const double variance = noise(fit);
    for (std::size_t i = 0; i < order; ++i) {
      const Complex x = fit.poles[i];
      Complex slope = 1.0;  // of the denominator's polynomial at its root
      for (std::size_t k = 0; k < order; ++k) slope *= k == i ? 1.0 : x - fit.poles[k];
      const double gain = std::abs(whole_power(x, N / Stride - 1) / slope) * (N / Stride);
      double spread = 0.0;
      for (int k = 0; k < R; ++k) {
        for (int l = 0; l < R; ++l) {
          const Complex pair = whole_power(x, R - 1 - k) * std::conj(whole_power(x, R - 1 - l));
          spread += pair.real() * solver_.covariance(Taps + k, Taps + l);
        }
      }
      fit.sigma[i] = gain * std::sqrt(variance * spread);
    }
  }

  std::span<const ResponseSample> samples_;
  double ridge_ = 0.0;     // added to the squared norm of a tap's column
  double weight_ = 0.0;    // sum of weights
  double energy_ = 0.0;    // sum of weight |value|^2
  std::size_t count_ = 0;  // samples that hold a value
  int iterations_ = 0;
  LeastSquares<Taps + R> solver_;
};

// Two poles, one zero, by uniform or given weights: the paper's fit. A first approximation: H_0 of a periodic system
// has N poles for every multiplier, so some 1e-3 to 1e-2 of error remains in the multipliers however good the data.
template <int N>
[[nodiscard]] RationalFit<N> fit_rational(std::span<const ResponseSample> samples) noexcept {
  return TransferSearch<RationalFit<N>>::run(samples, false);
}

// The exact form, for R multipliers: its only error is that of the data. Samples in a band leave some taps free; a
// ridge of the noise's own size bounds those, at no cost to the multipliers. An R above the true number gives, with
// noise, a multiplier that means nothing: its sigma is large, or it lies next to the unit circle. Not for the loop: the
// search takes 4 ((R+1) N + R)^2 bytes of stack, and time as the samples times the square of the taps.
template <int N, int R>
[[nodiscard]] ImagePoleFit<N, R> fit_image_poles(std::span<const ResponseSample> samples) noexcept {
  return TransferSearch<ImagePoleFit<N, R>>::run(samples, true);
}

}  // namespace saltus
