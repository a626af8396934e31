// Phases that keep a multisine flat: the same energy with a lower peak, so that more of it fits below the amplitude at
// which a machine stops being linear. The lines and amplitudes, hence every rule of lines.hpp, stay as they are.
//
// The peak is approached through the norms L_2p, p = 4, 8, 16, ..., each minimised by damped Gauss-Newton steps on the
// phases (Guillaume, Schoukens, Pintelon & Kollar 1991). The signal is looked at between its samples too: the peak that
// counts is that of the band-limited signal, whatever the converter behind it holds.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>

#include "../random.hpp"
#include "../trigonometry.hpp"
#include "stimulus.hpp"
#include "twiddles.hpp"

namespace saltus {

// Stimuli of up to MaxTones tones, looked at in up to MaxPoints points of a period. One object without a heap, 24
// MaxPoints + 9 MaxTones^2 bytes: place it statically. Not for the loop: some 2 MaxTones MaxPoints operations a step.
template <int MaxTones, int MaxPoints>
class CrestReduction {
  static_assert(MaxTones >= 1 && MaxPoints >= 16);

 public:
  // A stimulus of `samples` samples a period, looked at in `oversampling` points a sample. False, and nothing changed,
  // when they do not fit.
  [[nodiscard]] bool configure(int samples, int oversampling) noexcept {
    if (samples < 1 || oversampling < 1 || samples > MaxPoints / oversampling) return false;
    if (!turn_.configure(samples * oversampling)) return false;
    samples_ = samples;
    points_ = samples * oversampling;
    return true;
  }

  int points() const noexcept { return points_; }

  // Peak over root mean square over the points [-]; 0 for a stimulus that is zero or of another length.
  template <int Capacity>
  double crest(const Multisine<Capacity>& u) noexcept {
    if (!take(u)) return 0.0;
    return peak() / rms_;
  }

  // Lowers the crest factor by new phases: `starts` searches from random ones (the first from those at hand), of which
  // the best is kept. Never raises it. Equal seeds give equal bits. Returns the crest factor reached, 0 as above.
  template <int Capacity>
  double reduce(Multisine<Capacity>& u, Random& random, int starts = 1) noexcept {
    if (!take(u)) return 0.0;
    Phases best = phase_;
    double least = peak();
    for (int s = 0; s < starts; ++s) {
      if (s > 0) {
        for (int k = 0; k < tones_; ++k) phase_[at(k)] = 2.0 * std::numbers::pi * random.uniform();
        draw();
      }
      for (int p = 4; p <= 256; p *= 2) descend(p, least, best);
    }
    Multisine<Capacity> flat(samples_);
    for (int k = 0; k < tones_; ++k) {
      constexpr double whole = 2.0 * std::numbers::pi;
      const double phase = best[at(k)] - whole * std::floor(best[at(k)] / whole);
      if (!flat.add({u.tone(k).line, u.tone(k).amplitude, phase})) return 0.0;
    }
    u = flat;
    return crest(u);
  }

 private:
  static constexpr std::size_t at(int i) noexcept { return static_cast<std::size_t>(i); }
  static constexpr std::size_t cell(std::size_t i, std::size_t j) noexcept { return i * at(MaxTones) + j; }
  using Phases = std::array<double, MaxTones>;

  template <int Capacity>
  bool take(const Multisine<Capacity>& u) noexcept {
    if (u.samples() != samples_ || u.tones() > MaxTones || points_ == 0) return false;
    tones_ = u.tones();
    double square = 0.0;
    for (int k = 0; k < tones_; ++k) {
      line_[at(k)] = static_cast<int>(wrap(u.tone(k).line, points_));
      amplitude_[at(k)] = u.tone(k).amplitude;
      phase_[at(k)] = u.tone(k).phase;
    }
    draw();
    for (int n = 0; n < points_; ++n) square += u_[at(n)] * u_[at(n)];
    rms_ = std::sqrt(square / points_);
    return rms_ > 0.0;
  }

  void draw() noexcept {
    std::fill_n(u_.begin(), points_, 0.0);
    for (int k = 0; k < tones_; ++k) {
      const auto at_start = on_circle(phase_[at(k)]);
      const double c = amplitude_[at(k)] * at_start.cos;
      const double s = amplitude_[at(k)] * at_start.sin;
      const int step = line_[at(k)];
      int j = 0;
      for (int n = 0; n < points_; ++n) {
        u_[at(n)] += c * turn_.cos(j) - s * turn_.sin(j);
        j += step - (j >= points_ - step ? points_ : 0);
      }
    }
  }

  double peak() const noexcept {
    double peak = 0.0;
    for (int n = 0; n < points_; ++n) peak = std::fmax(peak, std::fabs(u_[at(n)]));
    return peak;
  }

