// The steady response to a periodic input, by superposition of harmonic transfer functions (Ankarali & Cowan 2014,
// eq. 14): Y(omega) = sum_m H_m(omega - 2 pi m / N) U(omega - 2 pi m / N), on the lines q of a period of L = N P
// samples.
//
// A transfer function is any callable htf(m, q) -> Complex, one output to one input: H_m at the *input* line q, where
// -L/2 < q <= L/2; a real system has htf(-m, -q) = conj(htf(m, q)). The harmonics are m = -M ... M with 2 M <= N; when
// 2 M = N, m = M is the alias of -M and is left out, so M = N/2 is the complete sum of the paper.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "../linalg.hpp"
#include "stimulus.hpp"
#include "twiddles.hpp"

namespace saltus {

namespace detail {

// q modulo L in -L/2 < q <= L/2.
constexpr std::int64_t centred(std::int64_t q, std::int64_t length) noexcept {
  const std::int64_t r = wrap(q, length);
  return 2 * r > length ? r - length : r;
}

constexpr int last_harmonic(int m, int sections) noexcept { return 2 * m == sections ? m - 1 : m; }

}  // namespace detail

// Y at one line for a stimulus, which has few lines: htf is asked only where the stimulus is not zero.
// 0 <= M and 2 M <= N, sections * period the stimulus's samples.
template <int MaxTones, class Htf>
Complex predict_line(std::int64_t q, const Multisine<MaxTones>& stimulus, int sections, int period, int M,
                     const Htf& htf) noexcept {
  const std::int64_t length = std::int64_t{sections} * period;
  Complex y{};
  for (int m = -M; m <= detail::last_harmonic(M, sections); ++m) {
    const std::int64_t from = detail::centred(q - std::int64_t{m} * period, length);
    const Complex u = stimulus.spectrum(from);
    if (u != Complex{}) y += htf(m, from) * u;
  }
  return y;
}

// The steady output of a real system to a stimulus, as a pure function of the sample:
// y(n) = Re sum_k a_k exp(i (2 pi q_k n / L + phi_k)) G_k[n mod N],  G_k[n] = sum_m H_m(q_k) exp(2 pi i m n / N).
template <int MaxTones, int MaxSections>
class SteadyResponse {
 public:
  // False, and nothing changed, unless 1 <= N <= MaxSections, N divides the stimulus's L, 0 <= M and 2 M <= N.
  template <class Htf>
  [[nodiscard]] bool configure(const Multisine<MaxTones>& stimulus, int sections, int M, const Htf& htf) noexcept {
    if (sections < 1 || sections > MaxSections || stimulus.samples() % sections != 0 || M < 0 || 2 * M > sections) {
      return false;
    }
    sections_ = sections;
    stimulus_ = stimulus;
    for (int k = 0; k < stimulus.tones(); ++k) {
      const std::int64_t q = detail::centred(stimulus.tone(k).line, stimulus.samples());
      for (int n = 0; n < sections; ++n) gain(k, n) = 0.0;
      for (int m = -M; m <= detail::last_harmonic(M, sections); ++m) {
        const Complex h = htf(m, q) * stimulus.phasor(k);
        for (int n = 0; n < sections; ++n) gain(k, n) += h * root_of_unity(std::int64_t{m} * n, sections);
      }
    }
    return true;
  }

  // y(n) [output unit], any n.
  double operator()(std::int64_t n) const noexcept {
    const int length = stimulus_.samples();
    const auto section = static_cast<int>(wrap(n, sections_));
    double y = 0.0;
    for (int k = 0; k < stimulus_.tones(); ++k) {
      const Complex w = root_of_unity(wrap(stimulus_.tone(k).line, length) * wrap(n, length), length);
      const Complex& g = gain_[index(k, section)];
      y += g.real() * w.real() - g.imag() * w.imag();
    }
    return y;
  }

 private:
  static constexpr std::size_t index(int k, int n) noexcept {
    return static_cast<std::size_t>(k) * MaxSections + static_cast<std::size_t>(n);
  }
  Complex& gain(int k, int n) noexcept { return gain_[index(k, n)]; }

