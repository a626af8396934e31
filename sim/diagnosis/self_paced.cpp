// Closing the loop on a machine that paces itself, or on none at all: a walker, a pendulum, a leg on a bench.
#include "self_paced.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "../format.hpp"
#include "core/trace/statistics.hpp"
#include "laps.hpp"
#include "selection.hpp"
#include "spikes.hpp"
#include "story.hpp"

namespace saltus::diagnosis {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr double no_worse = 1.1;         // [-] of the error of predicting what was left out
constexpr double clearly_better = 0.75;  // [-] of the free runs' error: an output is explained
const std::string no_run = "it is too short, or everywhere an error of the start grows more than twentyfold.";
constexpr double noise_like = 1.5;    // [-] of the sensors' noise: nothing is missing
constexpr double quiet_enough = 1.2;  // [-] of the sensors' noise
constexpr double surely = 1.5;        // [-] times the threshold: a score that no chance leaves

bool is_candidate(const Machine& m, std::size_t i, const std::vector<double>& tolerance,
                  const std::vector<std::string>& patterns) {
  const Coefficient& c = m.coefficients[i];
  const bool exact = i < m.declared && !c.candidate && tolerance[i] == 0.0 && c.nominal != 0.0;
  const bool effect = c.candidate && c.profile_of.empty() && c.name != "clock_offset";
  // A parameter is a candidate only where it is asked for by name.
  if (exact) return std::find(patterns.begin(), patterns.end(), "parameter:" + c.name) != patterns.end();
  return effect && wanted(patterns, c.name);
}

// Laws of one port are of one kind, and so is what may be wrong with an input, or with a sensor: which of them it is
// matters less than that it is one of them. Of two kinds it is only where nothing can tell them apart, as a constant
// force and a bias of the input.
bool same_kind(const std::string& a, const std::string& b) {
  const auto kind = [](const std::string& name) {
    if (name.rfind("input_", 0) == 0) return std::string("input");
    if (name.rfind("sensor_", 0) == 0) return std::string("sensor");
    return name.substr(std::min(name.size(), name.find('@')));
  };
  return kind(a) == kind(b);
}

// Of the length asked for, or of half of it, and half again, where the part is shorter or cannot be foreseen so long.
bool longest_free_run(Diagnosis& d, const Record& record, const Work& w, double horizon, bool held,
                      const Compared& values, bool traces) {
  for (double length = horizon; length > 0.1 * horizon; length *= 0.5) {
    if (run_free(d, record, w, length, held, values, traces)) return true;
  }
  return false;
}

// Of the length asked for, or what is usual: across a step, or a swing.
double horizon_of(const Work& w, const Options& o) {
  return o.horizon > 0.0 ? o.horizon : w.p.machine->in_steps ? w.s.length : 4.0;  // [s]
}

// Error of free runs over the fitted part with a set of effects, over what it is with another: of the usual run and of
// all together, of all outputs.
double free_run_ratio(const Diagnosis& d, const Record& record, const Work& w, double horizon, const Attempt& a,
                      const Attempt& over) {
  Diagnosis runs;
  runs.held_out = d.held_out;
  if (!longest_free_run(runs, record, w, horizon, false, {over.fit.values, over.fit.values, a.fit.values}, false))
    return nan;
  const FreeRun& r = runs.self_paced.runs.front();
  double ratio = 1.0;
  for (std::size_t j = 0; j < r.after.size(); ++j)
    ratio *= std::sqrt(r.median_after[j] / r.median_refit[j] * r.after[j] / r.refit[j]);
  return ratio;
}

// The candidate, of either sign, along which most is left, if that is more than chance leaves; else -1.
int loudest(const Evidence& e, double threshold) {
  Eigen::Index most = -1;
  for (Eigen::Index i = 0; i < e.z.size(); ++i) {
    if (!e.usable(i) || !(std::abs(e.z[i]) > surely * threshold)) continue;
    if (most < 0 || std::abs(e.z[i]) > std::abs(e.z[most])) most = i;
  }
  return static_cast<int>(most);
}

// Where all but noise is said to be explained, nothing may be left along any candidate, nor may declared parameters be
// far off: a cause that is no candidate would look so.
void doubt(Diagnosis& d, const Work& w, const Found& f, bool quiet) {
  constexpr double far = 5.0;  // [-] tolerances
  const Machine& machine = *w.p.machine;
  const int i = quiet ? loudest(f.left, d.threshold) : -1;
  if (i >= 0) {
    d.verdict = Verdict::unexplained;
    d.notes.push_back("What is left is small, but no noise: along " +
                      name_of(machine, f.left.candidate[static_cast<std::size_t>(i)]) + " it scores " +
                      text(f.left.z[i], "%.1f") + ", and chance leaves " + text(d.threshold, "%.1f") + ".");
  }
  const std::vector<std::string> astray = off_by_more(w.p, f.part.fit, far);
  if (f.part.effects.empty() || astray.empty()) return;
  d.verdict = Verdict::unexplained;
  d.notes.push_back("Nearest came " + listed(names_of(machine, f.part.effects)) + ", but only beside " +
                    listed(astray) +
                    " far from what is declared: a cause that is no candidate would look so, and so would columns "
                    "in other units or of other sign. If declared values are not known that well, say so with "
                    "--tolerance.");
}

// The verdict. `scale`: mean square of what the refitted model leaves; `gain`: of refitting, in -2 log likelihood.
void judge(Diagnosis& d, const Work& w, const Found& f, double scale_refit, double gain, double false_alarm) {
  const std::vector<int>& effects = f.part.effects;
  const bool quiet = std::sqrt(scale_refit) < noise_like && !(d.heldout.refit > noise_like);
  d.self_paced.explained.assign(w.s.data.outputs(), false);
  if (!d.self_paced.runs.empty()) {
    const FreeRun& r = d.self_paced.runs.front();
    for (std::size_t j = 0; j < r.after.size(); ++j) {
      // Of the usual run and of all together: a few that cannot be predicted spoil only the latter.
      const double usual = r.median_after[j] / r.median_refit[j], all = r.after[j] / r.refit[j];
      d.self_paced.explained[j] = usual * all < clearly_better * clearly_better;
    }
  }
  const bool any = std::count(d.self_paced.explained.begin(), d.self_paced.explained.end(), true) > 0;
  if (!effects.empty()) {
    // Each has predicted, part by part, what it was not fitted to. The last part may lie outside of what was fitted.
    const double ratio = d.heldout.after / d.heldout.refit;
    const bool told = !d.self_paced.runs.empty() && d.self_paced.runs.front().data == "held out";
    bool worse = false;
    if (told) {  // one output clearly worse, and no other better by as much: it does not predict
      const FreeRun& r = d.self_paced.runs.front();
      std::size_t j = 0;
      double all = 1.0;
      for (std::size_t k = 0; k < r.after.size(); ++k) {
        const double one = r.after[k] / r.refit[k];
        all *= one;
        if (one > r.after[j] / r.refit[j]) j = k;
      }
      worse = r.after[j] > 1.1 * r.refit[j] && (!any || all > 1.1);
      if (worse)
        d.notes.push_back("What was found makes free runs of " + w.p.machine->outputs[j].name +
                          " over the held-out part worse, and those of no output better by as much.");
    }
    const bool predicted = told && any && !worse;
    const double enough = d.heldout.after < quiet_enough ? 1.02 : 0.97;  // where noise is nearly all there is
    const bool improves = w.test.empty() || (predicted && ratio < no_worse) || (ratio < enough && !worse);
    d.verdict = improves ? Verdict::effect_found : Verdict::unexplained;
    if (!improves && !worse)
      d.notes.push_back("On the held-out part what was found does not help: error " + text(d.heldout.refit) +
                        " refitted, " + text(d.heldout.after) + " with it, in units of the noise." + outside(w));
  } else if (quiet) {
    const auto k = static_cast<double>(f.refit.free.size());
    const bool moved = k > 0.0 && fisher_tail(gain / k, k, 1e6) < 0.1 * false_alarm;
    d.verdict = moved ? Verdict::parameters_only : Verdict::no_discrepancy;
  } else {
    d.verdict = Verdict::unexplained;
  }
  doubt(d, w, f, quiet || d.heldout.after < quiet_enough);
}

// The effects with their intervals and ties.
void list_findings(Diagnosis& d, const Work& w, const Found& found) {
  const Machine& machine = *w.p.machine;
  for (std::size_t i = 0; i < found.part.effects.size() && d.verdict != Verdict::unexplained; ++i) {
    const int c = found.part.effects[i];
    const auto k = static_cast<std::size_t>(c);
    const auto at = std::find(found.all.fit.free.begin(), found.all.fit.free.end(), c) - found.all.fit.free.begin();
    Finding f;
    f.name = name_of(machine, c);
    f.unit = machine.coefficients[k].unit;
    f.value = found.all.fit.values[k];
    const double sigma = std::max(found.error[at], std::sqrt(std::max(0.0, found.all.fit.covariance(at, at))));
    f.low = f.value - wide_95 * sigma;
    f.high = f.value + wide_95 * sigma;
    f.declared = machine.coefficients[k].nominal;
    f.z = sigma > 0.0 ? (f.value - f.declared) / sigma : 0.0;
    for (const Selection::Tie& t : found.ties) {
      if (t.from != c) continue;
      if (std::abs(t.cosine) > 0.9) d.twins.push_back({name_of(machine, t.from), name_of(machine, t.to), t.cosine});
      std::vector<int> set;
      for (const int e : found.part.effects) set.push_back(e == t.from ? t.to : e);
      if (t.above < 4.0 * no_telling && std::abs(t.cosine) < 0.999) d.self_paced.doubt = true;
      if (t.above < 4.0 * no_telling) d.rivals.push_back({names_of(machine, set), t.above, t.predicted});
      if (t.above > no_telling) continue;
      f.ties.push_back(name_of(machine, t.to));
      if (std::abs(t.cosine) < (same_kind(f.name, f.ties.back()) ? 0.8 : 0.999)) d.verdict = Verdict::ambiguous;
    }
    d.effects.push_back(std::move(f));
  }
  std::sort(d.rivals.begin(), d.rivals.end(), [](const Rival& a, const Rival& b) { return a.bic < b.bic; });
}

// `spikes`: how many were taken out of the record. `length`: of the stretches [s], 0: chosen by the record.
Diagnosis look(const Record& record, std::size_t spikes, const Machine& machine, const Options& options,
               double length) {
  Diagnosis d;
  Laps lap(d);
  const auto progress = [&](double fraction, const char* what) {
    if (options.progress) options.progress(fraction, what);
  };
  d.record = record.name;
  d.model = machine.name;
  d.experiments = static_cast<int>(experiments(record).size());
  Work w = lay_out(record, machine, options, length, d);
  Data& data = w.s.data;
  const Problem& p = w.p;
  std::vector<int> candidates;
  for (std::size_t i = 0; i < machine.coefficients.size(); ++i) {
    if (is_candidate(machine, i, p.tolerance, options.candidates)) candidates.push_back(static_cast<int>(i));
  }
  if (candidates.empty())
    throw RecordError(record.name, "no candidate has such a name", "leave --candidates out to see them all");
  lap("reading the record");
  progress(0.02, "fitting the declared model");

  // Where there are some there are others that the record alone does not show.
  std::size_t far = 0;
  for (int round = 0; round < 3 && spikes > 0; ++round) {
    const std::size_t more =
        leave_out_far(data, w.lively, residuals(p, w.lively, fit(p, w.lively, declared_fit(p), {}, starts_alone)));
    far += more;
    if (more == 0) break;
  }

  const std::vector<int> blocks = parts_of(w.train.size());
  Selection search(p, data, w.train, blocks, candidates, options.false_alarm);
  const Fit declared = declared_fit(p);
  search.baseline(declared);
  lap("refitting the declared parameters");
  const double horizon = horizon_of(w, options);
  search.run([&](double f) { progress(f, "tracing the residual"); },
             [&](int c, const Attempt& a, int over, const Attempt& with) {
               const bool alike = same_kind(name_of(machine, c), name_of(machine, over));
               return alike ? free_run_ratio(d, record, w, horizon, a, with) : nan;
             });
  Found f;
  f.refit = search.base().fit;
  f.part = search.result();
  f.ties = search.ties();
  // Of two nearly alike the first to be tried may have been the less likely; not where free runs have decided.
  const auto& account = search.account();
  const auto by_free_runs = [&](int effect) {
    return std::any_of(account.begin(), account.end(),
                       [&](const Trial1& t) { return t.taken && t.effect == effect && t.instead >= 0; });
  };
  for (int round = 0; round < 3; ++round) {
    const auto better = std::find_if(f.ties.begin(), f.ties.end(), [&](const Selection::Tie& t) {
      return t.above < -no_telling && t.predicted < 1.0 && !by_free_runs(t.from);
    });
    if (better == f.ties.end()) break;
    f.part = search.prefer(*better);
    f.ties = search.ties();
  }
  // Between a drag linear in speed and a quadratic one that the record cannot tell apart, the linear one.
  for (const Selection::Tie& t : f.ties) {
    const std::string law = name_of(machine, t.from), other = name_of(machine, t.to);
    if (!law.starts_with("quadratic_drag@") || !other.starts_with("viscous_") || !same_kind(law, other)) continue;
    if (t.above > no_telling || !(t.predicted < no_worse)) continue;
    f.part = search.prefer(t);
    f.ties = search.ties();
    break;
  }
  f.left = search.evidence_of(f.part);
  f.before = search.base_evidence();
  f.alone = search.alone();
  d.threshold = search.threshold();
  d.tried = static_cast<int>(candidates.size());
  d.self_paced.independent = f.part.independent;
  lap("searching for effects");

  // Everything once more on all of the data, for the values; what is said of held-out data is of the fit without them.
  progress(0.75, "estimating jointly");
  const std::vector<int> all_blocks = parts_of(w.lively.size());
  for (bool again = true; again;) {
    again = false;
    data.noise = w.sensors;
    Selection joint(p, data, w.lively, all_blocks, candidates, options.false_alarm);
    f.all = joint.adopt(f.part);
    f.error = joint.errors(f.all);
    f.all_refit = joint.base().fit;
    f.refit_error = joint.errors(joint.base());
    for (const int c : f.part.effects) {  // what all of the record cannot tell from nothing is not claimed
      const auto at = std::find(f.all.fit.free.begin(), f.all.fit.free.end(), c) - f.all.fit.free.begin();
      const auto k = static_cast<std::size_t>(c);
      if (std::abs(f.all.fit.values[k] - machine.coefficients[k].nominal) > wide_95 * f.error[at]) continue;
      d.notes.push_back(name_of(machine, c) +
                        " was found in the fitted part but not in all of the record, and is not claimed.");
      f.part = search.drop(c);
      f.ties = search.ties();
      again = true;
      break;  // f.part is another now
    }
  }
  for (const Trial1& t : search.account()) {
    d.self_paced.steps.push_back({name_of(machine, t.effect), names_of(machine, t.beside), t.gain, t.predicted,
                                  t.better, t.parts, t.taken,
                                  t.instead < 0 ? std::string() : name_of(machine, t.instead), t.free_run});
  }
  const auto& steps = d.self_paced.steps;
  d.self_paced.doubt = std::any_of(steps.begin(), steps.end(), [](const Step& s) { return !s.taken; });
  lap("estimating jointly");

  data.noise = w.sensors;
  for (Segment& s : data.segments)
    s.count = (s.count.array() > 0.0).select(Eigen::VectorXd::Ones(s.count.size()), 0.0 * s.count);
  progress(0.85, "predicting what was held out");
  const auto errors = [&](const std::vector<int>& segments, Errors& e) {
    const Misfit m[3] = {misfit(w, segments, declared), misfit(w, segments, f.refit), misfit(w, segments, f.part.fit)};
    e = {m[0].error(), m[1].error(), m[2].error(), 1.0};
    return std::array<Misfit, 3>{m[0], m[1], m[2]};
  };
  const auto whole = errors(w.lively, d.all);
  d.chi2_refit = whole[1].squares;
  d.chi2_after = whole[2].squares;
  d.expected = whole[2].n;
  if (!w.test.empty()) {
    const auto held = errors(w.test, d.heldout);
    const auto share = [&](const Misfit& before) {
      return before.squares > before.n ? 1.0 - (held[2].squares - held[2].n) / (before.squares - before.n) : 0.0;
    };
    d.excess_explained = share(held[1]);
    d.excess_explained_declared = share(held[0]);
  } else {
    d.heldout = {nan, nan, nan, 1.0};
    d.notes.push_back("Nothing could be held out: the errors are of fitted data only.");
  }
  for (std::size_t j = 0; j < data.outputs(); ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    const auto rms = [&](const Misfit& m) { return std::sqrt(m.raw[i] / std::max(1.0, m.count[i])); };
    d.outputs.push_back(
        {machine.outputs[j].name, machine.outputs[j].unit, rms(whole[0]), rms(whole[1]), rms(whole[2]), w.sensors[i]});
    d.noise.push_back(w.sensors[i]);
    d.output_names.push_back(machine.outputs[j].name);
    d.output_units.push_back(machine.outputs[j].unit);
  }
  if (!w.test.empty()) {
    const Compared values{declared.values, f.refit.values, f.part.fit.values};
    const bool told = longest_free_run(d, record, w, horizon, true, values, true);
    if (!told) d.notes.push_back("No free run over the held-out part is told: " + no_run);
    const double rest = w.s.origin.back().end - w.held_from;
    if (std::isfinite(w.held_from) && rest > 1.5 * horizon) {
      run_free(d, record, w, rest - 2.0 * w.s.spacing, true, values, false);
    }
  }
  const Compared of_all{declared.values, f.all_refit.values, f.all.fit.values};
  const bool told = longest_free_run(d, record, w, horizon, false, of_all, d.self_paced.traces.empty());
  if (!told) d.notes.push_back("No free run over the fitted part is told: " + no_run);
  lap("running free");

  judge(d, w, f, search.base().scale,
        f.part.independent * std::log(whole[0].squares / std::max(1e-300, whole[1].squares)), options.false_alarm);
  list_findings(d, w, f);
  list_parameters(d, w, f);
  list_candidates(d, w, f);
  d.quality = data.quality;
  d.quality.outliers = spikes + far;
  d.quality.missing -= std::min(d.quality.missing, spikes);
  if (d.quality.missing > 0) d.notes.push_back(std::to_string(d.quality.missing) + " values were missing.");
  if (spikes > 0)
    d.notes.push_back(std::to_string(spikes + far) +
                      " single values far from their neighbours were left out as outliers.");
  d.notes.insert(d.notes.end(), data.notes.begin(), data.notes.end());
  tell_self_paced(d);
  progress(1.0, "done");
  return d;
}

// Whether one of two diagnoses that name the same effects, or none, is the surer of them.
bool surer(const Diagnosis& one, const Diagnosis& other) {
  if (one.effects.size() != other.effects.size()) return false;
  double narrower = 0.0;
  for (const Finding& f : one.effects) {
    const auto same = std::find_if(other.effects.begin(), other.effects.end(), [&](const Finding& o) {
      return o.name == f.name || std::count(o.ties.begin(), o.ties.end(), f.name) > 0;
    });
    if (same == other.effects.end()) return false;
    narrower += std::log((same->high - same->low) / (f.high - f.low));
  }
  return narrower > 0.0;
}

}  // namespace

