// From a measured experiment to harmonic transfer functions: an experiment with an emulated machine over a link, sample
// by sample; and what the estimator's lines say once it is over, with standard errors.
#pragma once

#include <cmath>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "class_correlation.hpp"
#include "core/spectrum/estimator.hpp"
#include "hal/lockstep.hpp"
#include "hal/loopback.hpp"
#include "line_equations.hpp"
#include "plan.hpp"
#include "rig.hpp"

namespace saltus {

inline constexpr int max_harmonics = 8;
template <int Channels>
using LineEstimator = HtfEstimator<max_tones, max_harmonics, Channels, 256, 512>;
template <int Channels>
using CampaignEstimator = ClassEstimator<max_tones, max_harmonics, Channels, 256, 512>;

// H_m at one line: the input at f = line / period cycles a cycle, the output at f + m.
struct HtfEstimate {
  int m = 0;
  int line = 0;
  int output = 0;                                           // position in the outputs
  Complex value;                                            // [output unit / input unit]
  double sigma = std::numeric_limits<double>::quiet_NaN();  // sqrt(E |error|^2); the real and the imaginary part have
                                                            // sigma / sqrt 2
  int cycles = 0;                                           // measured cycles it rests on
  int input = 0;                                            // position in the inputs
  double freedom = 0.0;  // complex degrees of freedom that sigma rests on, its neighbours' included; 0: no repeats
};

// A machine at hand for an experiment: what lies between here and there is its own affair.
//   Outcome start(experiment, y)          begins at tick 0; y is of then
//   Outcome exchange(tick, u, y)          u for that tick; y is the next measurement in order
//   std::int64_t lead()                   if need be: [tick] that u is to be given ahead, by give(tick, u) at the start
//
// This one is a rig across a link in this process.
template <class R>
class RigHere {
 public:
  explicit RigHere(R& rig) noexcept : rig_(&rig) {}
  Outcome start(std::int32_t, typename R::Reply& y) noexcept {
    return wire_.machine().try_send(rig_->greeting()) && wire_.experimenter().try_receive(y) ? Outcome::answered
                                                                                             : Outcome::silent;
  }
  Outcome exchange(std::int64_t tick, const decltype(R::Command::u)& u, typename R::Reply& y) noexcept {
    auto machine = wire_.machine();
    typename R::Command command;
    command.seq = command.tick = tick;
    command.u = u;
    return wire_.experimenter().try_send(command) && rig_->serve(machine) && wire_.experimenter().try_receive(y)
               ? Outcome::answered
               : Outcome::silent;
  }

