// Streaming estimate of the output at omega_k + 2 pi l / N and of the harmonic transfer functions, cycle by cycle
// (Ankarali & Cowan 2014, section V).
//
// The window is the last P cycles, sliding by whole cycles. The absolute index of a sample decides its phase, so a
// record may start anywhere, and nothing drifts however long it runs (polyphase.hpp).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "../linalg.hpp"
#include "../status.hpp"
#include "polyphase.hpp"
#include "stimulus.hpp"
#include "twiddles.hpp"

namespace saltus {

// Up to MaxTones lines, harmonics -MaxHarmonics ... MaxHarmonics, Channels measured signals, MaxSections samples a
// cycle and MaxPeriod cycles a stimulus period; the numbers in use are chosen at run time. T is the type of the sums.
//
// One large object without a heap, to be placed statically: 177 KB for <31, 3, 2, 32, 64>; in general about
// MaxSections (16 MaxTones (2 Channels + 1) + 8 MaxPeriod Channels) + 16 MaxTones (MaxPeriod + 9 MaxHarmonics Channels)
// bytes. Every push costs the same, but for the last of a stimulus period, which also updates the means (about one push
// more), one after a gap (a push for every sample skipped, a cycle at most, or the clearing of the window), and those
// before the first whole window, which cost less.
template <int MaxTones, int MaxHarmonics, int Channels, int MaxSections, int MaxPeriod, class T = double>
class HtfEstimator {
  using Sums = Polyphase<MaxTones, MaxHarmonics, Channels, MaxSections, MaxPeriod, T>;

 public:
  using Sample = std::array<double, Channels>;

  // N sections a cycle, the stimulus repeats after P cycles, `lines` the tones to follow (any integers, whether excited
  // or not), l = -harmonics ... harmonics. Forgets every sample, mean and baseline. Status::failed, and nothing
  // changed, when a number is outside the capacities.
  [[nodiscard]] Status configure(int sections, int period, std::span<const int> lines, int harmonics) noexcept {
    if (sections < 1 || sections > MaxSections || period < 1 || period > MaxPeriod || lines.empty() ||
        lines.size() > at(MaxTones) || harmonics < 0 || harmonics > MaxHarmonics) {
      return Status::failed;
    }
    sections_ = sections;
    period_ = period;
    tones_ = static_cast<int>(lines.size());
    harmonics_ = harmonics;
    for (std::size_t k = 0; k < lines.size(); ++k) line_[k] = lines[k];
    sums_.configure(sections, period, lines, harmonics);
    baseline_ = {};
    restart();
    return Status::ok;
  }

  // What the machine does without a stimulus, one Sample a section, subtracted from every sample so that a slot never
  // measured counts as "no response". Restarts. Status::failed, and nothing changed, unless there is one a section.
  [[nodiscard]] Status set_baseline(std::span<const Sample> cycle) noexcept {
    if (sections_ == 0 || cycle.size() != at(sections_)) return Status::failed;
    for (std::size_t n = 0; n < cycle.size(); ++n) baseline_[n] = cycle[n];
    restart();
    return Status::ok;
  }

  // Forgets every sample, mean and count; keeps the configuration and the baseline.
  void restart() noexcept {
    empty_window();
    next_ = 0;
    missing_ = late_ = jumps_ = periods_ = 0;
    std::fill_n(mean_.begin(), sums_.bins(), std::array<Complex, lanes>{});
    std::fill_n(spread_.begin(), sums_.bins(), std::array<double, lanes>{});
  }

  // The measurement of the absolute sample index `sample` = cycle * N + section (any start, negative too).
  //   ok       it entered the sums
  //   missing  a channel is not finite: treated as push_missing(); or up to a cycle of samples was skipped: they count
  //   as
  //            missing and this one entered; or the index was passed up to a cycle ago: ignored, counted late
  //   failed   the index jumped by more than a cycle: the window starts anew at this sample, the means stay;
  //            or not configured, or an index beyond 2^62: ignored
  Status push(std::int64_t sample, const Sample& y) noexcept {
    constexpr std::int64_t far = std::int64_t{1} << 62;
    completed_ = false;
    if (sections_ == 0 || sample > far || sample < -far) return Status::failed;
    if (!started_) start_at(sample);
    Status status = Status::ok;
    const std::int64_t skipped = sample - next_;
    if (skipped < -sections_ || skipped > sections_) {
      ++jumps_;
      empty_window();
      start_at(sample);
      status = Status::failed;
    } else if (skipped < 0) {
      ++late_;
      return Status::missing;
    } else if (skipped > 0) {
      missing_ += skipped;
      while (next_ < sample) advance(nullptr);
      status = Status::missing;
    }
    return worse(status, take(y));
  }

