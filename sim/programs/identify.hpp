// What `saltus identify` makes of one campaign or record, for its tables, files and pictures, and for `saltus demo`.
#pragma once

#include <cstdio>
#include <filesystem>
#include <optional>

#include "../any_stimulus.hpp"
#include "../campaign.hpp"
#include "../eigenvalues.hpp"
#include "../jitter.hpp"
#include "../ladder.hpp"
#include "../multipliers_from_htf.hpp"
#include "../report/htf_figures.hpp"
#include "../transient.hpp"
#include "confidence.hpp"
#include "link.hpp"
#include "plan_options.hpp"
#include "sections.hpp"

namespace saltus::program {

struct IdentifyOptions {
  ModelChoice model;
  SectionChoice sections;
  PlanOptions plan;
  DesignOptions design;
  std::vector<double> ladder;  // [input unit] amplitudes, extrapolated to zero
  CampaignOptions campaign;
  ConfidenceOptions confidence;
  LinkOptions link;
  std::string protocol = "optimal";
  std::string transient = "auto";      // drop, model
  std::string stimulus = "multisine";  // chirp, prbs
  std::int64_t cycles = 400;           // of a chirp or a binary sequence
  bool any = false, distortion = false, coherence = false, correct_jitter = false;
  int multipliers = 2;  // sought in a record of any stimulus
  std::string record, save, csv, json, pictures;
};

// The identification with the model beside it.
struct Identified {
  std::string sections;  // "clock", "kinematic"
  std::string title;     // "isochrons", "kinematic phase"
  std::vector<std::string> outputs, output_units;
  std::vector<std::string> inputs, input_units;
  Identification id;
  bool has_exact = false;
  std::vector<Complex> exact;              // of the linearised model, beside id.htf
  std::vector<Complex> model_multipliers;  // non-zero ones of the model's return map
  std::vector<MultiplierFit> fits;         // of each output: two poles, then image poles where the lines suffice
  MultiplierFit best;
  std::optional<Bounds> rank_bounds;          // of the model's return map
  std::optional<TransientRemoval> transient;  // where some was left by settling
  std::optional<TimingJitter> jitter;         // where repeats tell of it
  std::optional<Ladder> ladder;
  std::optional<AnyStimulusFit> any;  // but for its estimates, which are id

