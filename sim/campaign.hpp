// A whole campaign on an emulated machine: find its limit cycle, play every experiment of a plan, identify.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <mutex>

#include "core/orbit/orbit.hpp"
#include "core/spectrum/htf.hpp"
#include "core/trace/drift_watch.hpp"
#include "diagnosis/side_by_side.hpp"
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
  double jitter = 0.0;        // [s] standard deviation of the instants at which outputs are taken
  std::int64_t ramp = 0;      // [cycle] over which the stimulus grows, as a raised cosine; no more than settle
  std::uint64_t seed = 1;     // of the noise
  std::vector<double>
      watch;  // [output unit] noise of each output, for the residual to be held against; empty: not watched
  double false_alarm = 1e-6;  // [-] probability, a cycle, that the watch cries out though nothing is wrong
  std::function<void(const Drift&)> on_drift;  // at once, once an experiment; by one thread at a time
  int jobs = 1;  // experiments played at a time, each by a thread of its own; nothing that is found depends on it
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

// Puts the rows of one record behind those of another with the same channels.
inline void append(Record& to, const Record& r) {
  const auto put = [](auto& all, const auto& more) { all.insert(all.end(), more.begin(), more.end()); };
  put(to.experiment, r.experiment);
  put(to.cycle, r.cycle);
  put(to.section, r.section);
  put(to.t, r.t);
  for (std::size_t i = 0; i < to.inputs.size(); ++i) put(to.inputs[i].values, r.inputs[i].values);
  for (std::size_t i = 0; i < to.outputs.size(); ++i) put(to.outputs[i].values, r.outputs[i].values);
}
// Adds sample n of an experiment with one input, taken at section n modulo `sections` of a cycle of `period` seconds.
void add_row(Record& r, int experiment, std::int64_t n, int sections, double period, double input, const auto& y) {
  r.experiment.push_back(experiment);
  r.cycle.push_back(static_cast<int>(n / sections));
  r.section.push_back(static_cast<int>(n % sections));
  r.t.push_back(static_cast<double>(n) * period / sections);
  r.inputs[0].values.push_back(input);
  for (std::size_t c = 0; c < r.outputs.size(); ++c) r.outputs[c].values.push_back(y[c]);
}
inline void empty(Record& r) {
  for (auto* whole : {&r.experiment, &r.cycle, &r.section}) whole->clear();
  r.t.clear();
  for (Channel& c : r.inputs) c.values.clear();
  for (Channel& c : r.outputs) c.values.clear();
}

// What it takes to play an experiment.
template <class M, class Family>
struct Station {
  std::unique_ptr<CampaignEstimator<output_count<M>>> estimator = std::make_unique<CampaignEstimator<output_count<M>>>();
  std::unique_ptr<DriftWatch<M, Family, campaign_sections>> watch;  // null: not watched
  std::vector<double> stimulus;
  std::vector<Complex> u;  // of the lines
};

// What came of one.
struct Played {
  Status status = Status::failed;
  Identification id;  // the estimates alone
  LineNoise noise;
  std::vector<Drift> drifts;
  Record rows;
};