  // The sample after the last one did not arrive. Its slot keeps what it held one stimulus period ago; a slot that
  // never held anything is a hole and counts as zero. Counted; Status::missing. Without effect before the first sample.
  Status push_missing() noexcept {
    completed_ = false;
    if (sections_ == 0) return Status::failed;
    ++missing_;
    if (started_) advance(nullptr);
    return Status::missing;
  }

  // True after the push that completed a cycle: the figures below are about the window that ended there, to the next
  // one.
  bool cycle_completed() const noexcept { return completed_; }
  // True once that window is a whole stimulus period of whole cycles; until then every line is zero.
  bool valid() const noexcept { return windows() > 0; }
  std::int64_t windows() const noexcept { return cycles_ < period_ ? 0 : cycles_ - period_ + 1; }  // valid ones so far
  int holes() const noexcept { return holes_; }         // slots of the window never measured
  int stale() const noexcept { return stale_; }         // slots of the window kept from an earlier period
  std::int64_t next() const noexcept { return next_; }  // index the next sample should have

  // Since the restart [sample]:
  std::int64_t missing() const noexcept { return missing_; }  // absent or not finite
  std::int64_t late() const noexcept { return late_; }        // refused: the index had been passed
  std::int64_t jumps() const noexcept { return jumps_; }      // jumps of the index that emptied the window

  int sections() const noexcept { return sections_; }           // N; 0 until configured
  int period() const noexcept { return period_; }               // P
  int samples() const noexcept { return sections_ * period_; }  // L
  int tones() const noexcept { return tones_; }
  int harmonics() const noexcept { return harmonics_; }
  int tone_line(int k) const noexcept { return line_[at(k)]; }  // q_k

  // Below: 0 <= k < tones(), abs(l) <= harmonics(), 0 <= channel < Channels.

  // Y at the line q_k + l P over the latest window [channel's unit]; a cosine a cos(omega n + phi) gives (a/2) exp(i
  // phi).
  Complex line(int k, int l, int channel) const noexcept {
    const auto& p = lines_[shown_][Sums::bin(k, l, channel)];
    const double length = samples();
    return {static_cast<double>(p.re[at(k) % lanes]) / length, static_cast<double>(p.im[at(k) % lanes]) / length};
  }

  // H_l(omega_k) = Y(omega_k + 2 pi l / N) / U(omega_k) [channel's unit / input unit], U known. Not finite where the
  // stimulus has no such tone.
  template <int StimulusTones, class S>
  Complex htf(int k, int l, int channel, const Multisine<StimulusTones, S>& stimulus) const noexcept {
    return quotient(line(k, l, channel), stimulus.spectrum(tone_line(k)));
  }

  // The same with U measured as another channel.
  Complex htf(int k, int l, int channel, int input_channel) const noexcept {
    return quotient(line(k, l, channel), line(k, 0, input_channel));
  }

  // Over the disjoint windows (every P-th valid one) that had no hole: their number, the mean of Y, and the unbiased
  // variance of one Y, E|Y - mean|^2, real and imaginary part together (0 while there are fewer than two).
  std::int64_t periods() const noexcept { return periods_; }
  Complex mean(int k, int l, int channel) const noexcept {
    return mean_[Sums::bin(k, l, channel)][at(k) % lanes] / static_cast<double>(samples());
  }
  double variance(int k, int l, int channel) const noexcept {
    if (periods_ < 2) return 0.0;
    const double length = samples();
    return spread_[Sums::bin(k, l, channel)][at(k) % lanes] / (static_cast<double>(periods_ - 1) * length * length);
  }

 private:
  static constexpr std::size_t at(int i) noexcept { return static_cast<std::size_t>(i); }
  static constexpr std::size_t lanes = Sums::lanes, slots = at(MaxSections) * at(MaxPeriod);

  using Signals = typename Sums::Signals;
  enum class Slot : std::uint8_t { hole, stale, fresh };

