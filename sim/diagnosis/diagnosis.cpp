#include "diagnosis.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "../format.hpp"
#include "core/spectrum/twiddles.hpp"
#include "core/trace/statistics.hpp"
#include "partly_seen.hpp"
#include "pictures.hpp"
#include "search.hpp"
#include "setup.hpp"
#include "story.hpp"

namespace saltus::diagnosis {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

class Clock {
 public:
  explicit Clock(Diagnosis& d) : d_(d) {}
  void lap(const char* what) {
    const auto now = std::chrono::steady_clock::now();
    d_.seconds.emplace_back(what, std::chrono::duration<double>(now - last_).count());
    last_ = now;
  }

 private:
  Diagnosis& d_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

std::string listed(const std::vector<std::string>& names) {
  std::string s;
  for (const auto& n : names) s += (s.empty() ? "" : ", ") + n;
  return s;
}

// Errors over single measurements, outliers left out.
struct Sum {
  Eigen::VectorXd squares, count;  // (outputs) [unit^2]
};
Sum raw_squares(const Problem& p, const std::vector<int>& segments, const Fit& f) {
  const Data& data = *p.data;
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  Sum sum{Eigen::VectorXd::Zero(ny), Eigen::VectorXd::Zero(ny)};
  const auto r = residuals(p, segments, f);
  for (const int index : segments) {
    const Segment& s = data.segments[static_cast<std::size_t>(index)];
    const Eigen::VectorXd& e = r[static_cast<std::size_t>(index)];
    for (Eigen::Index i = 0; i < e.size(); ++i) {
      sum.squares[i % ny] += s.count[i] * e[i] * e[i];
      sum.count[i % ny] += s.count[i];
    }
    sum.squares += s.within;
  }
  return sum;
}
double normalised(const Data& data, const Sum& s) {
  return std::sqrt(s.squares.cwiseQuotient(data.noise.cwiseAbs2()).sum() / std::max(1.0, s.count.sum()));
}

double expected_chi2(const Problem& p, const std::vector<int>& segments) {
  double n = 0.0;
  for (const int index : segments) {
    const Segment& s = p.data->segments[static_cast<std::size_t>(index)];
    n += static_cast<double>((s.count.array() > 0.0).count()) -
         static_cast<double>(p.machine->free_coordinates(s.guess.chart).size());
  }
  return n;
}

// Values fixed, starts free: how well does it predict data it was not fitted to?
Fit predict(const Problem& p, const std::vector<int>& segments, const Fit& f) {
  FitOptions o;
  o.refit_parameters = false;
  return fit(p, segments, f, {}, o);
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
  Diagnosis d;
  Clock clock(d);
  const auto progress = [&](double fraction, const char* what) {
    if (options.progress) options.progress(fraction, what);
  };
  d.record = record.name;
  d.model = machine.name;
  for (const auto& [key, value] : options.set) {
    for (Coefficient& c : machine.coefficients) {
      if (c.name == key) c.nominal = value;
    }
  }
  Data data = prepare(record, machine);
  Problem p;
  p.machine = &machine;
  p.data = &data;
  for (std::size_t i = 0; i < machine.declared; ++i) {
    const Coefficient& c = machine.coefficients[i];
    const bool exact = c.candidate || static_cast<int>(i) == machine.clock;
    double tolerance = exact ? 0.0 : 0.02 * std::abs(c.nominal);
    for (const auto& [key, sigma] : options.tolerance) {
      if (key == c.name) tolerance = sigma;
    }
    p.tolerance.push_back(tolerance);
  }
  double spacing = std::numeric_limits<double>::infinity();
  const Segment& any = data.segments.front();
  for (std::size_t i = 1; i < any.t.size(); ++i) spacing = std::min(spacing, any.t[i] - any.t[i - 1]);
  p.h_max = 0.5 * spacing;
  guess_starts(p, data, record.name);
  refuse_nonsense(p, data, record.name);
  p.h_max = choose_step(p);
  p.h_slope = std::min(spacing, 4.0 * p.h_max);
  clock.lap("reading the record");
  progress(0.02, "fitting the declared model");

  std::vector<int> all;
  for (std::size_t i = 0; i < data.segments.size(); ++i) all.push_back(static_cast<int>(i));
  double rows = 0.0;
  for (const Segment& s : data.segments) rows += static_cast<double>((s.count.array() > 0.0).count());
  const double unknowns = static_cast<double>(machine.declared) + static_cast<double>(all.size()) * machine.starts();
  if (rows < 5.0 * unknowns) {
    throw RecordError(record.name,
                      "it has " + text(rows, "%.0f") + " measurements for " + text(unknowns, "%.0f") + " unknowns",
                      "record for longer");
  }

  std::vector<int> train, test;
  int held = options.holdout < 0 ? std::max(1, static_cast<int>(all.size()) / 3) : options.holdout;
  held = std::min(held, static_cast<int>(all.size()) - 1);
  for (const int i : all) (i + held >= static_cast<int>(all.size()) ? test : train).push_back(i);
  const auto on_held_out = [&](const Fit& f, const std::vector<int>& effects) {
    return predict(p, test, fit(p, train, f, effects));
  };

  // Candidates: effects, and declared parameters said to be exact.
  std::vector<int> candidates;
  for (std::size_t i = 0; i < machine.coefficients.size(); ++i) {
    const Coefficient& c = machine.coefficients[i];
    const bool exact =
        i < machine.declared && !c.candidate && static_cast<int>(i) != machine.clock && p.tolerance[i] == 0.0;
    if (c.candidate && c.profile_of.empty() && wanted(options.candidates, c.name))
      candidates.push_back(static_cast<int>(i));
    if (exact && wanted(options.candidates, "parameter:" + c.name)) candidates.push_back(static_cast<int>(i));
  }
  const auto label = [&](int c) {
    const std::string& n = machine.coefficients[static_cast<std::size_t>(c)].name;
    return c < static_cast<int>(machine.declared) && !machine.coefficients[static_cast<std::size_t>(c)].candidate
               ? "parameter:" + n
               : n;
  };
  const auto names_of = [&](const std::vector<int>& set) {
    std::vector<std::string> r;
    for (const int c : set) r.push_back(label(c));
    return r;
  };
  if (!options.candidates.empty() && candidates.empty()) {
    throw RecordError(record.name, "no candidate has the name " + listed(options.candidates),
                      "leave --candidates out to see them all");
  }

  Fit declared = predict(p, all, declared_fit(p));
  if (!std::isfinite(declared.chi2)) {
    throw RecordError(record.name, "the declared model, driven as recorded, leaves its charts",
                      "record with a smaller amplitude, or correct the model");
  }
  if (!data.noise_measured) {
    // Noise from what the refitted model leaves between neighbours; then once more.
    for (int round = 0; round < 2; ++round) {
      const Fit f = fit(p, all, declared, {});
      noise_from_residuals(data, residuals(p, all, f));
      const auto r = residuals(p, all, f);
      const auto ny = static_cast<Eigen::Index>(data.outputs());
      for (const int index : all) {  // single samples far from both neighbours' residual
        Segment& s = data.segments[static_cast<std::size_t>(index)];
        const auto& e = r[static_cast<std::size_t>(index)];
        for (Eigen::Index i = ny; i + ny < e.size(); ++i) {
          if (s.count[i] > 0.0 && std::abs(e[i] - 0.5 * (e[i - ny] + e[i + ny])) > 8.0 * data.noise[i % ny] &&
              std::abs(e[i] - e[i - ny]) > 6.0 * data.noise[i % ny] &&
              std::abs(e[i] - e[i + ny]) > 6.0 * data.noise[i % ny]) {
            s.count[i] = 0.0;
            ++data.quality.outliers;
          }
        }
      }
      declared = predict(p, all, declared_fit(p));
    }
  }
  Search search(p, all, candidates, options.false_alarm);
  search.baseline(declared);
  clock.lap("refitting the declared parameters");
  progress(0.1, "tracing the residual");
  const Fit refit = search.base().fit;
  const Gate& first = search.base_gate();
  const Evidence& e0 = first.evidence;
  d.threshold = search.threshold();
  d.tried = static_cast<int>(search.candidates().size());
  d.views_declared = views(p, all, declared);
  d.views_refit = first.views;

  Trial chosen = search.base();
  Gate after = first;
  std::vector<Search::Swap> swaps;
  std::vector<Search::Interval> intervals;  // of the effects found
  if (first.passes() && !search.strayed()) {
    bool holds = true;
    for (const View& v : d.views_declared) holds = holds && v.p > 0.1 * options.false_alarm;
    const double gain = (declared.chi2 - refit.cost()) / e0.inflation;
    const double k = static_cast<double>(refit.free.size());
    const double p_shift = k > 0.0 ? fisher_tail(gain / k, k, 1e6) : 1.0;
    d.verdict = holds && p_shift > 0.1 * options.false_alarm ? Verdict::no_discrepancy : Verdict::parameters_only;
  } else {
    chosen = search.run([&](double f) { progress(f, "tracing the residual"); });
    clock.lap("searching for effects");
    for (int round = 0; round < 3 && !chosen.effects.empty(); ++round) {  // a twin may turn out to be the better one
      swaps = search.swap_twins(chosen);
      const Trial& settled = search.settle();
      const bool same = settled.effects == chosen.effects;
      chosen = settled;
      if (same) break;
    }
    after = search.gate(chosen.fit);
    clock.lap("looking for twins");
    bool explained = after.passes();
    const Trial* one = explained ? nullptr : search.leaving_a_trifle();
    if (one != nullptr) {  // one effect that leaves next to nothing rather than several that leave less
      chosen = *one;
      after = search.gate(chosen.fit);
      explained = true;
      d.notes.push_back("What is left is more than noise, though far less than the noise itself and " +
                        text(100.0 * (chosen.fit.chi2 - search.samples()) / (refit.chi2 - search.samples()), "%.1g") +
                        " % of what refitting alone leaves: the law found, or the model's steps, are not exactly the "
                        "machine's.");
    }
    d.verdict = !explained               ? Verdict::unexplained
                : chosen.effects.empty() ? Verdict::parameters_only
                                         : Verdict::effect_found;
    if (d.verdict == Verdict::effect_found) {
      const double before = chosen.fit.cost();
      intervals = search.intervals(chosen);
      if (chosen.fit.cost() < before) after = search.gate(chosen.fit);
      clock.lap("how sure it is");
    }
    // Where the machine wanders, what it does next is no repeat of what was fitted, and chance looks like a cause.
    if (d.verdict == Verdict::effect_found && data.wandering && !test.empty() && !train.empty()) {
      const double n = expected_chi2(p, test), before = on_held_out(refit, {}).chi2 - n;
      if (!(on_held_out(chosen.fit, chosen.effects).chi2 - n < 0.5 * before)) {
        d.verdict = Verdict::unexplained;
        d.notes.push_back("The record tempts to name " + listed(names_of(chosen.effects)) +
                          ", which does not predict what was held out.");
      }
    }
  }

  // Twins and rivals.
  constexpr double close = 6.0;
  std::vector<std::pair<int, int>> ties;  // (effect chosen, its twin)
  for (const Search::Swap& s : swaps) {
    if (std::abs(s.cosine) > 0.9) d.twins.push_back({label(s.from), label(s.to), s.cosine});
  }
  if (d.verdict == Verdict::effect_found) {
    for (const auto& [set, t] : search.pool()) {
      if (set == chosen.effects || t.bic > chosen.bic + 4.0 * close) continue;
      if (std::includes(set.begin(), set.end(), chosen.effects.begin(), chosen.effects.end()))
        continue;  // it and one too many
      d.rivals.push_back({names_of(set), t.bic - chosen.bic});
      if (t.bic > chosen.bic + close) continue;
      std::vector<int> mine, other;
      std::set_difference(chosen.effects.begin(), chosen.effects.end(), set.begin(), set.end(),
                          std::back_inserter(mine));
      std::set_difference(set.begin(), set.end(), chosen.effects.begin(), chosen.effects.end(),
                          std::back_inserter(other));
      bool twins = mine.size() == 1 && other.size() == 1;
      if (twins) {
        ties.emplace_back(mine[0], other[0]);
        twins = false;
        for (const Search::Swap& s : swaps) {
          if (s.from == mine[0] && s.to == other[0] && std::abs(s.cosine) > 0.98) twins = true;
        }
      }
      if (!twins) d.verdict = Verdict::ambiguous;
    }
    std::sort(d.rivals.begin(), d.rivals.end(), [](const Rival& a, const Rival& b) { return a.bic < b.bic; });
  }
  if (d.verdict == Verdict::effect_found) {  // a declared parameter that was said to be exact is not an effect
    bool only = true;
    for (const int c : chosen.effects)
      only = only && c < static_cast<int>(machine.declared) &&
             !machine.coefficients[static_cast<std::size_t>(c)].candidate;
    if (only) d.verdict = Verdict::parameters_only;
  }

  const Fit& final_fit = d.verdict == Verdict::unexplained ? refit : chosen.fit;
  const Fit& best_fit = chosen.fit;
  for (std::size_t i = 0; i < chosen.effects.size() && d.verdict != Verdict::unexplained; ++i) {
    const int c = chosen.effects[i];
    Finding f;
    f.name = label(c);
    f.unit = machine.coefficients[static_cast<std::size_t>(c)].unit;
    f.value = best_fit.values[static_cast<std::size_t>(c)];
    const double sigma = intervals[i].sigma;
    f.low = intervals[i].low;
    f.high = intervals[i].high;
    f.z = sigma > 0.0 ? (f.value - machine.coefficients[static_cast<std::size_t>(c)].nominal) / sigma : 0.0;
    for (const auto& [mine, other] : ties) {
      if (mine == c) f.ties.push_back(label(other));
    }
    d.effects.push_back(std::move(f));
  }
  d.views_after = after.views;

  for (std::size_t k = 0; k < machine.declared; ++k) {
    const Coefficient& c = machine.coefficients[k];
    if (c.candidate) continue;
    ParameterRow row{c.name, c.unit, c.nominal, p.tolerance[k], refit.values[k], 0.0, final_fit.values[k], 0.0};
    const auto error = [&](const Fit& f) {
      const auto at = std::find(f.free.begin(), f.free.end(), static_cast<int>(k));
      if (at == f.free.end()) return 0.0;
      const auto i = at - f.free.begin();
      return std::sqrt(f.covariance(i, i));
    };
    row.refitted_error = error(refit);
    row.with_effect_error = error(final_fit);
    d.parameters.push_back(row);
    const double off = (final_fit.values[k] - c.nominal) / std::max(1e-300, p.tolerance[k]);
    if (p.tolerance[k] > 0.0 && std::abs(off) > 4.0) {
      d.notes.push_back("Parameter " + c.name + " lies " + text(std::abs(off), "%.1f") +
                        " tolerances from its declared value: " + text(final_fit.values[k], "%.5g") + " " + c.unit +
                        " instead of " + text(c.nominal, "%.5g") + ".");
    }
  }

  // Before and after, on all data and on data held out.
  const Sum s_declared = raw_squares(p, all, declared), s_refit = raw_squares(p, all, refit),
            s_after = raw_squares(p, all, final_fit);
  d.all = {normalised(data, s_declared), normalised(data, s_refit), normalised(data, s_after), 1.0};
  for (std::size_t j = 0; j < data.outputs(); ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    const double n = std::max(1.0, s_declared.count[i]);
    d.outputs.push_back({machine.outputs[j].name, machine.outputs[j].unit, std::sqrt(s_declared.squares[i] / n),
                         std::sqrt(s_refit.squares[i] / n), std::sqrt(s_after.squares[i] / n), data.noise[i]});
  }
  d.expected = expected_chi2(p, all);
  d.chi2_refit = refit.chi2;
  d.chi2_after = final_fit.chi2;

  progress(0.8, "predicting what was held out");
  if (!test.empty() && !train.empty()) {
    for (const int i : test) d.held_out.push_back(data.segments[static_cast<std::size_t>(i)].experiment);
    const Fit h_declared = predict(p, test, declared), h_refit = on_held_out(refit, {}),
              h_after = d.effects.empty() ? h_refit : on_held_out(final_fit, chosen.effects);
    d.heldout = {normalised(data, raw_squares(p, test, h_declared)), normalised(data, raw_squares(p, test, h_refit)),
                 normalised(data, raw_squares(p, test, h_after)), 1.0};
    const double n = expected_chi2(p, test);
    const auto share = [&](double before) {
      const double excess = before - n;
      return excess > 2.0 * std::sqrt(2.0 * n) ? std::min(1.0, 1.0 - (h_after.chi2 - n) / excess) : 0.0;
    };
    d.excess_explained = share(h_refit.chi2);
    d.excess_explained_declared = share(h_declared.chi2);
    // Rivals on the same held-out data; if one predicts clearly better, likelihood and prediction disagree: a tie.
    for (const auto& [set, t] : search.pool()) {
      if (d.effects.empty() || set == chosen.effects || t.bic > chosen.bic + 2.0 * close ||
          set.size() > chosen.effects.size())
        continue;
      const Fit h = on_held_out(t.fit, set);
      if (h.chi2 < h_after.chi2 - close && t.bic > chosen.bic + close) {
        d.notes.push_back("Held-out data prefer " + listed(names_of(set)) + ".");
        if (d.verdict == Verdict::effect_found) d.verdict = Verdict::ambiguous;
      }
    }
  } else {
    d.heldout = {nan, nan, nan, 1.0};
    d.notes.push_back("Nothing could be held out: the errors are of fitted data only.");
  }
  clock.lap("predicting held-out data");

  // The list of candidates, by evidence.
  for (std::size_t i = 0; i < e0.candidate.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const int c = e0.candidate[i];
    const Coefficient& q = machine.coefficients[static_cast<std::size_t>(c)];
    CandidateRow row{label(c), q.unit, e0.z[k], e0.value[k], nan, nan, e0.kept[k], 0.0, ""};
    if (const auto t = search.pool().find({c}); t != search.pool().end()) {
      row.bic = t->second.bic - search.base().bic;
      row.value = t->second.fit.values[static_cast<std::size_t>(c)];
    }
    if (!(e0.error[k] > 0.0)) {
      row.remark = "leaves no trace to first order";
    } else if (!e0.usable(k)) {
      row.remark = "unidentifiable while " + e0.imitated_by[i] + " is free";
    } else {
      row.limit = (search.threshold() + 1.645) * e0.error[k];
      if (!search.physical(c, e0.z[k]) && std::abs(e0.z[k]) > search.threshold())
        row.remark = "would need an unphysical sign";
    }
    d.candidates.push_back(std::move(row));
  }
  std::sort(d.candidates.begin(), d.candidates.end(), [](const CandidateRow& a, const CandidateRow& b) {
    const bool ua = a.limit > 0.0, ub = b.limit > 0.0;
    if (ua != ub) return ua;
    return std::abs(a.z) > std::abs(b.z);
  });
  std::vector<std::string> hidden;
  for (std::size_t i = 0; i < e0.candidate.size(); ++i) {
    if (!e0.imitated_by[i].empty() && !e0.usable(static_cast<Eigen::Index>(i))) {
      hidden.push_back(label(e0.candidate[i]) + " (" + e0.imitated_by[i] + ")");
    }
  }
  if (!hidden.empty()) {
    d.notes.push_back("Unidentifiable here, because declared parameters within their tolerances imitate them: " +
                      listed(hidden) + ".");
  }

  d.repeats = data.repeats;
  d.experiments = static_cast<int>(experiments(record).size());
  d.sections = data.sections;
  d.noise_measured = data.noise_measured;
  d.quality = data.quality;
  for (std::size_t j = 0; j < data.outputs(); ++j) {
    d.noise.push_back(data.noise[static_cast<Eigen::Index>(j)]);
    d.output_names.push_back(machine.outputs[j].name);
    d.output_units.push_back(machine.outputs[j].unit);
  }
  if (data.quality.missing > 0)
    d.notes.push_back(text(static_cast<double>(data.quality.missing), "%.0f") + " values were missing.");
  if (data.quality.outliers > 0) {
    d.notes.push_back(text(static_cast<double>(data.quality.outliers), "%.0f") + " values were left out as outliers.");
  }
  for (std::size_t j = 0; j < data.outputs(); ++j) {
    if (data.quality.resolution[j] > 2.0 * data.noise[static_cast<Eigen::Index>(j)]) {
      d.notes.push_back(machine.outputs[j].name + " comes in steps of " + text(data.quality.resolution[j]) + " " +
                        machine.outputs[j].unit + ", coarser than its noise.");
    }
  }
  d.notes.insert(d.notes.end(), data.notes.begin(), data.notes.end());

  progress(0.9, "drawing");
  locate(d, p, all, refit);
  draw(d, p, all, declared, refit, final_fit);
  if (!ties.empty() || d.verdict == Verdict::ambiguous) d.separate = separating_experiment(d, p, all, search, chosen);
  clock.lap("locating and drawing");
  tell(d);
  progress(1.0, "done");
  return d;
}

}  // namespace saltus::diagnosis
