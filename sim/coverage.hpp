// Do the intervals hold what they promise? Many noisy experiments on one machine, and how often the truth was inside.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>

#include "campaign.hpp"
#include "eigenvalues.hpp"
#include "multiplier_region.hpp"

namespace saltus {

struct CoverageOptions {
  int trials = 250;
  std::int64_t periods = 4;   // [stimulus period] of each experiment
  int harmonics = 3;          // H_-harmonics ... H_harmonics, as `saltus identify` has them
  double level = 0.95;        // of the intervals
  double colour = 0.0;        // [-] pole of the noise, 0: white; its standard deviation stays
  double process = 0.0;       // [input unit] standard deviation of a random force where the input acts, unknown to
                              // whoever identifies: held from section to section, anew at each
  std::vector<double> noise;  // [output unit] standard deviation of each output
  std::uint64_t seed = 1;
};

struct Coverage {
  std::int64_t lines = 0, lines_inside = 0;              // complex estimates H_m(q), all trials
  std::int64_t multipliers = 0, multipliers_inside = 0;  // confidence ellipses, one of each conjugate pair
  int failed = 0;                                        // trials whose fit did not converge
  double error = 0.0, sigma = 0.0;  // of the first multiplier: root mean square, mean standard error

  double line_rate() const { return static_cast<double>(lines_inside) / static_cast<double>(lines); }
  double multiplier_rate() const { return static_cast<double>(multipliers_inside) / static_cast<double>(multipliers); }
  // Standard error of the multipliers' rate where the promise is kept: trials are independent.
  double multiplier_rate_sigma(double level) const {
    return std::sqrt(level * (1.0 - level) / static_cast<double>(std::max<std::int64_t>(1, multipliers)));
  }
};

// Whether the circle of the estimate holds the truth, its standard error known as well as its degrees of freedom say.
bool circle_holds(const HtfEstimate& h, Complex truth, double level);

// One stretch of noise: an autoregression of order one, stationary, of standard deviation 1.
class ColouredNoise {
 public:
  ColouredNoise(double pole, std::uint64_t seed, std::uint64_t stream = 0)
      : pole_(pole), gain_(std::sqrt(1.0 - pole * pole)), random_(seed, stream), state_(random_.normal()) {}
  double operator()() { return state_ = pole_ * state_ + gain_ * random_.normal(); }

