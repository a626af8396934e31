// A whole campaign on an emulated machine: find its limit cycle, play every experiment of a plan, identify.
#pragma once

#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>

#include "core/orbit/orbit.hpp"
#include "core/spectrum/htf.hpp"
#include "core/trace/drift_watch.hpp"
#include "eigenvalues.hpp"
#include "hal/record.hpp"
#include "identification.hpp"

namespace saltus {

inline constexpr int campaign_sections = 32;
inline constexpr double attracting = 0.9999;  // [-] of a deviation, a cycle later: above it nothing settles

struct CampaignOptions {
  std::int64_t ticks = 512;   // [tick] a turn of the clock
  std::int64_t settle = 80;   // [cycle] played before the estimator listens
  std::int64_t periods = 1;   // [stimulus period] listened to
  int harmonics = 3;          // H_-harmonics ... H_harmonics
  std::vector<double> noise;  // [output unit] standard deviation of each output; empty: none
  std::uint64_t seed = 1;     // of the noise
  std::vector<double>
      watch;  // [output unit] noise of each output, for the residual to be held against; empty: not watched
  double false_alarm = 1e-6;  // [-] probability, a cycle, that the watch cries out though nothing is wrong
  std::function<void(const Drift&)> on_drift;  // at once, once an experiment
};

template <class M>
struct Campaign {
  Orbit<M, campaign_sections> orbit;
  LdtpOf<M, campaign_sections> system;
  Identification id;
  double period = 1.0;  // [s]
  double decay = 0.0;   // [-] what a cycle leaves of a deviation: the largest modulus of a multiplier

