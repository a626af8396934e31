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

// Whether the circle of each estimate holds the truth: pooled standard errors know 48 lines' worth of repeats.
bool circle_holds(const HtfEstimate& h, Complex truth, double level, std::int64_t periods);

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

// The machine is deterministic, so its steady response to each experiment of the plan is played once; every trial adds
// its own noise to the outputs, and then goes the whole way through the streaming estimator. The truth is the
// linearised model's.
template <class M, class Family>
Coverage cover(const M& m, const Family& family, const Plan& plan, const CoverageOptions& o,
               const std::function<void(double)>& progress = {}) {
  constexpr int ny = output_count<M>;
  using Estimator = HtfEstimator<max_tones, 3, ny, 32, 2 * max_tones>;
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
      std::vector<ColouredNoise> source;
      for (int c = 0; c < ny; ++c) {
        source.emplace_back(
            o.colour, o.seed,
            (static_cast<std::uint64_t>(trial) * plan.experiments.size() + e) * ny + static_cast<std::uint64_t>(c));
      }
      if (estimator->configure(id.sections, id.period, lines, o.harmonics) != Status::ok ||
          estimator->set_baseline(baseline) != Status::ok) {
        return r;
      }
      for (std::int64_t n = 0; n < o.periods * length; ++n) {
        // The record's last period starts after the settling cycles, which are not a whole period.
        const std::int64_t sample = n + clean.settle * id.sections;
        const auto place = static_cast<std::size_t>(clean.settle * id.sections + wrap(n, length));
        typename Estimator::Sample y;
        for (std::size_t c = 0; c < y.size(); ++c) {
          y[c] = record.outputs[c].values[e * stride + place] + o.noise[c] * source[c]();
        }
        if (!usable(estimator->push(sample, y))) return r;
      }
      collect(*estimator, spectrum, 0, ny, id, noise, equations);
    }
    finish(id, noise);
    for (std::size_t i = 0; i < id.htf.size(); ++i) {
      ++r.lines;
      r.lines_inside += circle_holds(id.htf[i], truth[i], o.level, o.periods) ? 1 : 0;
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
