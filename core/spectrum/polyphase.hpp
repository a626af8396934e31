// Sliding Fourier sums on lines a whole number of pumping frequencies apart, without drift.
//
// All lines q + l P of a tone share the phase q c / P of cycle c, so the cycles are summed first, section by section,
// and the harmonics taken from those sums (polyphase by residue class):
//   Z_q[n]     = exp(-2 pi i q n / L) sum_c y[cN + n] exp(-2 pi i q c / P)     over the P cycles of the window
//   L Y(q + lP) = sum_n Z_q[n] exp(-2 pi i l n / N)
// Z is the sum of a rising part, restarted from zero every P cycles, and a falling one: the rising part of the block
// before, from which the samples that leave are subtracted, thrown away with its rounding when the block ends.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>
#include <utility>

#include "../linalg.hpp"
#include "twiddles.hpp"

namespace saltus {

// Sums in T of Channels signals on up to MaxTones lines and their harmonics -MaxHarmonics ... MaxHarmonics. A plain
// store and its kernels: whoever drives it keeps the samples and says where in the period each belongs.
template <int MaxTones, int MaxHarmonics, int Channels, int MaxSections, int MaxPeriod, class T>
class Polyphase {
  static_assert(MaxTones >= 1 && MaxHarmonics >= 0 && Channels >= 1 && MaxSections >= 1 && MaxPeriod >= 1);
  static_assert(std::is_same_v<T, double> || std::is_same_v<T, float>);

  static constexpr std::size_t at(int i) noexcept { return static_cast<std::size_t>(i); }

 public:
  // Eight tones lie side by side whatever the processor; it works on as many at once as its vectors hold. Sums never
  // cross lanes, so neither changes a bit of the result.
  static constexpr std::size_t lanes = 8;
  static constexpr std::size_t packs = (at(MaxTones) + lanes - 1) / lanes;
  static constexpr std::size_t channels = at(Channels);
  static constexpr std::size_t orders = 2 * at(MaxHarmonics) + 1;

  struct alignas(lanes * sizeof(T)) Pack {
    std::array<T, lanes> re{}, im{};
  };
  using Lines = std::array<Pack, packs * channels * orders>;  // [pack of tones][channel][l]
  using Signals = std::array<T, channels>;

  // Index into Lines of tone k's pack; the lane is k % lanes.
  static constexpr std::size_t bin(int k, int l, int channel) noexcept {
    return (at(k) / lanes * channels + at(channel)) * orders + at(l + MaxHarmonics);
  }

  // Bins in use, the first ones of Lines.
  std::size_t bins() const noexcept { return used_ * channels * orders; }

  // Every argument within the capacities. Empties the sums.
  void configure(int sections, int period, std::span<const int> lines, int harmonics) noexcept {
    used_ = (lines.size() + lanes - 1) / lanes;
    sections_ = sections;
    harmonics_ = harmonics;
    for (int c = 0; c < period; ++c) std::fill_n(&cycle_turn_[at(c) * packs], used_, Pack{});
    for (int n = 0; n < sections; ++n) std::fill_n(&section_turn_[at(n) * packs], used_, Pack{});
    const auto set = [](Pack& p, std::size_t lane, const Complex& z) {
      p.re[lane] = static_cast<T>(z.real());
      p.im[lane] = static_cast<T>(z.imag());
    };
    const int length = sections * period;
    for (std::size_t k = 0; k < lines.size(); ++k) {
      const std::int64_t q = lines[k];
      for (int c = 0; c < period; ++c) {
        set(cycle_turn_[at(c) * packs + k / lanes], k % lanes, root_of_unity(-wrap(q, period) * c, period));
      }
      for (int n = 0; n < sections; ++n) {
        set(section_turn_[at(n) * packs + k / lanes], k % lanes, root_of_unity(-wrap(q, length) * n, length));
      }
    }
    for (int n = 0; n < sections; ++n) {
      for (int l = 0; l <= harmonics; ++l) {
        const Complex w = root_of_unity(std::int64_t{n} * l, sections);
        harmonic_turn_[at(n)][at(l)] = {static_cast<T>(w.real()), static_cast<T>(w.imag())};
      }
    }
    clear();
  }

  void clear() noexcept {
    for (std::size_t n = 0; n < at(sections_); ++n) {
      std::fill_n(&rising_[n * packs * channels], used_ * channels, Pack{});
      std::fill_n(&falling_[n * packs * channels], used_ * channels, Pack{});
    }
  }

