// A whole campaign on an emulated machine: find its limit cycle, play every experiment of a plan, identify.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <mutex>
#include <variant>

#include "core/orbit/orbit.hpp"
#include "core/spectrum/htf.hpp"
#include "core/trace/drift_watch.hpp"
#include "diagnosis/side_by_side.hpp"
#include "eigenvalues.hpp"
#include "hal/record.hpp"
#include "identification.hpp"
#include "lane_rig.hpp"

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
  int jobs = 1;       // experiments played at a time, each by a thread of its own; nothing that is found depends on it
  bool lanes = true;  // several more side by side, where the model can and is in this process; nor on this
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
    return htf(system, omega)(h.m)(h.output, h.input);
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
// What on_sample() is told of input j: there is one, or an array of them.
inline double held(double input, std::size_t) noexcept { return input; }
double held(const auto& inputs, std::size_t j) noexcept { return inputs[j]; }

// Adds sample n of an experiment, taken at section n modulo `sections` of a cycle of `period` seconds.
void add_row(Record& r, int experiment, std::int64_t n, int sections, double period, const auto& input, const auto& y) {
  r.experiment.push_back(experiment);
  r.cycle.push_back(static_cast<int>(n / sections));
  r.section.push_back(static_cast<int>(n % sections));
  r.t.push_back(static_cast<double>(n) * period / sections);
  for (std::size_t j = 0; j < r.inputs.size(); ++j) r.inputs[j].values.push_back(held(input, j));
  for (std::size_t c = 0; c < r.outputs.size(); ++c) r.outputs[c].values.push_back(y[c]);
}
inline void empty(Record& r) {
  for (auto* whole : {&r.experiment, &r.cycle, &r.section}) whole->clear();
  r.t.clear();
  for (Channel& c : r.inputs) c.values.clear();
  for (Channel& c : r.outputs) c.values.clear();
}

// Plays to the rig in this process.
struct PlayHere {
  Status operator()(std::int32_t, auto& rig, std::span<const double> stimulus, std::span<const Complex>,
                    std::int64_t samples, std::int64_t settle, auto& estimator, const auto& on_sample) const noexcept {
    return run_experiment(rig, stimulus, samples, settle, estimator, on_sample);
  }
};

// Experiments that one thread plays side by side.
inline constexpr std::size_t campaign_lanes = 8;
template <class M, class Family, class Play>
inline constexpr bool fit_lanes =
    Branchless<M>&& Family::on_grid&& input_count<M> == 1 && std::is_same_v<std::remove_cvref_t<Play>, PlayHere>;

// What it takes to play as many.
template <class M, class Family, class Play>
struct Station {
  std::unique_ptr<CampaignEstimator<output_count<M>>> estimator =
      std::make_unique<CampaignEstimator<output_count<M>>>();
  std::unique_ptr<LineEstimator<output_count<M>>> pump;  // null: no experiment excites multiples of its frequency
  std::unique_ptr<DriftWatch<M, Family, campaign_sections>> watch;  // null: not watched
  // One an experiment: what is played over and over, one number for each input a sample, and whether there is anything.
  std::array<std::vector<double>, campaign_lanes> stimulus;
  std::array<bool, campaign_lanes> playable{};
  std::vector<double> one;  // input
  std::vector<Complex> u;   // of the lines; none where there are several inputs
  std::conditional_t<fit_lanes<M, Family, Play>, LaneReplies<M, campaign_lanes>, std::monostate> replies;
};

