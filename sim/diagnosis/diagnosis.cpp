#include "diagnosis.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "../format.hpp"
#include "core/trace/statistics.hpp"
#include "laps.hpp"
#include "paced.hpp"
#include "partly_seen.hpp"
#include "past_events.hpp"
#include "pictures.hpp"
#include "sets.hpp"
#include "setup.hpp"
#include "story.hpp"

namespace saltus::diagnosis {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// The declared model, with its parameters refitted, leaves nothing but noise: did they have to move?
Verdict no_effect(const Diagnosis& d, const Question& q, const Answer& a, double false_alarm) {
  bool holds = true;
  for (const View& v : d.views_declared) holds = holds && v.p > 0.1 * false_alarm;
  double p_shift = q.data.coloured ? chance_of_scores(q.p, q.all, q.declared, a.refit.free) : nan;
  if (std::isnan(p_shift)) {
    const double gain = (q.declared.chi2 - a.refit.cost()) / a.before.evidence.inflation;
    const double k = static_cast<double>(a.refit.free.size());
    p_shift = k > 0.0 ? fisher_tail(gain / k, k, 1e6) : 1.0;
  }
  return holds && p_shift > 0.1 * false_alarm ? Verdict::no_discrepancy : Verdict::parameters_only;
}

// Where the declared model misses far its impacts may be on the wrong side of sections: then away from them first.
Trial searched(const Question& q, Search& search, const Options& options) {
  const auto progress = [&](double f) {
    if (options.progress) options.progress(f, "tracing the residual");
  };
  const auto thin = misses_far(q.p, q.all, search.base().fit) ? without_jumps(q.data) : std::nullopt;
  if (!thin) return search.run(progress);
  Problem away = q.p;
  away.data = &*thin;
  Search smooth(away, q.all, q.candidates, options.false_alarm);
  smooth.baseline(q.declared);
  smooth.run(progress);
  return search.run_from(smooth, progress);
}

// Something is left, and `a` has what the search found: which effects take it away?
Verdict trace(Diagnosis& d, const Question& q, Answer& a, Search& search, Laps& lap) {
  for (int round = 0; round < 3 && !a.chosen.effects.empty(); ++round) {  // a twin may turn out to be the better one
    a.swaps = search.swap_twins(a.chosen);
    const Trial& settled = search.settle();
    const bool same = settled.effects == a.chosen.effects;
    a.chosen = settled;
    if (same) break;
  }
  a.after = search.gate(a.chosen.fit);
  lap("looking for twins");
  bool explained = a.after.passes();
  const Trial* one = explained ? nullptr : search.leaving_a_trifle();
  if (one != nullptr) {  // one effect that leaves next to nothing rather than several that leave less
    a.chosen = *one;
    a.after = search.gate(a.chosen.fit);
    explained = true;
    const double share = (a.chosen.fit.chi2 - search.samples()) / (a.refit.chi2 - search.samples());
    d.notes.push_back("What is left is more than noise, though far less than the noise itself and " +
                      text(100.0 * std::max(0.0, share), "%.1g") +
                      " % of what refitting alone leaves: the law found, or the model's steps, are not exactly the "
                      "machine's.");
  }
  const auto take = [&](const Trial& force) {
    a.chosen = force;
    a.after = search.gate(force.fit);
    a.swaps.clear();
    a.intervals = {search.size_of_force(force)};
  };
  if (!explained) {
    search.ask(q.repeating);
    const Trial* force = search.force();
    lap("asking for a force that repeats with the cycle");
    if (force == nullptr) return Verdict::unexplained;
    take(*force);
    return Verdict::effect_found;
  }
  if (a.chosen.effects.empty()) return Verdict::parameters_only;
  const auto sure = [&] {  // true: a better fit was found on the way
    const double before = a.chosen.fit.cost();
    a.intervals = search.intervals(a.chosen);
    return a.chosen.fit.cost() < before;
  };
  if (sure()) {
    const Trial& settled = search.settle();  // it may need fewer effects
    if (settled.effects != a.chosen.effects && !settled.effects.empty() && search.gate(settled.fit).passes()) {
      a.chosen = settled;
      sure();
    }
    a.after = search.gate(a.chosen.fit);
  }
  if (a.chosen.effects.size() == 1) {
    const auto swaps = search.swap_for_force(a.chosen, q.repeating);
    a.swaps.insert(a.swaps.end(), swaps.begin(), swaps.end());
    const Trial* force = search.force();
    if (force != nullptr && force->bic < a.chosen.bic - no_telling) take(*force);
  }
  lap("how sure it is");
  return Verdict::effect_found;
}

bool is_repeating_force(const Machine& m, const std::vector<int>& effects) {
  return effects.size() == 2 && !m.coefficients[static_cast<std::size_t>(effects[1])].sine_of.empty();
}

// What was held out, predicted. Where the machine wanders, what it does next is no repeat of what was fitted, and
// chance looks like a cause.
Verdict predict_held_out(Diagnosis& d, const Question& q, Answer& a, Verdict v) {
  if (!q.split()) return v;
  bool drawn = false;
  a.held_refit = q.on_held_out(a.refit, {});
  a.held_after = v == Verdict::effect_found ? q.on_held_out(a.chosen.fit, a.chosen.effects, &drawn) : a.held_refit;
  if (drawn) {
    d.notes.push_back(
        "What was held out is followed by values within what the fitted part leaves open, not by its "
        "best ones: the machine's gait turns on small differences of them.");
  }
  // Where noise is correlated in time its chance is hardly known; a correction then shows on what was held out.
  if (v == Verdict::parameters_only && q.data.coloured && a.before.passes() &&
      !(a.held_refit.chi2 < q.predict(q.test, q.declared).chi2))
    v = Verdict::no_discrepancy;
  const double n = expected_chi2(q.p, q.test);
  const bool follows = q.data.wandering ? a.held_after.chi2 - n < 0.5 * (a.held_refit.chi2 - n)
                                        : !is_repeating_force(q.machine, a.chosen.effects) ||
                                              a.held_after.chi2 < a.held_refit.chi2 - no_telling;
  if (v == Verdict::effect_found && !follows) {
    v = Verdict::unexplained;
    a.held_after = a.held_refit;
    d.notes.push_back("The record tempts to name " + listed(names_of(q.machine, a.chosen.effects)) +
                      ", which does not predict what was held out.");
  }
  return v;
}

// Sets of effects that do nearly as well: near twins are ties, others leave the cause open.
Verdict compare_rivals(Diagnosis& d, const Question& q, Answer& a, const Search& search) {
  Verdict v = Verdict::effect_found;
  const std::vector<int>& chosen = a.chosen.effects;
  for (const auto& [set, t] : search.pool()) {
    if (set == chosen || t.bic > a.chosen.bic + 4.0 * no_telling) continue;
    if (std::includes(set.begin(), set.end(), chosen.begin(), chosen.end())) continue;  // it and one too many
    d.rivals.push_back({names_of(q.machine, set), t.bic - a.chosen.bic});
    // A force of two coefficients is no less likely a cause than a law of one.
    const bool force = is_repeating_force(q.machine, set);
    const double behind = force && chosen.size() == 1 ? t.fit.cost() - a.chosen.fit.cost() : t.bic - a.chosen.bic;
    if (behind > no_telling) continue;
    const bool for_force = set.size() == 1 && is_repeating_force(q.machine, chosen);
    const auto swap = force || for_force ? std::pair(chosen[0], set[0]) : swapped(chosen, set);
    bool twins = false;
    if (swap) {
      a.ties.push_back(*swap);
      twins = std::any_of(a.swaps.begin(), a.swaps.end(), [&](const Search::Swap& s) {
        return s.from == swap->first && s.to == swap->second && std::abs(s.cosine) > 0.98;
      });
    }
    if (!twins) v = Verdict::ambiguous;
  }
  std::sort(d.rivals.begin(), d.rivals.end(), [](const Rival& x, const Rival& y) { return x.bic < y.bic; });
  return v;
}

// What only the mean cycle shows, and hardly its shape, may be anything that repeats with it. What acts within the
// machine changes its response to stimuli too; a sensor need not.
Verdict look_beyond_mean_cycle(Diagnosis& d, const Question& q, Answer& a, const Search& search) {
  constexpr double shown = 2.0;  // [-] standard errors
  for (std::size_t i = 0; i < a.chosen.effects.size(); ++i) {
    const int e = a.chosen.effects[i];
    const Coefficient& c = q.machine.coefficients[static_cast<std::size_t>(e)];
    if (q.data.sections == 0 || !c.candidate || c.of_sensor()) continue;
    const double off = std::abs(a.chosen.fit.values[static_cast<std::size_t>(e)] - c.nominal);
    if (off > shaped * a.intervals[i].sigma) continue;
    const double z = search.beyond_mean_cycle(a.chosen, e);
    if (!(z < shown)) continue;
    const std::string effect = name_of(q.machine, e);
    a.doubted.push_back(e);
    d.notes.push_back("The response to stimuli shows " + effect + " by " + text(z, "%.1f") +
                      " standard errors only, the rest is seen in the mean cycle: a force that repeats with the cycle "
                      "(periodic_force) would explain it as well.");
    d.separate = "To tell " + effect + " from a force that repeats with the cycle: stimuli of " +
                 (z > 0.5 ? text(2.0 * shown / z, "%.2g") + " times the amplitude." : "several times the amplitude.");
  }
  return a.doubted.empty() ? Verdict::effect_found : Verdict::ambiguous;
}

// What is found beside a declared parameter far off, and mostly does what parameters do, may be there to make up for
// it: a force of no law at all that parameters imitate badly looks so.
Verdict look_at_parameters(Diagnosis& d, const Question& q, Answer& a) {
  constexpr double far = 3.0, own = 0.5;  // [-] tolerances, and of its signature, that no parameters imitate
  constexpr double clear = 30.0;          // [-] standard errors that no chance likeness makes up for
  const Evidence& e = a.before.evidence;
  const bool is_clear = a.refit.cost() - a.chosen.fit.cost() > clear * clear * std::max(1.0, e.inflation);
  std::vector<int> doubted;
  const std::vector<std::string> astray = off_by_more(q.p, a.chosen.fit, far);
  for (const int c : a.chosen.effects) {
    const auto i = e.find(c);
    if (i >= 0 && e.kept[i] < own) doubted.push_back(c);
  }
  if (is_clear || astray.empty() || doubted.empty()) return d.verdict;
  const std::string parameters = listed(astray);
  d.notes.push_back("Beside " + listed(names_of(q.machine, doubted)) + ", " + parameters +
                    " is far from its declared value: a cause that is no candidate, as a force that "
                    "repeats with the cycle (periodic_force), may have moved both.");
  if (d.separate.empty()) d.separate = "To tell: measure " + parameters + " by itself, and say how well (--tolerance).";
  for (const int c : doubted) {
    if (!has(a.doubted, c)) a.doubted.push_back(c);
  }
  return Verdict::ambiguous;
}

// A declared parameter that was said to be exact is not an effect.
bool parameters_alone(const Machine& machine, const std::vector<int>& effects) {
  return std::all_of(effects.begin(), effects.end(), [&](int c) {
    return c < static_cast<int>(machine.declared) && !machine.coefficients[static_cast<std::size_t>(c)].candidate;
  });
}

Diagnosis diagnose_paced(const Record& record, const Machine& machine, const Options& options, Repeats taken,
                         double longest_step = std::numeric_limits<double>::infinity()) {
  Diagnosis d;
  Laps lap(d);
  const auto progress = [&](double fraction, const char* what) {
    if (options.progress) options.progress(fraction, what);
  };
  d.record = record.name;
  d.model = machine.name;
  d.experiments = static_cast<int>(experiments(record).size());
  const Question q(record, machine, options, taken, longest_step);
  lap("reading the record");
  progress(0.02, "fitting the declared model");

  Search search(q.p, q.all, q.candidates, options.false_alarm);
  search.baseline(q.declared);
  lap("refitting the declared parameters");
  progress(0.1, "tracing the residual");
  Answer a;
  a.refit = search.base().fit;
  a.chosen = search.base();
  a.before = a.after = search.base_gate();
  d.threshold = search.threshold();
  d.tried = static_cast<int>(search.candidates().size());
  d.views_declared = views(q.p, q.all, q.declared);
  d.views_refit = a.before.views;

  const bool nothing_left = a.before.passes() && !search.strayed();
  if (!nothing_left) {
    a.chosen = searched(q, search, options);
    lap("searching for effects");
    // What an effect makes quick, as a lag does to an input that was held, the declared model's steps may pass over.
    const double finer = finer_step(q.p, a.chosen.fit);
    if (finer < q.p.h_max) return diagnose_paced(record, machine, options, taken, finer);
  }
  d.verdict = nothing_left ? no_effect(d, q, a, options.false_alarm) : trace(d, q, a, search, lap);
  progress(0.8, "predicting what was held out");
  d.verdict = predict_held_out(d, q, a, d.verdict);
  for (const Search::Swap& s : a.swaps) {
    if (std::abs(s.cosine) > 0.9) d.twins.push_back({name_of(machine, s.from), name_of(machine, s.to), s.cosine});
  }
  if (d.verdict == Verdict::effect_found) d.verdict = compare_rivals(d, q, a, search);
  if (d.verdict == Verdict::effect_found && parameters_alone(machine, a.chosen.effects))
    d.verdict = Verdict::parameters_only;
  if (d.verdict == Verdict::effect_found) d.verdict = look_beyond_mean_cycle(d, q, a, search);
  if (d.verdict == Verdict::effect_found || d.verdict == Verdict::ambiguous) d.verdict = look_at_parameters(d, q, a);

  list_findings(d, q, a);
  list_parameters(d, q, a);
  list_errors(d, q, a, search);
  lap("predicting held-out data");
  list_candidates(d, q, a, search);
  list_data(d, q);

  progress(0.9, "drawing");
  locate(d, q.p, q.all, a.refit, search.limit_z());
  draw(d, q.p, q.all, q.declared, a.refit, a.final_fit(d.verdict));
  if (d.separate.empty() && (!a.ties.empty() || d.verdict == Verdict::ambiguous))
    d.separate = separating_experiment(d, q.p, q.all, search, a.chosen);
  lap("locating and drawing");
  tell(d);
  progress(1.0, "done");
  return d;
}

}  // namespace