  // First stage: a sample enters the sums of its section and the one of P cycles before leaves. `cycle` modulo P;
  // the block ends with cycle P - 1.
  void slide(int cycle, int section, const Signals& entering, const Signals& leaving) noexcept {
    const std::size_t sums = at(section) * packs * channels, used = used_;
    if (cycle == 0) {
      for (std::size_t s = sums; s < sums + used * channels; ++s) falling_[s] = std::exchange(rising_[s], {});
    }
    bool leaves = false;  // nothing does in the first P cycles
    for (const T y : leaving) leaves = leaves || y != T(0);
    Wide in[channels], out[channels];
    for (std::size_t c = 0; c < channels; ++c) {
      in[c] = broadcast(entering[c]);
      out[c] = broadcast(-leaving[c]);
    }
    for (std::size_t b = 0; b < used; ++b) {
      const Pack& wc = cycle_turn_[at(cycle) * packs + b];
      const Pack& wn = section_turn_[at(section) * packs + b];
      Pack* const rising = &rising_[sums + b * channels];
      Pack* const falling = &falling_[sums + b * channels];
      for (std::size_t j = 0; j < lanes; j += width) {
        const Wide cc = load(&wc.re[j]), cs = load(&wc.im[j]), nc = load(&wn.re[j]), ns = load(&wn.im[j]);
        const Wide re = cc * nc - cs * ns, im = cc * ns + cs * nc;  // exp(-2 pi i q (cN + n) / L)
        for (std::size_t c = 0; c < channels; ++c) {
          add<false>(&rising[c].re[j], in[c] * re);
          add<false>(&rising[c].im[j], in[c] * im);
          if (!leaves) continue;
          add<false>(&falling[c].re[j], out[c] * re);
          add<false>(&falling[c].im[j], out[c] * im);
        }
      }
    }
  }

  // Second stage: adds a section of the window to L Y; section 0 starts the lines anew.
  void transform(int section, Lines& lines) const noexcept {
    section == 0 ? harmonics<true>(section, lines) : harmonics<false>(section, lines);
  }

 private:
#if defined(__AVX512F__)
  static constexpr std::size_t vector_bytes = 64;
#elif defined(__AVX__)
  static constexpr std::size_t vector_bytes = 32;
#elif defined(__SSE2__) || defined(__aarch64__)
  static constexpr std::size_t vector_bytes = 16;
#else
  static constexpr std::size_t vector_bytes = sizeof(T);
#endif
  static constexpr std::size_t width = std::min(lanes, vector_bytes / sizeof(T));
  typedef T Wide __attribute__((vector_size(width * sizeof(T))));

  struct Turn {
    T cos, sin;
  };

  static Wide load(const T* lane) noexcept {
    Wide v;
    std::memcpy(&v, lane, sizeof v);
    return v;
  }
  static Wide broadcast(T x) noexcept { return x - Wide{}; }
  template <bool First>
  static void add(T* lane, const Wide& v) noexcept {
    const Wide sum = First ? v : load(lane) + v;
    std::memcpy(lane, &sum, sizeof sum);
  }

  template <bool First>
  void harmonics(int section, Lines& lines) const noexcept {
    const std::size_t sums = at(section) * packs * channels, used = used_ * channels;
    const int highest = harmonics_;
    Wide cos[MaxHarmonics + 1], sin[MaxHarmonics + 1];
    for (int l = 1; l <= highest; ++l) {
      cos[l] = broadcast(harmonic_turn_[at(section)][at(l)].cos);
      sin[l] = broadcast(harmonic_turn_[at(section)][at(l)].sin);
    }
    for (std::size_t s = 0; s < used; ++s) {
      const Pack& rising = rising_[sums + s];
      const Pack& falling = falling_[sums + s];
      Pack* const line = lines.data() + s * orders + at(MaxHarmonics);  // l = 0
      for (std::size_t j = 0; j < lanes; j += width) {
        const Wide re = load(&rising.re[j]) + load(&falling.re[j]);
        const Wide im = load(&rising.im[j]) + load(&falling.im[j]);
        add<First>(&line->re[j], re);
        add<First>(&line->im[j], im);
        for (int l = 1; l <= highest; ++l) {  // l and -l share their products
          const Wide re_cos = re * cos[l], im_sin = im * sin[l], im_cos = im * cos[l], re_sin = re * sin[l];
          add<First>(&line[l].re[j], re_cos + im_sin);
          add<First>(&line[l].im[j], im_cos - re_sin);
          add<First>(&line[-l].re[j], re_cos - im_sin);
          add<First>(&line[-l].im[j], im_cos + re_sin);
        }
      }
    }
  }

  std::size_t used_ = 0;  // packs in use
  int sections_ = 0, harmonics_ = 0;
  std::array<Pack, at(MaxPeriod) * packs> cycle_turn_{};                         // [c][pack] exp(-2 pi i q c / P)
  std::array<Pack, at(MaxSections) * packs> section_turn_{};                     // [n][pack] exp(-2 pi i q n / L)
  std::array<std::array<Turn, MaxHarmonics + 1>, MaxSections> harmonic_turn_{};  // [n][l] 2 pi l n / N
  std::array<Pack, at(MaxSections) * packs * channels> rising_{}, falling_{};    // [n][pack][channel]
};

}  // namespace saltus