 private:
  R* rig_;
  Loopback<typename R::Command, typename R::Reply, 4> wire_;
};

// Plays one period of `stimulus`, Nu numbers a sample, over and over to a machine of Ny outputs, and feeds the
// estimator from sample `settle` on. on_sample(n, u, y) is told a number u, or an array of several. No allocation. Ends
// at the first status of the machine that is not usable, or failed where it did not answer: `outcome` then says why.
template <int Ny, int Nu = 1, class Machine, class Estimator, class OnSample>
Status play_experiment(Machine& machine, std::int32_t experiment, std::span<const double> stimulus,
                       std::int64_t samples, std::int64_t settle, Estimator& estimator, OnSample&& on_sample,
                       Outcome& outcome) noexcept {
  std::size_t ahead = 0;  // in the stimulus, of what is to be given next
  const auto next = [&](std::size_t& at) {
    std::array<double, Nu> u{};
    for (std::size_t j = 0; j < u.size(); ++j) u[j] = stimulus[at + j];
    at += u.size();
    if (at == stimulus.size()) at = 0;
    return u;
  };
  Measurement<Ny> y;
  outcome = machine.start(experiment, y);
  if (outcome != Outcome::answered) return Status::failed;
  std::int64_t lead = 0;
  if constexpr (requires { machine.lead(); }) {
    lead = machine.lead();
    for (std::int64_t n = 0; n < lead; ++n) machine.give(n, next(ahead));
  }
  std::size_t now = 0;
  Status worst = Status::ok;
  for (std::int64_t n = 0; n < samples; ++n) {
    worst = worse(worst, y.status);
    if (!usable(y.status)) return y.status;
    if (n >= settle) worst = worse(worst, estimator.push(n, y.y));
    const auto held = next(now);
    if constexpr (Nu == 1) {
      on_sample(n, held[0], y.y);
    } else {
      on_sample(n, held, y.y);
    }
    outcome = machine.exchange(n + lead, next(ahead), y);
    if (outcome != Outcome::answered) return Status::failed;
  }
  return worst;
}

// The same to a rig in this process.
template <class M, class Family, class Estimator, class OnSample>
Status run_experiment(Rig<M, Family>& rig, std::span<const double> stimulus, std::int64_t samples, std::int64_t settle,
                      Estimator& estimator, OnSample&& on_sample) noexcept {
  RigHere machine(rig);
  Outcome outcome = Outcome::answered;
  return play_experiment<output_count<M>, input_count<M>>(machine, 0, stimulus, samples, settle, estimator, on_sample,
                                                          outcome);
}

// Variances of single-period lines, pooled over neighbours in frequency: repeats are few, lines are many.
class LineNoise {
 public:
  // A line at `frequency` [cycles a cycle] of output `output` whose single-period variance, from `periods` repeats, is
  // `variance`.
  void add(int output, double frequency, double variance, std::int64_t periods);
  void append(const LineNoise& more);
  // E |Y - mean|^2 of one period near a frequency, folded into [0, sections / 2], and the complex degrees of freedom
  // behind it; NaN where nothing was measured twice.
  struct Pooled {
    double variance, freedom;
  };
  Pooled pooled(int output, double frequency, int sections) const;
  double variance(int output, double frequency, int sections) const {
    return pooled(output, frequency, sections).variance;
  }
  void sort(int sections);

  ClassScatter classes;  // how the lines of a class scatter together

 private:
  struct Entry {
    double frequency, sum;  // sum of squares
    double freedom;         // complex degrees of freedom
  };
  std::vector<std::vector<Entry>> entries_;
};

// The residual against the declared model left its noise band while an experiment ran.
struct Drift {
  int experiment = 0;
  std::int64_t cycle = 0;  // of the experiment
  std::string chart;       // the model's, at the section that is furthest off
  double phase = 0.0;      // [cycle] of that section
  std::string output;      // empty: more scatter everywhere rather than a shift somewhere
  double z = 0.0;          // [-] standard deviations of the mean residual at that section

  std::string story() const;
};

// What a set of experiments gave.
struct Identification {
  int sections = 32, period = 64;
  std::vector<HtfEstimate> htf;
  std::vector<ClassCorrelation> classes;  // by rising line; what is not there counts as independent
  std::vector<std::string> notes;
  std::vector<Drift> drifts;  // the first of each experiment that had one
  bool watched = false;       // the residual was held against a noise band at all
  std::int64_t missing = 0;   // samples
  std::int64_t samples = 0;   // measured, settling not counted
  double condition = 1.0;     // [-] of the worst equations that several experiments share
  Status worst = Status::ok;

  // True when repeats told the noise, so that standard errors are known.
  bool noise_known() const { return !htf.empty() && std::isfinite(htf.front().sigma) && htf.front().sigma > 0.0; }