 private:
  double pole_, gain_;
  Random random_;
  double state_;
};

// A machine from section 0 on under one period of a stimulus, over and over, to which a random force of standard
// deviation `sigma` [input unit] adds, held from section to section. `on_output(n, y)` is given every sample and says
// whether to go on; failed where it does not.
template <class M, class Family, class OnOutput>
Status play_with_force(const M& m, const Family& family, std::int64_t ticks, const Point<M>& start,
                       std::span<const double> stimulus, std::int64_t samples, double sigma, Random force,
                       OnOutput&& on_output) {
  Timebase base = timebase_of(m, ticks);
  if constexpr (!Family::on_grid) base.sets_clock = false;
  Run<M> run;
  run.at = start;
  for (std::int64_t n = 0; n < samples; ++n) {
    const Output<M> output = output_at(m, run.at, Input<M>(Input<M>::Zero()));
    std::array<double, output_count<M>> y{};
    for (std::size_t c = 0; c < y.size(); ++c) y[c] = output[static_cast<int>(c)];
    if (!on_output(n, y)) return Status::failed;
    const double u = stimulus[static_cast<std::size_t>(n) % stimulus.size()] + sigma * force.normal();
    const Status s = to_next_section(m, run, static_cast<int>(n % family.count()), Input<M>(Input<M>::Constant(u)),
                                     base, family, [](const Point<M>&, const Passage&) {});
    if (!usable(s)) return s;
  }
  return Status::ok;
}

// Where only outputs are noisy, the machine's steady response to each experiment of the plan is played once; every
// trial adds its own noise. A random force goes through the machine, which is played anew in every trial. All goes the
// whole way through the streaming estimator. The truth is the linearised model's.
template <class M, class Family>
Coverage cover(const M& m, const Family& family, const Plan& plan, const CoverageOptions& o,
               const std::function<void(double)>& progress = {}) {
  constexpr int ny = output_count<M>;
  using Estimator = ClassEstimator<max_tones, 3, ny, 32, 2 * max_tones>;
  const int length = plan.options.sections * plan.options.period;
  CampaignOptions clean;
  clean.settle = 80;
  clean.harmonics = o.harmonics;
  Record record;
  record.inputs.emplace_back();
  record.outputs.resize(ny);
  const auto campaign = run_campaign(m, family, plan, clean, &record, {});
  Coverage r;
  if (!usable(campaign->id.worst)) return r;
  std::vector<Complex> truth;
  for (const HtfEstimate& h : campaign->id.htf) truth.push_back(campaign->exact(h));
  const std::vector<Complex> exact = nonzero_multipliers(campaign->system.monodromy(0));
  const auto estimator = std::make_unique<Estimator>();
  std::vector<typename Estimator::Sample> baseline;
  for (const auto& y : campaign->orbit.output) {
    typename Estimator::Sample s{};
    for (int c = 0; c < ny; ++c) s[static_cast<std::size_t>(c)] = y[c];
    baseline.push_back(s);
  }
  const std::size_t stride = record.outputs[0].values.size() / plan.experiments.size();
  for (int trial = 0; trial < o.trials; ++trial) {
    Identification id;
    id.sections = plan.options.sections;
    id.period = plan.options.period;
    LineNoise noise;
    LineEquations equations(id.sections, id.period);
    for (std::size_t e = 0; e < plan.experiments.size(); ++e) {
      const auto& u = plan.experiments[e];
      std::vector<int> lines;
      std::vector<Complex> spectrum;
      for (int k = 0; k < u.tones(); ++k) {
        lines.push_back(u.tone(k).line);
        spectrum.push_back(u.spectrum(u.tone(k).line));
      }
      const auto stream = (static_cast<std::uint64_t>(trial) * plan.experiments.size() + e) * ny;
      std::vector<ColouredNoise> source;
      for (int c = 0; c < ny; ++c) {
        source.emplace_back(o.colour, o.seed, stream + static_cast<std::uint64_t>(c));
      }
      if (estimator->configure(id.sections, id.period, lines, o.harmonics) != Status::ok ||
          estimator->set_baseline(baseline) != Status::ok) {
        return r;
      }
      const auto measure = [&](std::int64_t n, auto y) {
        for (std::size_t c = 0; c < static_cast<std::size_t>(ny); ++c) y[c] += o.noise[c] * source[c]();
        return usable(estimator->push(n, y));
      };
      const std::int64_t from = clean.settle * id.sections, to = from + o.periods * length;
      if (o.process > 0.0) {
        const std::span<const double> stimulus(record.inputs[0].values.data() + e * stride,
                                               static_cast<std::size_t>(length));
        const Status s = play_with_force(m, family, clean.ticks, campaign->orbit.point[0], stimulus, to, o.process,
                                         Random(o.seed, ~stream),
                                         [&](std::int64_t n, const auto& y) { return n < from || measure(n, y); });
        if (!usable(s)) return r;
      }
      for (std::int64_t n = from; o.process == 0.0 && n < to; ++n) {
        // The record's last period starts after the settling cycles, which are not a whole period.
        const auto place = e * stride + static_cast<std::size_t>(from + wrap(n - from, length));
        typename Estimator::Sample y;
        for (std::size_t c = 0; c < y.size(); ++c) y[c] = record.outputs[c].values[place];
        if (!measure(n, y)) return r;
      }
      collect(*estimator, spectrum, 0, ny, id, noise, equations);
    }
    finish(id, noise);
    for (std::size_t i = 0; i < id.htf.size(); ++i) {
      ++r.lines;
      r.lines_inside += circle_holds(id.htf[i], truth[i], o.level) ? 1 : 0;
    }
    RegionOptions region_options;
    region_options.count = static_cast<int>(exact.size());
    const MultiplierRegion region = multiplier_region(id, ny, region_options);
    if (region.status != Status::ok) {
      ++r.failed;
      continue;
    }
    for (std::size_t i = 0; i < exact.size(); ++i) {
      if (exact[i].imag() < 0.0) continue;
      ++r.multipliers;
      r.multipliers_inside += region.holds(i, exact[i], o.level) ? 1 : 0;
    }
    r.error += std::norm(region.multipliers[0] - exact[0]);
    r.sigma += region.sigma(0);
    if (progress) progress(static_cast<double>(trial + 1) / o.trials);
  }
  const int done = std::max(1, o.trials - r.failed);
  r.error = std::sqrt(r.error / done);
  r.sigma /= done;
  return r;
}

}  // namespace saltus