// Where nothing but noise is left a longer stretch, whose start is one unknown as well, tells more: what a law does
// adds up along it. Where the model itself errs, that adds up too, and short stretches are all that can be believed.
// Of a machine in steps the longest is a step: what is found in parts of steps and does not explain whole ones is not
// it.
Diagnosis diagnose_self_paced(const Record& measured, Machine& machine, const Options& options) {
  constexpr int most_times = 16, parts_of_a_step = 4, most_looks = 2;
  constexpr std::size_t most_rows = 16000;  // a longer record tells enough as it is, and a second look takes as long
  declare(machine, options);
  Record record = measured;
  const std::size_t spikes = take_out_spikes(record);
  Diagnosis d = look(record, spikes, machine, options, options.stretch);
  if (options.stretch > 0.0 || !(d.all.after < noise_like) || record.rows() > most_rows) return d;
  if (!machine.in_steps && !d.effects.empty() && !d.self_paced.doubt) return d;
  const auto count = [&](double length) {
    Cut cut;
    cut.length = length;
    return cut_into_stretches(record, machine, cut).origin.size();
  };
  int looks = 0;
  for (int times = machine.in_steps ? parts_of_a_step : most_times; times > 1 && looks < most_looks; times /= 2) {
    const double length = times * d.self_paced.stretch;
    try {
      if (machine.in_steps && count(length) == count(d.self_paced.stretch)) break;
      Diagnosis longer = look(record, spikes, machine, options, length);
      ++looks;
      if (!std::isfinite(longer.heldout.after)) continue;
      const bool explained = longer.verdict != Verdict::unexplained;
      const bool as_good = longer.all.after < no_worse * d.all.after && explained;
      const bool refuted = machine.in_steps && !explained && !d.effects.empty();
      if (refuted || (as_good && !surer(d, longer))) return longer;
    } catch (const RecordError&) {  // too few are that long
    }
  }
  return d;
}

}  // namespace saltus::diagnosis
