// Sums of cosines on integer lines (Ankarali & Cowan 2014, eq. 15).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <span>

#include "../linalg.hpp"
#include "../random.hpp"
#include "../trigonometry.hpp"
#include "twiddles.hpp"

namespace saltus {

// One cosine of a stimulus. The amplitude is that of the cosine itself; the paper writes it a_k / pi.
struct Tone {
  int line = 0;            // [-]          q: q / P cycles per cycle, 2 pi q / L rad per sample
  double amplitude = 0.0;  // [input unit]
  double phase = 0.0;      // [rad]        at sample 0
};

// u(n) = sum_k a_k cos(2 pi q_k n / L + phi_k): a pure function of the integer sample n, negative too, exactly periodic
// in L whatever n is. A single cosine is a multisine of one tone.
//
// T is the type of the samples. In single precision one is off by 2e-7 of the sum of the amplitudes at most, and a line
// by 2e-7 of its own; nothing grows with n, for phases are integers. spectrum() is that of the tones as given.
template <int MaxTones, class T = double>
class Multisine {
  static_assert(MaxTones >= 1);

 public:
  // The stimulus repeats after L = `samples` >= 1 samples (sections per cycle times cycles per stimulus period).
  constexpr explicit Multisine(int samples) noexcept : samples_(samples < 1 ? 1 : samples) {}

  // False, and nothing added, when MaxTones tones are in or a number is not finite.
  [[nodiscard]] bool add(const Tone& t) noexcept {
    if (tones_ == MaxTones || !std::isfinite(t.amplitude) || !std::isfinite(t.phase)) return false;
    tone_[static_cast<std::size_t>(tones_)] = t;
    prepare(tones_++);
    return true;
  }

  // New phases for every tone, uniform in [0, 2 pi).
  void randomise_phases(Random& random) noexcept {
    for (int k = 0; k < tones_; ++k) {
      tone_[static_cast<std::size_t>(k)].phase = 2.0 * std::numbers::pi * random.uniform();
      prepare(k);
    }
  }

  int tones() const noexcept { return tones_; }
  int samples() const noexcept { return samples_; }  // L
  const Tone& tone(int k) const noexcept { return tone_[static_cast<std::size_t>(k)]; }

  // u(n) [input unit]. A sine and a cosine for each tone; a loop plays the table that fill() writes, which has the same
  // bits.
  T operator()(std::int64_t n) const noexcept {
    const std::int64_t at = wrap(n, samples_);
    T u = 0;
    for (int k = 0; k < tones_; ++k) {
      const Wave& a = wave_[static_cast<std::size_t>(k)];
      const std::complex<T> w = root_of_unity<T>(a.step * at, samples_);
      u += a.cos * w.real() - a.sin * w.imag();
    }
    return u;
  }

  // u(0) ... u(L - 1). False, and nothing written, unless both `out` and `twiddles` are L long.
  template <int Capacity>
  [[nodiscard]] bool fill(const Twiddles<Capacity, T>& twiddles, std::span<T> out) const noexcept {
    if (out.size() != static_cast<std::size_t>(samples_) || twiddles.length() != samples_) return false;
    for (T& u : out) u = 0;
    for (int k = 0; k < tones_; ++k) {
      const Wave& a = wave_[static_cast<std::size_t>(k)];
      const int step = static_cast<int>(a.step);
      int j = 0;
      for (T& u : out) {
        u += a.cos * twiddles.cos(j) - a.sin * twiddles.sin(j);
        j += step - (j >= samples_ - step ? samples_ : 0);
      }
    }
    return true;
  }

  // The stimulus at a line, (1 / L) sum_n u(n) exp(-2 pi i q n / L) [input unit]: (a / 2) exp(i phi) for a tone on q,
  // its conjugate for one on -q, everything modulo L; zero elsewhere.
  Complex spectrum(std::int64_t q) const noexcept {
    Complex sum{};
    for (int k = 0; k < tones_; ++k) {
      const Complex half = 0.5 * phasor(k);
      if (wrap(q - tone(k).line, samples_) == 0) sum += half;
      if (wrap(q + tone(k).line, samples_) == 0) sum += std::conj(half);
    }
    return sum;
  }

  // a_k exp(i phi_k) [input unit].
  Complex phasor(int k) const noexcept {
    const Tone& t = tone(k);
    const auto p = on_circle(t.phase);
    return {t.amplitude * p.cos, t.amplitude * p.sin};
  }

 private:
  // A tone as it is played.
  struct Wave {
    T cos, sin;         // a exp(i phi) [input unit]
    std::int64_t step;  // q modulo L
  };
  void prepare(int k) noexcept {
    const Complex a = phasor(k);
    wave_[static_cast<std::size_t>(k)] = {static_cast<T>(a.real()), static_cast<T>(a.imag()),
                                          wrap(tone(k).line, samples_)};
  }

  std::array<Tone, MaxTones> tone_{};
  std::array<Wave, MaxTones> wave_{};
  int tones_ = 0;
  int samples_ = 1;
};

// Peak over root mean square [-] of one period of samples; 0 for a signal that is zero.
inline double crest_factor(std::span<const double> u) noexcept {
  double peak = 0.0, square = 0.0;
  for (const double x : u) {
    peak = std::fmax(peak, std::fabs(x));
    square += x * x;
  }
  return square > 0.0 ? peak / std::sqrt(square / static_cast<double>(u.size())) : 0.0;
}

}  // namespace saltus