bool wanted(const std::vector<std::string>& patterns, const std::string& name) {
  if (patterns.empty()) return true;
  for (const std::string& p : patterns) {
    if (p == name) return true;
    if (!p.empty() && p.back() == '*' && name.compare(0, p.size() - 1, p, 0, p.size() - 1) == 0) return true;
    if (name.compare(0, p.size() + 1, p + "@") == 0) return true;
  }
  return false;
}

std::string name(Verdict v) {
  switch (v) {
    case Verdict::effect_found:
      return "effect_found";
    case Verdict::no_discrepancy:
      return "no_discrepancy";
    case Verdict::parameters_only:
      return "parameters_only";
    case Verdict::ambiguous:
      return "ambiguous";
    case Verdict::unexplained:
      return "unexplained";
  }
  return "";
}

void declare(Machine& machine, const Options& options) {
  for (const auto& [key, value] : options.set) {
    for (Coefficient& c : machine.coefficients) {
      if (c.name == key) c.nominal = value;
    }
  }
}

Diagnosis diagnose(const Record& record, Machine& machine, const Options& options) {
  if (const auto seen = as_recorded(machine, record)) {
    Diagnosis some = diagnose(record, *seen, options);
    std::vector<std::string> unseen;
    for (const Channel& o : machine.outputs) {
      if (std::find(some.output_names.begin(), some.output_names.end(), o.name) == some.output_names.end())
        unseen.push_back(o.name);
    }
    some.notes.push_back("The record has no " + listed(unseen) + ": what the model says of it is not compared.");
    return some;
  }
  if (!machine.has_clock) return diagnose_self_paced(record, machine, options);
  declare(machine, options);
  Diagnosis mean = diagnose_paced(record, machine, options, Repeats::averaged);
  if (mean.verdict != Verdict::unexplained || !mean.wandering) return mean;
  try {
    Diagnosis first = diagnose_paced(record, machine, options, Repeats::first_alone);
    return first.verdict == Verdict::unexplained ? mean : first;
  } catch (const RecordError&) {  // too short for that
    return mean;
  }
}

}  // namespace saltus::diagnosis