// What came of one.
struct Played {
  Status status = Status::failed;
  Identification id;  // the estimates alone
  LineNoise noise;
  LineEquations equations;
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
  constexpr int ny = output_count<M>, nu = input_count<M>;
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
  std::vector<Station<M, Family, Play>> stations(
      std::min(static_cast<std::size_t>(std::max(1, o.jobs)), plan.experiments.size() + 1));
  const bool pumped = std::any_of(plan.experiments.begin(), plan.experiments.end(), [&](const auto& u) {
    for (int k = 0; k < u.tones(); ++k) {
      if (residue_class(u.tone(k).line, plan.options.period) == 0) return true;
    }
    return false;
  });
  for (auto& station : stations) {
    if (pumped) station.pump = std::make_unique<LineEstimator<ny>>();
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
  const std::int64_t rising = std::min(o.ramp, o.settle) * plan.options.sections;
  const auto prepare = [&](Station<M, Family, Play>& at, std::size_t e, std::size_t lane) {
    const auto once = static_cast<std::size_t>(length) * nu;
    std::vector<double>& u = at.stimulus[lane];
    u.resize(once);
    at.one.resize(static_cast<std::size_t>(length));
    at.playable[lane] = true;
    for (int j = 0; j < nu; ++j) {
      at.playable[lane] = at.playable[lane] && plan.stimulus(e, j).fill(*twiddles, at.one);
      for (std::size_t n = 0; n < at.one.size(); ++n) u[n * nu + static_cast<std::size_t>(j)] = at.one[n];
    }
    if (rising <= 0 || !at.playable[lane]) return;
    u.resize(static_cast<std::size_t>(samples) * nu);  // the whole experiment, for it does not repeat from the start
    for (std::size_t n = once; n < u.size(); ++n) u[n] = u[n - once];
    for (std::int64_t n = 0; n < std::min(rising, samples); ++n) {
      const double part = static_cast<double>(n) / static_cast<double>(rising);
      const double weight = 0.5 - 0.5 * std::cos(std::numbers::pi * part);
      for (std::size_t j = 0; j < nu; ++j) u[static_cast<std::size_t>(n) * nu + j] *= weight;
    }
  };
  Run<M> start;
  start.at = c.orbit.point[0];
  // Experiment e, which has that lane; `play_it(rig, on_sample)` plays it.
  const auto perform = [&](Station<M, Family, Play>& at, std::size_t e, std::size_t lane, Played& result,
                           const auto& play_it) {
    const auto& multisine = plan.experiments[e];
    std::vector<int> lines;
    std::vector<LineEquations::Tone> tones;
    at.u.clear();
    for (int k = 0; k < multisine.tones(); ++k) lines.push_back(multisine.tone(k).line);
    for (int j = 0; j < nu; ++j) {
      const auto own = plan.stimulus(e, j);
      for (const int q : lines) {
        tones.push_back({q, own.spectrum(q), j});
        if (nu == 1) at.u.push_back(tones.back().u);
      }
    }
    Rig<M, Family> rig(m, base, family, start, noise, o.seed + 1000003 * e);
    rig.jitter(o.jitter);
    if (!at.playable[lane] ||
        at.estimator->configure(plan.options.sections, plan.options.period, lines, o.harmonics) != Status::ok ||
        at.estimator->set_baseline(baseline) != Status::ok) {
      return;
    }
    if (at.pump && (follow_pump(*at.pump, plan.options.sections, plan.options.period) != Status::ok ||
                    at.pump->set_baseline(baseline) != Status::ok)) {
      return;
    }
    Record& rows = result.rows;
    if (record != nullptr) {
      rows.inputs.resize(nu);
      rows.outputs.resize(static_cast<std::size_t>(ny));
    }
    bool near = true;
    const auto on_sample = [&](std::int64_t n, const auto& input, const auto& y) {
      const auto& cycle = baseline[static_cast<std::size_t>(wrap(n, plan.options.sections))];
      for (std::size_t i = 0; i < bound.size(); ++i) near = near && !(std::abs(y[i] - cycle[i]) > bound[i]);
      if (at.pump) {
        if (n == 0) at.pump->restart();
        if (n >= o.settle * plan.options.sections) (void)at.pump->push(n, y);
      }
      if (at.watch) {
        if (n == 0) at.watch->begin();
        Input<M> u;
        for (int j = 0; j < nu; ++j) u[j] = held(input, static_cast<std::size_t>(j));
        at.watch->push(u, y);
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
    const Status s = play_it(rig, on_sample);
    result.status = near || !usable(s) ? s : Status::failed;
    if (!usable(result.status)) return;
    result.equations = LineEquations(plan.options.sections, plan.options.period);
    result.equations.begin(std::move(tones));
    collect(*at.estimator, at.u, 0, ny, result.id, result.noise, result.equations);
    if (at.pump) collect_pump(*at.pump, {}, 0, ny, result.noise, result.equations);
    const std::lock_guard lock(telling);
    ++done;
    if (progress) progress(static_cast<double>(done) / static_cast<double>(plan.experiments.size()));
  };
  std::vector<Played> played(plan.experiments.size());
  const std::int64_t settling = o.settle * plan.options.sections;
  const bool lanes = fit_lanes<M, Family, Play> && o.lanes && !(o.jitter > 0.0);
  const std::size_t together = lanes ? campaign_lanes : 1;
  std::atomic<std::size_t> next{0};
  diagnosis::side_by_side(stations.size(), [&](std::size_t i) {
    Station<M, Family, Play>& at = stations[i];
    for (std::size_t first = next.fetch_add(together); first < played.size(); first = next.fetch_add(together)) {
      const std::size_t count = std::min(together, played.size() - first);
      for (std::size_t lane = 0; lane < count; ++lane) prepare(at, first + lane, lane);
      if constexpr (fit_lanes<M, Family, Play>) {
        if (lanes) {
          std::array<std::span<const double>, campaign_lanes> stimuli;
          for (std::size_t lane = 0; lane < stimuli.size(); ++lane) {
            stimuli[lane] = at.stimulus[std::min(lane, count - 1)];  // what is left over goes along
          }
          play_in_lanes<M, campaign_lanes>(m, base, family, start, stimuli, samples, at.replies);
        }
      }
      for (std::size_t lane = 0; lane < count; ++lane) {
        const std::size_t e = first + lane;
        const std::span<const double> stimulus(at.stimulus[lane]);
        perform(at, e, lane, played[e], [&](auto& rig, const auto& on_sample) {
          if constexpr (fit_lanes<M, Family, Play>) {
            if (lanes) {
              return replay_lane(rig, at.replies, static_cast<int>(lane), stimulus, settling, *at.estimator, on_sample);
            }
          }
          return play(static_cast<std::int32_t>(e), rig, stimulus, std::span<const Complex>(at.u), samples, settling,
                      *at.estimator, on_sample);
        });
        if (usable(played[e].status)) continue;
        next = played.size();
        break;
      }
    }
  });
  LineNoise line_noise;
  LineEquations equations;
  for (Played& p : played) {  // in the order of the plan, whoever was first
    if (record != nullptr) append(*record, p.rows);
    p.rows = {};
    c.id.drifts.insert(c.id.drifts.end(), p.drifts.begin(), p.drifts.end());
    c.id.worst = worse(c.id.worst, p.status);
    if (!usable(c.id.worst)) return campaign;
    c.id.samples += o.periods * length;
    c.id.htf.insert(c.id.htf.end(), p.id.htf.begin(), p.id.htf.end());
    line_noise.append(p.noise);
    equations.append(p.equations);
  }
  equations.solve(o.harmonics, c.id);
  finish(c.id, line_noise);
  return campaign;
}

// The same with a rig in this process.
template <class M, class Family>
std::unique_ptr<Campaign<M>> run_campaign(const M& m, const Family& family, const Plan& plan, const CampaignOptions& o,
                                          Record* record, const std::function<void(double)>& progress) {
  return run_campaign(m, family, plan, o, record, progress, PlayHere{});
}

}  // namespace saltus