  // The exact H_m of the linearised model at a line.
  Complex exact(const HtfEstimate& h) const {
    const double omega = 2.0 * std::numbers::pi * h.line / (static_cast<double>(id.period) * id.sections);
    return htf(system, omega)(h.m)(h.output, 0);
  }
};

// How far from its cycle an output may be measured: beyond ten times the cycle's own size, root of the mean square, and
// eight times the noise, a machine is somewhere else. Infinite for an output that the cycle does not move.
template <class M>
std::vector<double> cycle_bounds(const Orbit<M, campaign_sections>& orbit, const Output<M>& noise) {
  std::vector<double> bounds;
  for (int i = 0; i < output_count<M>; ++i) {
    double mean = 0.0, square = 0.0;
    for (const auto& y : orbit.output) mean += y[i] / campaign_sections;
    for (const auto& y : orbit.output) square += (y[i] - mean) * (y[i] - mean) / campaign_sections;
    const bool moves = square > 1e-18 * (1.0 + mean * mean);
    bounds.push_back(moves ? 10.0 * std::sqrt(square) + 8.0 * noise[i] : std::numeric_limits<double>::infinity());
  }
  return bounds;
}

// The names of a model's charts, in their order.
template <class M>
std::vector<std::string> chart_names() {
  std::vector<std::string> names;
  [&]<class... Cs>(List<Cs...>) { (names.emplace_back(type_name<Cs>()), ...); }(typename M::Charts{});
  return names;
}

// Leaves the first `rows` of a record.
inline void cut(Record& r, std::size_t rows) {
  r.experiment.resize(rows);
  r.cycle.resize(rows);
  r.section.resize(rows);
  r.t.resize(rows);
  for (Channel& c : r.inputs) c.values.resize(rows);
  for (Channel& c : r.outputs) c.values.resize(rows);
}

// Starts every experiment on the limit cycle. `record`, when given, receives every sample, settling included. Status:
// of the orbit search when that failed, failed when the cycle does not attract so that no experiment would settle
// (nothing is identified then) or when the machine was far from it and did not say why, else the worst it reported.
// `play(experiment, rig, stimulus, spectrum, samples, settle, estimator, on_sample)` plays one and returns its status;
// it may begin one again, and the rig is for who wants one in this process.
template <class M, class Family, class Play>
std::unique_ptr<Campaign<M>> run_campaign(const M& m, const Family& family, const Plan& plan, const CampaignOptions& o,
                                          Record* record, const std::function<void(double)>& progress, Play&& play) {
  constexpr int ny = output_count<M>;
  auto campaign = std::make_unique<Campaign<M>>();
  Campaign<M>& c = *campaign;
  const Timebase base = timebase_of(m, o.ticks);
  c.period = base.period;
  c.orbit = find_orbit<campaign_sections>(m, base, family, c.system);
  c.id.sections = plan.options.sections;
  c.id.period = plan.options.period;
  c.id.worst = c.orbit.status;
  if (c.orbit.status != Status::ok) return campaign;
  const std::vector<Complex> multipliers = eigenvalues(c.system.monodromy(0));
  c.decay = multipliers.empty() ? std::numeric_limits<double>::infinity() : std::abs(multipliers[0]);
  if (!(c.decay < attracting)) {
    c.id.worst = Status::failed;
    return campaign;
  }
  const auto settle = static_cast<double>(o.settle);
  if (const double left = std::pow(c.decay, settle); left > 1e-4) {
    char note[128];
    std::snprintf(note, sizeof note, "after %.0f settling cycles %.1e of the first transient is left; %.0f leave 1e-4",
                  settle, left, std::max(1.0, std::ceil(std::log(1e-4) / std::log(c.decay))));
    c.id.notes.emplace_back(note);
  }

  Output<M> noise = Output<M>::Zero();
  for (std::size_t i = 0; i < o.noise.size() && i < static_cast<std::size_t>(ny); ++i)
    noise[static_cast<int>(i)] = o.noise[i];
  using Estimator = LineEstimator<ny>;
  const auto estimator = std::make_unique<Estimator>();
  std::vector<typename Estimator::Sample> baseline;
  for (const auto& y : c.orbit.output) {
    typename Estimator::Sample s{};
    for (int i = 0; i < ny; ++i) s[static_cast<std::size_t>(i)] = y[i];
    baseline.push_back(s);
  }
  const std::vector<double> bound = cycle_bounds(c.orbit, noise);
  const auto twiddles = std::make_unique<Twiddles<256 * 512>>();
  const int length = plan.options.sections * plan.options.period;
  if (!twiddles->configure(length)) {
    c.id.worst = Status::failed;
    return campaign;
  }
  std::vector<double> stimulus(static_cast<std::size_t>(length));
  using Watch = DriftWatch<M, Family, campaign_sections>;
  std::unique_ptr<Watch> watch;
  if (o.watch.size() == static_cast<std::size_t>(ny)) {
    watch = std::make_unique<Watch>();
    typename Watch::Sample band{};
    std::copy(o.watch.begin(), o.watch.end(), band.begin());
    Run<M> on_cycle;
    on_cycle.at = c.orbit.point[0];
    if (watch->configure(m, base, family, on_cycle, band, o.false_alarm, o.settle) != Status::ok) watch.reset();
    c.id.watched = watch != nullptr;
  }
  const auto drifted = [&](std::size_t experiment) {
    const auto d = watch->departure();
    Drift drift;
    drift.experiment = static_cast<int>(experiment);
    drift.cycle = d.cycle;
    drift.z = d.z;
    drift.phase = static_cast<double>(d.section) / plan.options.sections;
    if (d.chart >= 0) drift.chart = chart_names<M>()[static_cast<std::size_t>(d.chart)];
    if (d.output >= 0) drift.output = M::outputs[static_cast<std::size_t>(d.output)].name;
    return drift;
  };
  LineNoise line_noise;
  const std::int64_t samples = (o.settle + o.periods * plan.options.period) * plan.options.sections;
  for (std::size_t e = 0; e < plan.experiments.size(); ++e) {
    const auto& multisine = plan.experiments[e];
    std::vector<int> lines;
    std::vector<Complex> u;
    for (int k = 0; k < multisine.tones(); ++k) {
      lines.push_back(multisine.tone(k).line);
      u.push_back(multisine.spectrum(multisine.tone(k).line));
    }
    Run<M> start;
    start.at = c.orbit.point[0];
    Rig<M, Family> rig(m, base, family, start, noise, o.seed + 1000003 * e);
    if (!multisine.fill(*twiddles, stimulus) ||
        estimator->configure(plan.options.sections, plan.options.period, lines, o.harmonics) != Status::ok ||
        estimator->set_baseline(baseline) != Status::ok) {
      c.id.worst = Status::failed;
      return campaign;
    }
    const std::size_t rows = record == nullptr ? 0 : record->rows();
    bool near = true, cried = false;
    const auto on_sample = [&](std::int64_t n, double input, const auto& y) {
      const auto& cycle = baseline[static_cast<std::size_t>(n % plan.options.sections)];
      for (std::size_t i = 0; i < bound.size(); ++i) near = near && !(std::abs(y[i] - cycle[i]) > bound[i]);
      if (watch) {
        if (n == 0) watch->begin();
        watch->push(Input<M>::Constant(input), y);
        if (watch->raised() && !cried) {
          cried = true;
          c.id.drifts.push_back(drifted(e));
          if (o.on_drift) o.on_drift(c.id.drifts.back());
        }
      }
      if (record == nullptr) return;
      if (n == 0) cut(*record, rows);
      record->experiment.push_back(static_cast<int>(e));
      record->cycle.push_back(static_cast<int>(n / plan.options.sections));
      record->section.push_back(static_cast<int>(n % plan.options.sections));
      record->t.push_back(static_cast<double>(n) * c.period / plan.options.sections);
      record->inputs[0].values.push_back(input);
      for (std::size_t i = 0; i < static_cast<std::size_t>(ny); ++i) record->outputs[i].values.push_back(y[i]);
    };
    const Status s =
        play(static_cast<std::int32_t>(e), rig, std::span<const double>(stimulus), std::span<const Complex>(u), samples,
             o.settle * plan.options.sections, *estimator, on_sample);
    c.id.worst = worse(c.id.worst, near || !usable(s) ? s : Status::failed);
    if (!usable(c.id.worst)) return campaign;
    c.id.samples += o.periods * length;
    collect(*estimator, u, 0, ny, c.id, line_noise);
    if (progress) progress(static_cast<double>(e + 1) / static_cast<double>(plan.experiments.size()));
  }
  finish(c.id, line_noise);
  return campaign;
}

// The same with a rig in this process.
template <class M, class Family>
std::unique_ptr<Campaign<M>> run_campaign(const M& m, const Family& family, const Plan& plan, const CampaignOptions& o,
                                          Record* record, const std::function<void(double)>& progress) {
  return run_campaign(m, family, plan, o, record, progress,
                      [](std::int32_t, auto& rig, std::span<const double> stimulus, std::span<const Complex>,
                         std::int64_t samples, std::int64_t settle, auto& estimator, const auto& on_sample) {
                        return run_experiment(rig, stimulus, samples, settle, estimator, on_sample);
                      });
}

}  // namespace saltus