  void empty_window() noexcept {
    started_ = completed_ = false;
    cycles_ = 0;
    held_holes_ = holes_ = samples();
    held_stale_ = stale_ = 0;
    std::fill_n(slot_.begin(), at(samples()), Slot::hole);
    std::fill_n(ring_.begin(), at(samples()), Signals{});
    sums_.clear();
    for (auto& lines : lines_) std::fill_n(lines.begin(), sums_.bins(), typename Sums::Pack{});
  }

  void start_at(std::int64_t sample) noexcept {
    started_ = true;
    next_ = sample;
    const auto in_period = static_cast<int>(wrap(sample, samples()));
    cycle_ = in_period / sections_;
    section_ = in_period % sections_;
    whole_ = section_ == 0;
  }

  Status take(const Sample& y) noexcept {
    Signals response{};
    bool finite = true;
    for (std::size_t c = 0; c < response.size(); ++c) {
      response[c] = static_cast<T>(y[c] - baseline_[at(section_)][c]);
      finite = finite && std::isfinite(response[c]);
    }
    missing_ += finite ? 0 : 1;
    advance(finite ? &response : nullptr);
    return finite ? Status::ok : Status::missing;
  }

  // One sample into its slot (null: the slot keeps what it has) and the sums, and on to the next section.
  void advance(const Signals* response) noexcept {
    const std::size_t slot = at(cycle_ * sections_ + section_);
    const Signals leaving = ring_[slot];
    if (response != nullptr) ring_[slot] = *response;
    mark(slot_[slot], response != nullptr);
    sums_.slide(cycle_, section_, ring_[slot], leaving);
    if (cycles_ + 1 >= period_) sums_.transform(section_, lines_[1 - shown_]);
    ++next_;
    if (++section_ == sections_) finish_cycle();
  }

  void mark(Slot& slot, bool measured) noexcept {
    const Slot now = measured ? Slot::fresh : slot == Slot::hole ? Slot::hole : Slot::stale;
    held_holes_ += (now == Slot::hole) - (slot == Slot::hole);
    held_stale_ += (now == Slot::stale) - (slot == Slot::stale);
    slot = now;
  }

  void finish_cycle() noexcept {
    section_ = 0;
    cycle_ = cycle_ + 1 == period_ ? 0 : cycle_ + 1;
    cycles_ += whole_ ? 1 : 0;  // a cycle entered in its middle does not count
    whole_ = completed_ = true;
    shown_ = 1 - shown_;
    holes_ = held_holes_;
    stale_ = held_stale_;
    if (valid() && windows() % period_ == 1 % period_ && holes_ == 0) update_means();
  }

  void update_means() noexcept {  // Welford
    const double share = 1.0 / static_cast<double>(++periods_);
    for (std::size_t i = 0; i < sums_.bins(); ++i) {
      for (std::size_t j = 0; j < lanes; ++j) {
        const auto& p = lines_[shown_][i];
        const Complex y{static_cast<double>(p.re[j]), static_cast<double>(p.im[j])}, before = y - mean_[i][j];
        mean_[i][j] += before * share;
        const Complex after = y - mean_[i][j];
        spread_[i][j] += before.real() * after.real() + before.imag() * after.imag();
      }
    }
  }

  int sections_ = 0, period_ = 1, tones_ = 0, harmonics_ = 0;
  std::array<int, MaxTones> line_{};
  std::array<Sample, MaxSections> baseline_{};

  bool started_ = false, completed_ = false;
  bool whole_ = false;                 // the running cycle was entered at its section 0
  int cycle_ = 0, section_ = 0;        // of the next sample; the cycle modulo P
  std::int64_t next_ = 0;              // absolute index of the next sample
  std::int64_t cycles_ = 0;            // whole ones since the window was empty
  std::array<Signals, slots> ring_{};  // the last L samples
  std::array<Slot, slots> slot_{};
  int held_holes_ = 0, held_stale_ = 0;  // of the ring
  int holes_ = 0, stale_ = 0;            // of the window shown
  std::int64_t missing_ = 0, late_ = 0, jumps_ = 0, periods_ = 0;

  Sums sums_;
  std::array<typename Sums::Lines, 2> lines_{};  // L Y of the window shown, and of the cycle under way
  std::size_t shown_ = 0;
  std::array<std::array<Complex, lanes>, std::tuple_size_v<typename Sums::Lines>> mean_{};   // L mean Y
  std::array<std::array<double, lanes>, std::tuple_size_v<typename Sums::Lines>> spread_{};  // L^2 sum |Y - mean|^2
};

}  // namespace saltus
