// The nonlinear distortion of an emulated machine: one experiment with an odd stimulus, at one amplitude.
#pragma once

#include <vector>

#include "campaign.hpp"
#include "core/spectrum/distortion.hpp"

namespace saltus {

// Output lines r + l P of one output and one l, over the silent classes r.
struct HarmonicDistortion {
  int l = 0, output = 0;
  DistortionLevel even, odd;
  double excited = 0.0;  // root mean square of the excited lines [output unit]
};

struct Distortion {
  Status status = Status::failed;
  std::vector<HarmonicDistortion> harmonics;  // by output, then l
  std::vector<DistortionLevel> even, odd;     // of each output, all l together

  // Chance below `level`, shared among the outputs and the two orders.
  bool found_even(int output, double level = 1e-3) const { return found(even, output, level); }
  bool found_odd(int output, double level = 1e-3) const { return found(odd, output, level); }

 private:
  static bool found(const std::vector<DistortionLevel>& all, int output, double level) {
    return all[static_cast<std::size_t>(output)].chance() < level / (2.0 * static_cast<double>(all.size()));
  }
};

// Plays an odd stimulus of even period to a machine on its limit cycle. `noise` as in CampaignOptions; without any, the
// levels are the exact distortion and every chance is 1.
template <class M, class Family>
Distortion measure_distortion(const M& m, const Family& family, const Multisine<max_tones>& stimulus, int period,
                              const CampaignOptions& o) {
  constexpr int ny = output_count<M>, N = campaign_sections;
  using Estimator = HtfEstimator<max_tones + 1, max_harmonics, ny, N, 2 * max_tones>;
  Distortion r;
  const Timebase base = timebase_of(m, o.ticks);
  auto system = std::make_unique<LdtpOf<M, N>>();
  const auto orbit = find_orbit<N>(m, base, family, *system);
  r.status = orbit.status;
  if (orbit.status != Status::ok) return r;
  const Output<M> noise = by_output<M>(o.noise);
  std::vector<typename Estimator::Sample> baseline;
  for (const auto& y : orbit.output) {
    typename Estimator::Sample s{};
    for (int i = 0; i < ny; ++i) s[static_cast<std::size_t>(i)] = y[i];
    baseline.push_back(s);
  }
  std::vector<int> classes, tones;
  for (int c = 0; c <= period / 2; ++c) classes.push_back(c);
  for (int k = 0; k < stimulus.tones(); ++k) tones.push_back(stimulus.tone(k).line);
  std::vector<double> u;
  for (int n = 0; n < stimulus.samples(); ++n) u.push_back(stimulus(n));
  const auto estimator = std::make_unique<Estimator>();
  const int harmonics = std::min(o.harmonics, max_harmonics);
  r.status = estimator->configure(N, period, classes, harmonics);
  if (r.status == Status::ok) r.status = estimator->set_baseline(baseline);
  if (r.status != Status::ok) return r;
  Run<M> start;
  start.at = orbit.point[0];
  Rig<M, Family> rig(m, base, family, start, noise, o.seed);
  r.status = run_experiment(rig, u, (o.settle + o.periods * period) * N, o.settle * N, *estimator, [](auto&&...) {});
  if (!usable(r.status)) return r;
  const std::int64_t repeats = estimator->periods();
  r.even.resize(ny);
  r.odd.resize(ny);
  for (int c = 0; c < ny; ++c) {
    for (int l = -harmonics; l <= harmonics; ++l) {
      HarmonicDistortion h;
      h.l = l;
      h.output = c;
      double excited = 0.0;
      int count = 0;
      for (int k = 0; k < estimator->tones(); ++k) {
        const Complex mean = estimator->mean(k, l, c);
        const double variance = estimator->variance(k, l, c);
        switch (line_kind(estimator->tone_line(k), period, tones)) {
          case LineKind::excited:
            excited += std::norm(mean);
            ++count;
            break;
          case LineKind::even:
            // Class P / 2 is its own mirror image: l and -l - 1 are one line.
            if (2 * estimator->tone_line(k) == period && l < 0) break;
            h.even.add(mean, variance, repeats);
            r.even[static_cast<std::size_t>(c)].add(mean, variance, repeats);
            break;
          case LineKind::odd:
            h.odd.add(mean, variance, repeats);
            r.odd[static_cast<std::size_t>(c)].add(mean, variance, repeats);
            break;
          case LineKind::neither:
            break;
        }
      }
      h.excited = std::sqrt(excited / std::max(1, count));
      r.harmonics.push_back(h);
    }
  }
  return r;
}

}  // namespace saltus