  // Norms over the lines, root of the sum of squares: of H_m exact, of H_m identified, of their difference.
  struct Norms {
    double exact = 0.0, identified = 0.0, error = 0.0, worst = 0.0, largest = 0.0, largest_f = 0.0;
  };
  Norms norms(int m, int output, int input = 0) const;
  // "y_M", or "y_M, u2" where there are several inputs.
  std::string name_of(int output, int input) const {
    const auto of = [](const auto& names, int i) { return names[static_cast<std::size_t>(i)]; };
    return of(outputs, output) + (inputs.size() > 1 ? ", " + of(inputs, input) : "");
  }
};

std::vector<HtfPanel> panels_of(const Identified& id);
std::string csv_of(const Identified& id, bool coherence = false);
// A record of a campaign, without rows.
template <class M>
Record blank_record(const Plan& plan, std::int64_t settle, double period) {
  Record r;
  r.model = M::name;
  r.sections = "clock";
  r.sections_per_cycle = plan.options.sections;
  r.cycle_period = period;
  r.stimulus_period_cycles = plan.options.period;
  r.settle_cycles = static_cast<int>(settle);
  for (const Quantity& q : M::inputs) r.inputs.push_back({std::string(q.name), std::string(q.unit), {}});
  for (const Quantity& q : M::outputs) r.outputs.push_back({std::string(q.name), std::string(q.unit), {}});
  return r;
}
// What every sample tells beyond the lines: takes out a transient of these multipliers, falling in modulus, that
// settling leaves, and finds instants that scatter.
void refine(Identified& r, const Record& record, const IdentifyOptions& o, const std::vector<Complex>& multipliers);
// The nonlinear distortion of an odd stimulus, on the lines that it leaves silent.
void identify_distortion(const IdentifyOptions& o, bool quiet);
// The record of an emulated machine under a chirp or a binary sequence.
Record play_any_stimulus(const IdentifyOptions& o);
nlohmann::json json_of(const Identified& id);
void print_notes(const Identified& id);
void print_errors(const Identified& id);
void print_multipliers(const Identified& id);
void print_standard_errors(const Identified& id);
void write_pictures(const std::string& folder, const std::vector<HtfPanel>& panels, bool quiet = false);
// The hopper of the paper in this process, or a record of one beside its model; compiled once, for it is dear.
Identified identify_hopper(const Hopper<>& m, const ClockPhases& family, const IdentifyOptions& o, const Plan& plan);
Identified identify_hopper(const Hopper<>& m, const KinematicPhases& family, const IdentifyOptions& o,
                           const Plan& plan);
Identified identify_hopper(const Hopper<>& m, const Record& record, const IdentifyOptions& o);
// Figs. 3 and 4 of the paper as a table: paper, computed, identified.
void print_paper_table(const std::vector<Identified>& families);

template <class M>
void describe_channels(Identified& r) {
  for (const Quantity& q : M::outputs) {
    r.outputs.emplace_back(q.name);
    r.output_units.emplace_back(q.unit);
  }
  for (const Quantity& q : M::inputs) {
    r.inputs.emplace_back(q.name);
    r.input_units.emplace_back(q.unit);
  }
}

// Fills in what the model, whose multipliers are there already, says beside what was identified.
template <class M>
void compare(Identified& r, const LdtpOf<M, sections_per_cycle>& system) {
  r.has_exact = r.id.sections == sections_per_cycle;
  r.rank_bounds = rank_bounds(system);
  if (r.has_exact) {
    int line = -1;
    Harmonics<output_count<M>, input_count<M>, sections_per_cycle> h;
    for (const HtfEstimate& e : r.id.htf) {
      if (e.line != line) {
        line = e.line;
        h = htf(system, 2.0 * std::numbers::pi * line / (static_cast<double>(r.id.period) * r.id.sections));
      }
      r.exact.push_back(h(e.m)(e.output, e.input));
    }
  }
  const int count = static_cast<int>(r.model_multipliers.size());
  for (int c = 0; c < output_count<M>; ++c) r.fits.push_back(fit_two_poles(r.id, c));
  for (int c = 0; c < output_count<M>; ++c) {
    MultiplierFit fit = fit_image_poles(r.id, c, count);
    if (usable(fit.status)) r.fits.push_back(fit);
  }
  r.best = best_multipliers(r.id, output_count<M>, count);
}

// Plays the plan to an emulated machine in this process, or to what is `given` to run_campaign to play it to.
template <class M, class Family, class... Play>
Identified identify_rig(const M& m, const Family& family, const IdentifyOptions& o, const Plan& plan, Record* record,
                        Play&&... given) {
  Progress progress(std::string(M::name) + ", " + title_of(family));
  constexpr std::size_t samples_kept = 4'000'000;
  const auto length =
      static_cast<std::size_t>((o.campaign.settle + o.campaign.periods * plan.options.period) * plan.options.sections);
  // Only a transient, or repeats, have more to tell than the lines.
  const bool telling = o.transient != "drop" || o.campaign.periods > 1;
  const bool keep = telling && plan.experiments.size() * length <= samples_kept;
  const std::size_t rungs = std::max<std::size_t>(1, o.ladder.size());
  std::vector<Identification> ids;
  Identified r;
  r.sections = name_of(family);
  r.title = title_of(family);
  describe_channels<M>(r);
  for (std::size_t rung = 0; rung < rungs; ++rung) {
    const Plan played = o.ladder.empty() ? plan : scaled(plan, o.ladder[rung]);
    CampaignOptions options = o.campaign;
    options.seed += 15485863 * rung;
    if (sizeof...(Play) > 0) options.jobs = 1;  // there is one machine
    Record own;
    if (keep && record == nullptr) own = blank_record<M>(plan, o.campaign.settle, timebase_of(m, o.model.ticks).period);
    Record* const kept = record != nullptr ? record : keep ? &own : nullptr;
    const auto campaign = run_campaign(
        m, family, played, options, kept,
        [&](double fraction) { progress.at((static_cast<double>(rung) + fraction) / static_cast<double>(rungs)); },
        given...);
    if (campaign->orbit.status != Status::ok) {
      throw RunError(no_orbit(M::name, campaign->orbit.status, Family::on_grid));
    }
    if (!(campaign->decay < attracting)) {
      throw RunError(std::string(M::name) +
                     ": its limit cycle does not attract, so that no experiment settles (a cycle " + "leaves " +
                     number(campaign->decay) + " of a deviation); change --set");
    }
    if (!usable(campaign->id.worst)) {
      const Status worst = campaign->id.worst;  // failed: far from it, and no status of the machine says why
      throw RunError(std::string(M::name) + ": the machine left its cycle during the campaign" +
                     (worst == Status::failed ? "" : " (" + std::string(name(worst)) + ")") + "; lower --amplitude");
    }
    r.id = std::move(campaign->id);
    r.model_multipliers = nonzero_multipliers(campaign->system.monodromy(0));
    if (kept != nullptr) refine(r, *kept, o, r.model_multipliers);
    if (rungs > 1) ids.push_back(r.id);
    if (rung + 1 < rungs) continue;
    if (rungs > 1) {
      r.ladder = Ladder{o.ladder, {}, 0};
      r.id = extrapolate(ids, *r.ladder);
    }
    compare<M>(r, campaign->system);
  }
  return r;
}

}  // namespace saltus::program