  static double power(double x, int p) noexcept {  // p a power of two
    for (; p > 1; p /= 2) x *= x;
    return x;
  }

  // Sum of (u / scale)^2p: what a stage minimises.
  double cost(double scale, int p) const noexcept {
    double sum = 0.0;
    for (int n = 0; n < points_; ++n) sum += power(u_[at(n)] * u_[at(n)] / (scale * scale), p);
    return sum;
  }

  // Gauss-Newton with Levenberg-Marquardt damping on sum u^2p, and the lowest peak met on the way.
  void descend(int p, double& least, Phases& best) noexcept {
    double damping = 1e-3;
    for (int i = 0; i < 8; ++i) {
      const double scale = peak();
      if (scale < least) {
        least = scale;
        best = phase_;
      }
      const double before = cost(scale, p);
      normal_equations(scale, p);
      const Phases from = phase_;
      bool lower = false;
      for (int attempt = 0; attempt < 5 && !lower; ++attempt) {
        Phases step = gradient_;
        if (!solve(damping, step)) return;
        for (int k = 0; k < tones_; ++k) phase_[at(k)] = from[at(k)] - step[at(k)] / p;
        draw();
        lower = cost(scale, p) < before;
        damping = lower ? 0.2 * damping : 10.0 * damping;
      }
      if (!lower) {
        phase_ = from;
        draw();
        return;
      }
      if (before - cost(scale, p) < 1e-3 * before) break;
    }
    if (const double reached = peak(); reached < least) {
      least = reached;
      best = phase_;
    }
  }

  // J^T W J and J^T W u with J = du/dphase and W = (u / scale)^(2p - 2), over the points whose weight is not
  // negligible.
  void normal_equations(double scale, int p) noexcept {
    const auto count = at(tones_);
    normal_.fill(0.0);
    gradient_.fill(0.0);
    Phases row, c, s;
    for (int k = 0; k < tones_; ++k) {
      const auto at_start = on_circle(phase_[at(k)]);
      c[at(k)] = amplitude_[at(k)] * at_start.cos;
      s[at(k)] = amplitude_[at(k)] * at_start.sin;
    }
    for (int n = 0; n < points_; ++n) {
      const double x = u_[at(n)] / scale;
      const double weight = power(x * x, p) / (x * x);
      if (!(weight > 1e-4)) continue;
      for (int k = 0; k < tones_; ++k) {
        const int j = turn_.index(line_[at(k)], n);
        row[at(k)] = -(c[at(k)] * turn_.sin(j) + s[at(k)] * turn_.cos(j));
      }
      for (std::size_t k = 0; k < count; ++k) {
        const double w = weight * row[k];
        gradient_[k] += w * u_[at(n)];
        for (std::size_t l = 0; l <= k; ++l) normal_[cell(k, l)] += w * row[l];
      }
    }
  }

  // (J^T W J + damping diag) x = rhs by Cholesky's factorisation; false when it breaks down.
  bool solve(double damping, Phases& x) noexcept {
    const auto count = at(tones_);
    double trace = 0.0;
    for (std::size_t k = 0; k < count; ++k) trace += normal_[cell(k, k)];
    for (std::size_t k = 0; k < count; ++k) {
      for (std::size_t l = 0; l <= k; ++l) {
        double sum = normal_[cell(k, l)];
        if (k == l) sum += damping * (sum + trace / static_cast<double>(count));
        for (std::size_t i = 0; i < l; ++i) sum -= factor_[cell(k, i)] * factor_[cell(l, i)];
        if (k == l) {
          if (!(sum > 0.0)) return false;
          factor_[cell(k, k)] = std::sqrt(sum);
        } else {
          factor_[cell(k, l)] = sum / factor_[cell(l, l)];
        }
      }
    }
    for (std::size_t k = 0; k < count; ++k) {
      for (std::size_t i = 0; i < k; ++i) x[k] -= factor_[cell(k, i)] * x[i];
      x[k] /= factor_[cell(k, k)];
    }
    for (std::size_t k = count; k-- > 0;) {
      for (std::size_t i = k + 1; i < count; ++i) x[k] -= factor_[cell(i, k)] * x[i];
      x[k] /= factor_[cell(k, k)];
    }
    return true;
  }

  int samples_ = 0, points_ = 0, tones_ = 0;
  double rms_ = 0.0;
  Twiddles<MaxPoints> turn_;
  std::array<double, MaxPoints> u_{};
  std::array<int, MaxTones> line_{};
  Phases amplitude_{}, phase_{}, gradient_{};
  std::array<double, at(MaxTones) * at(MaxTones)> normal_{}, factor_{};
};

}  // namespace saltus