  int sections_ = 1;
  Multisine<MaxTones> stimulus_{1};
  std::array<Complex, static_cast<std::size_t>(MaxTones) * MaxSections> gain_{};  // [k][n] a_k exp(i phi_k) G_k
};

// The same for any periodic input, given by its samples: input(u), respond(M, htf), output(y). L N + L P operations for
// each of the transforms. 64 MaxSamples bytes: place it statically.
template <int MaxSamples>
class Prediction {
 public:
  // N sections a cycle, P cycles a period. False, and nothing changed, unless N, P >= 1 and N P <= MaxSamples.
  [[nodiscard]] bool configure(int sections, int period) noexcept {
    if (sections < 1 || period < 1 || sections > MaxSamples / period) return false;
    if (!turn_.configure(sections * period)) return false;
    sections_ = sections;
    period_ = period;
    u_ = {};
    y_ = {};
    return true;
  }

  // U(q) = (1 / L) sum_n u(n) exp(-2 pi i q n / L). False, and nothing changed, unless u has L samples.
  [[nodiscard]] bool input(std::span<const double> u) noexcept {
    if (u.size() != at(samples())) return false;
    for (int r = 0; r < period_; ++r) {
      for (int n = 0; n < sections_; ++n) {  // the cycles first: all lines r + l P share their phases
        Complex sum{};
        for (int c = 0, j = 0; c < period_; ++c, j = next(j, r * sections_)) sum += u[at(c * sections_ + n)] * turn(-j);
        part_[at(n)] = sum;
      }
      for (int l = 0; l < sections_; ++l) {
        const int q = r + l * period_;
        Complex sum{};
        for (int n = 0, j = 0; n < sections_; ++n, j = next(j, q)) sum += times(part_[at(n)], turn(-j));
        u_[at(q)] = sum / static_cast<double>(samples());
      }
    }
    return true;
  }

  // Eq. 14 on every line. False, and nothing changed, unless 0 <= M and 2 M <= N.
  template <class Htf>
  [[nodiscard]] bool respond(int M, const Htf& htf) noexcept {
    if (M < 0 || 2 * M > sections_) return false;
    for (int q = 0; q < samples(); ++q) {
      Complex y{};
      for (int m = -M; m <= detail::last_harmonic(M, sections_); ++m) {
        const std::int64_t from = std::int64_t{q} - std::int64_t{m} * period_;
        y += times(htf(m, detail::centred(from, samples())), input_line(from));
      }
      y_[at(q)] = y;
    }
    return true;
  }

  // y(0) ... y(L - 1), the real part of the inverse transform. False, and nothing written, unless y has L samples.
  [[nodiscard]] bool output(std::span<double> y) noexcept {
    if (y.size() != at(samples())) return false;
    for (int n = 0; n < sections_; ++n) {
      for (int r = 0; r < period_; ++r) {
        Complex sum{};
        for (int l = 0, j = r * n; l < sections_; ++l, j = next(j, period_ * n)) {
          sum += times(y_[at(r + l * period_)], turn(j));
        }
        part_[at(r)] = sum;
      }
      for (int c = 0; c < period_; ++c) {
        double sum = 0.0;
        for (int r = 0, j = 0; r < period_; ++r, j = next(j, c * sections_)) {
          const Complex w = turn(j);
          sum += part_[at(r)].real() * w.real() - part_[at(r)].imag() * w.imag();
        }
        y[at(c * sections_ + n)] = sum;
      }
    }
    return true;
  }

  // U and Y at any line, modulo L [input unit, output unit].
  Complex input_line(std::int64_t q) const noexcept { return u_[static_cast<std::size_t>(wrap(q, samples()))]; }
  Complex output_line(std::int64_t q) const noexcept { return y_[static_cast<std::size_t>(wrap(q, samples()))]; }

  int samples() const noexcept { return sections_ * period_; }  // L

 private:
  static constexpr std::size_t at(int i) noexcept { return static_cast<std::size_t>(i); }

  // The product without the standard's care for infinities, which costs a call.
  static Complex times(const Complex& a, const Complex& b) noexcept {
    return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
  }

  int next(int j, int step) const noexcept { return (j + step) % samples(); }
  Complex turn(int j) const noexcept {  // -L < j < L
    return j < 0 ? Complex{turn_.cos(-j), -turn_.sin(-j)} : Complex{turn_.cos(j), turn_.sin(j)};
  }

  int sections_ = 1, period_ = 1;
  Twiddles<MaxSamples> turn_;
  std::array<Complex, MaxSamples> u_{}, y_{}, part_{};
};

}  // namespace saltus