  // Values of one harmonic, output and input, by rising line.
  std::vector<HtfEstimate> select(int m, int output, int input = 0) const;
  // How the estimates of a line err together; null where nothing tells.
  const ClassCorrelation* correlation(int line) const;
};

// Takes over the estimator's lines at the end of an experiment; u[k] is the input at tone k [input unit], none where
// there are several inputs, for then every line is an equation; channel c of the estimator is output first_output + c.
// Standard errors come later, from finish(). Multiples of half the pumping frequency become equations, whose experiment
// has begun; for multiples of the whole see collect_pump().
template <class Estimator>
void collect(const Estimator& estimator, std::span<const Complex> u, int first_output, int channels,
             Identification& out, LineNoise& noise, LineEquations& equations) {
  const std::int64_t repeats = estimator.periods();
  const auto averaged = static_cast<double>(std::max<std::int64_t>(repeats, 1));
  for (int k = 0; k < estimator.tones(); ++k) {
    const int q = estimator.tone_line(k), period = estimator.period();
    if (residue_class(q, period) == 0) continue;
    for (int l = -estimator.harmonics(); l <= estimator.harmonics(); ++l) {
      for (int c = 0; c < channels; ++c) {
        const Complex y = repeats > 0 ? estimator.mean(k, l, c) : estimator.line(k, l, c);
        if (!u.empty() && identifiable(q, period)) {
          const Complex input = u[static_cast<std::size_t>(k)];
          HtfEstimate h{l, q, first_output + c, y / input};
          h.sigma = 1.0 / (std::abs(input) * std::sqrt(averaged));  // times the noise of one period: finish()
          h.cycles = static_cast<int>(averaged) * period;
          out.htf.push_back(h);
        } else if (!equations.add(q + l * period, first_output + c, y, static_cast<std::int64_t>(averaged))) {
          continue;
        }
        if (repeats >= 2) {
          const double f = static_cast<double>(q) / period + l;
          noise.add(first_output + c, f, estimator.variance(k, l, c), repeats);
        }
      }
    }
  }
  if constexpr (requires { estimator.covariance(0, 0, 0, 0, 0); }) {
    const int orders = 2 * estimator.harmonics() + 1;
    Eigen::MatrixXcd covariance(channels * orders, channels * orders);
    for (int k = 0; k < estimator.tones() && repeats >= 2; ++k) {
      if (!identifiable(estimator.tone_line(k), estimator.period())) continue;  // errors there are not circular
      for (int i = 0; i < channels * orders; ++i) {
        for (int j = 0; j < channels * orders; ++j) {
          covariance(i, j) = estimator.covariance(k, i % orders - estimator.harmonics(), i / orders,
                                                  j % orders - estimator.harmonics(), j / orders);
        }
      }
      noise.classes.add(estimator.tone_line(k), estimator.harmonics(), covariance, static_cast<double>(repeats - 1));
    }
  }
}

// Lets an estimator follow the multiples of the pumping frequency 0 ... N / 2, on which the machine's own cycle lies.
template <class Estimator>
[[nodiscard]] Status follow_pump(Estimator& estimator, int sections, int period) {
  std::vector<int> lines;  // each stands in the middle of its harmonics
  for (int s = max_harmonics; s - max_harmonics <= sections / 2; s += 2 * max_harmonics + 1)
    lines.push_back(s * period);
  return estimator.configure(sections, period, lines, max_harmonics);
}

// Takes them over as equations: of the experiments that excite them and of those that do not, which tell the cycle.
// `baseline` is what was subtracted of one channel, a value a section; empty where it was the same for all experiments.
template <class Estimator>
void collect_pump(const Estimator& estimator, std::span<const double> baseline, int first_output, int channels,
                  LineNoise& noise, LineEquations& equations) {
  const std::int64_t repeats = estimator.periods();
  const int sections = estimator.sections();
  for (int s = 0; s <= sections / 2; ++s) {
    const int k = s / (2 * max_harmonics + 1), l = s % (2 * max_harmonics + 1) - max_harmonics;
    Complex cycle{};
    for (std::size_t n = 0; n < baseline.size(); ++n) {
      cycle += baseline[n] / sections * root_of_unity(-static_cast<std::int64_t>(n) * s, sections);
    }
    for (int c = 0; c < channels; ++c) {
      const Complex y = cycle + (repeats > 0 ? estimator.mean(k, l, c) : estimator.line(k, l, c));
      (void)equations.add(s * estimator.period(), first_output + c, y, std::max<std::int64_t>(repeats, 1));
      if (repeats >= 2 && s > 0 && 2 * s < sections) {  // the others are real numbers: half the freedom
        noise.add(first_output + c, s, estimator.variance(k, l, c), repeats);
      }
    }
  }
}

// Turns the collected scale of each estimate into its standard error with the pooled noise.
void finish(Identification& id, LineNoise& noise);

}  // namespace saltus