// Starts every experiment on the limit cycle. `record`, when given, receives every sample, settling included. Status:
// of the orbit search when that failed, failed when the cycle does not attract so that no experiment would settle
// (nothing is identified then) or when the machine was far from it and did not say why, else the worst it reported.
// `play(experiment, rig, stimulus, spectrum, samples, settle, estimator, on_sample)` plays one and returns its status;
// it may begin one again, and the rig is for who wants one in this process. With several jobs it is called by several
// threads at a time.
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

  const Output<M> noise = by_output<M>(o.noise);
  std::vector<typename CampaignEstimator<ny>::Sample> baseline;
  for (const auto& y : c.orbit.output) {
    typename CampaignEstimator<ny>::Sample s{};
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
  std::vector<Station<M, Family>> stations(
      std::min(static_cast<std::size_t>(std::max(1, o.jobs)), plan.experiments.size() + 1));
  for (auto& station : stations) {
    station.stimulus.resize(static_cast<std::size_t>(length));
    if (o.watch.size() == static_cast<std::size_t>(ny)) {
      station.watch = std::make_unique<DriftWatch<M, Family, campaign_sections>>();
      typename CampaignEstimator<ny>::Sample band{};
      std::copy(o.watch.begin(), o.watch.end(), band.begin());
      Run<M> on_cycle;
      on_cycle.at = c.orbit.point[0];
      if (station.watch->configure(m, base, family, on_cycle, band, o.false_alarm, o.settle) != Status::ok) {
        station.watch.reset();
      }
      c.id.watched = station.watch != nullptr;
    }
  }
  const auto drifted = [&](const auto& watch, std::size_t experiment) {
    const auto d = watch.departure();
    Drift drift;
    drift.experiment = static_cast<int>(experiment);
    drift.cycle = d.cycle;
    drift.z = d.z;
    drift.phase = static_cast<double>(d.section) / plan.options.sections;
    if (d.chart >= 0) drift.chart = chart_names<M>()[static_cast<std::size_t>(d.chart)];
    if (d.output >= 0) drift.output = M::outputs[static_cast<std::size_t>(d.output)].name;
    return drift;
  };
  std::mutex telling;
  std::size_t done = 0;
  const std::int64_t samples = (o.settle + o.periods * plan.options.period) * plan.options.sections;
  const auto perform = [&](Station<M, Family>& at, std::size_t e, Played& result) {
    const auto& multisine = plan.experiments[e];
    std::vector<int> lines;
    at.u.clear();
    for (int k = 0; k < multisine.tones(); ++k) {
      lines.push_back(multisine.tone(k).line);
      at.u.push_back(multisine.spectrum(multisine.tone(k).line));
    }
    Run<M> start;
    start.at = c.orbit.point[0];
    Rig<M, Family> rig(m, base, family, start, noise, o.seed + 1000003 * e);
    rig.jitter(o.jitter);
    if (!multisine.fill(*twiddles, at.stimulus) ||
        at.estimator->configure(plan.options.sections, plan.options.period, lines, o.harmonics) != Status::ok ||
        at.estimator->set_baseline(baseline) != Status::ok) {
      return;
    }
    Record& rows = result.rows;
    if (record != nullptr) {
      rows.inputs.resize(1);
      rows.outputs.resize(static_cast<std::size_t>(ny));
    }
    bool near = true;
    const auto on_sample = [&](std::int64_t n, double input, const auto& y) {
      const auto& cycle = baseline[static_cast<std::size_t>(n % plan.options.sections)];
      for (std::size_t i = 0; i < bound.size(); ++i) near = near && !(std::abs(y[i] - cycle[i]) > bound[i]);
      if (at.watch) {
        if (n == 0) at.watch->begin();
        at.watch->push(Input<M>::Constant(input), y);
        if (at.watch->raised() && result.drifts.empty()) {
          result.drifts.push_back(drifted(*at.watch, e));
          const std::lock_guard lock(telling);
          if (o.on_drift) o.on_drift(result.drifts.back());
        }
      }
      if (record == nullptr) return;
      if (n == 0) empty(rows);
      add_row(rows, static_cast<int>(e), n, plan.options.sections, c.period, input, y);
    };
    const std::int64_t rising = std::min(o.ramp, o.settle) * plan.options.sections;
    std::vector<double> ramped;  // the whole experiment where it does not repeat from the start
    for (std::int64_t n = 0; rising > 0 && n < samples; ++n) {
      const double part = static_cast<double>(n) / static_cast<double>(rising);
      const double weight = n < rising ? 0.5 - 0.5 * std::cos(std::numbers::pi * part) : 1.0;
      ramped.push_back(weight * at.stimulus[static_cast<std::size_t>(n % length)]);
    }
    const Status s =
        play(static_cast<std::int32_t>(e), rig, std::span<const double>(rising > 0 ? ramped : at.stimulus),
             std::span<const Complex>(at.u), samples, o.settle * plan.options.sections, *at.estimator, on_sample);
    result.status = near || !usable(s) ? s : Status::failed;
    if (!usable(result.status)) return;
    collect(*at.estimator, at.u, 0, ny, result.id, result.noise);
    const std::lock_guard lock(telling);
    ++done;
    if (progress) progress(static_cast<double>(done) / static_cast<double>(plan.experiments.size()));
  };
  std::vector<Played> played(plan.experiments.size());
  std::atomic<std::size_t> next{0};
  diagnosis::side_by_side(stations.size(), [&](std::size_t i) {
    for (std::size_t e = next++; e < played.size(); e = next++) {
      perform(stations[i], e, played[e]);
      if (!usable(played[e].status)) next = played.size();
    }
  });
  LineNoise line_noise;
  for (Played& p : played) {  // in the order of the plan, whoever was first
    if (record != nullptr) append(*record, p.rows);
    p.rows = {};
    c.id.drifts.insert(c.id.drifts.end(), p.drifts.begin(), p.drifts.end());
    c.id.worst = worse(c.id.worst, p.status);
    if (!usable(c.id.worst)) return campaign;
    c.id.samples += o.periods * length;
    c.id.htf.insert(c.id.htf.end(), p.id.htf.begin(), p.id.htf.end());
    line_noise.append(p.noise);
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
