// From a measured experiment to harmonic transfer functions: an experiment with an emulated machine over a link, sample
// by sample; and what the estimator's lines say once it is over, with standard errors.
#pragma once

#include <cmath>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "core/spectrum/estimator.hpp"
#include "hal/loopback.hpp"
#include "plan.hpp"
#include "rig.hpp"

namespace saltus {

inline constexpr int max_harmonics = 8;
template <int Channels>
using LineEstimator = HtfEstimator<max_tones, max_harmonics, Channels, 256, 512>;

// H_m at one line: the input at f = line / period cycles a cycle, the output at f + m.
struct HtfEstimate {
  int m = 0;
  int line = 0;
  int output = 0;                                           // position in the outputs
  Complex value;                                            // [output unit / input unit]
  double sigma = std::numeric_limits<double>::quiet_NaN();  // sqrt(E |error|^2); the real and the imaginary part have
                                                            // sigma / sqrt 2
  int cycles = 0;                                           // measured cycles it rests on
};

// Plays one period of `stimulus` over and over to a rig across a link in this process, and feeds the estimator from
// sample `settle` on. No allocation. Stops at the first status of the machine that is not usable.
template <class M, class Family, class Estimator, class OnSample>
Status run_experiment(Rig<M, Family>& rig, std::span<const double> stimulus, std::int64_t samples, std::int64_t settle,
                      Estimator& estimator, OnSample&& on_sample) noexcept {
  static_assert(input_count<M> == 1);
  using R = Rig<M, Family>;
  Loopback<typename R::Command, typename R::Reply, 4> wire;
  auto here = wire.experimenter();
  auto machine = wire.machine();
  if (!machine.try_send(rig.greeting())) return Status::failed;
  Status worst = Status::ok;
  for (std::int64_t n = 0; n < samples; ++n) {
    typename R::Reply y;
    if (!here.try_receive(y)) return Status::failed;
    worst = worse(worst, y.status);
    if (!usable(y.status)) return y.status;
    const double u = stimulus[static_cast<std::size_t>(n % static_cast<std::int64_t>(stimulus.size()))];
    if (n >= settle) worst = worse(worst, estimator.push(n, y.y));
    on_sample(n, u, y.y);
    typename R::Command command;
    command.seq = command.tick = n;
    command.u[0] = u;
    if (!here.try_send(command) || !rig.serve(machine)) return Status::failed;
  }
  return worst;
}

// Variances of single-period lines, pooled over neighbours in frequency: repeats are few, lines are many.
class LineNoise {
 public:
  // A line at `frequency` [cycles a cycle] of output `output` whose single-period variance, from `periods` repeats, is
  // `variance`.
  void add(int output, double frequency, double variance, std::int64_t periods);
  // E |Y - mean|^2 of one period near a frequency, folded into [0, sections / 2]; NaN where nothing was measured twice.
  double variance(int output, double frequency, int sections) const;
  void sort(int sections);

 private:
  struct Entry {
    double frequency, sum;  // sum of squares
    double freedom;         // complex degrees of freedom
  };
  std::vector<std::vector<Entry>> entries_;
};

// What a set of experiments gave.
struct Identification {
  int sections = 32, period = 64;
  std::vector<HtfEstimate> htf;
  std::vector<std::string> notes;
  std::int64_t missing = 0;  // samples
  std::int64_t samples = 0;  // measured, settling not counted
  Status worst = Status::ok;

  // True when repeats told the noise, so that standard errors are known.
  bool noise_known() const {
    return !htf.empty() && std::isfinite(htf.front().sigma) && htf.front().sigma > 0.0;
  }

  // Values of one harmonic and output, by rising line.
  std::vector<HtfEstimate> select(int m, int output) const;
};

// Takes over the estimator's lines at the end of an experiment; u[k] is the input at tone k [input unit]; channel c of
// the estimator is output first_output + c. Standard errors come later, from finish().
template <class Estimator>
void collect(const Estimator& estimator, std::span<const Complex> u, int first_output, int channels,
             Identification& out, LineNoise& noise) {
  const std::int64_t repeats = estimator.periods();
  const auto averaged = static_cast<double>(std::max<std::int64_t>(repeats, 1));
  for (int k = 0; k < estimator.tones(); ++k) {
    const Complex input = u[static_cast<std::size_t>(k)];
    for (int l = -estimator.harmonics(); l <= estimator.harmonics(); ++l) {
      for (int c = 0; c < channels; ++c) {
        const Complex y = repeats > 0 ? estimator.mean(k, l, c) : estimator.line(k, l, c);
        HtfEstimate h{l, estimator.tone_line(k), first_output + c, y / input};
        h.sigma = 1.0 / (std::abs(input) * std::sqrt(averaged));  // times the noise of one period: finish()
        h.cycles = static_cast<int>(averaged) * estimator.period();
        out.htf.push_back(h);
        if (repeats >= 2) {
          const double f = static_cast<double>(h.line) / estimator.period() + l;
          noise.add(h.output, f, estimator.variance(k, l, c), repeats);
        }
      }
    }
  }
}

// Turns the collected scale of each estimate into its standard error with the pooled noise.
void finish(Identification& id, LineNoise& noise);

}  // namespace saltus
