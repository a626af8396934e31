// Closing the loop on a machine that paces itself, or on none at all: a walker, a pendulum, a leg on a bench.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <numeric>

#include "../format.hpp"
#include "diagnosis.hpp"
#include "selection.hpp"
#include "story.hpp"

namespace saltus::diagnosis {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr double close = 6.0;            // [-] BIC: no telling
constexpr double clearly_better = 0.75;  // [-] of the free runs' error: an output is explained
constexpr double noise_like = 1.5;       // [-] of the sensors' noise: nothing is missing

std::string text(double x, const char* pattern = "%.4g") { return format(pattern, x); }

// What is asked of a record, and what it is split into.
struct Work {
  Stretches s;
  Problem p;
  Eigen::VectorXd sensors;
  std::vector<int> train, test, lively;  // without the stretches in which nothing moves
  double held_from = 0.0;                // [s], where one experiment is split
};

bool is_candidate(const Machine& m, std::size_t i, const std::vector<double>& tolerance,
                  const std::vector<std::string>& patterns) {
  const Coefficient& c = m.coefficients[i];
  const bool exact = i < m.declared && !c.candidate && tolerance[i] == 0.0 && c.nominal != 0.0;
  const bool effect = c.candidate && c.profile_of.empty() && c.name != "clock_offset";
  // A parameter is a candidate only where it is asked for by name.
  if (exact) return std::find(patterns.begin(), patterns.end(), "parameter:" + c.name) != patterns.end();
  return effect && wanted(patterns, c.name);
}

Work lay_out(const Record& record, const Machine& machine, const Options& o, Diagnosis& d) {
  Work w;
  Cut cut;
  cut.length = o.stretch;
  cut.skip = touched(record, machine, cut);
  w.s = cut_into_stretches(record, machine, cut);
  w.p.machine = &machine;
  w.p.data = &w.s.data;
  w.p.h_max = 1.2 * w.s.spacing;
  for (std::size_t i = 0; i < machine.declared; ++i) {
    const Coefficient& c = machine.coefficients[i];
    double tolerance = c.candidate ? 0.0 : (c.uncertainty >= 0.0 ? c.uncertainty : 0.02) * std::abs(c.nominal);
    for (const auto& [key, sigma] : o.tolerance) {
      if (key == c.name) tolerance = sigma;
    }
    w.p.tolerance.push_back(tolerance);
  }
  guess_starts_from_data(w.p, w.s.data, record.name);
  halve_unstable(w.p, w.s, record.name);
  w.sensors = w.s.data.noise;
  const std::vector<int> still = standing_still(w.s);

  // The last experiments are held out, or the last part of the only one.
  const auto list = experiments(record);
  std::vector<int> held;
  double from = std::numeric_limits<double>::infinity();
  if (list.size() > 1 && o.holdout_share < 0.0) {
    const int n = static_cast<int>(list.size());
    const int out = std::min(n - 1, o.holdout < 0 ? std::max(1, n / 3) : o.holdout);
    for (int i = n - out; i < n; ++i) held.push_back(list[static_cast<std::size_t>(i)].id);
  } else {
    const double share = o.holdout == 0 ? 0.0 : o.holdout_share >= 0.0 ? o.holdout_share : 1.0 / 3.0;
    std::vector<double> begins;  // of the stretches in which something moves
    for (std::size_t k = 0; k < w.s.origin.size(); ++k) {
      if (!std::binary_search(still.begin(), still.end(), static_cast<int>(k))) begins.push_back(w.s.origin[k].begin);
    }
    const auto out = static_cast<std::size_t>(std::lround(share * static_cast<double>(begins.size())));
    if (out > 0 && out < begins.size()) from = begins[begins.size() - out];
  }
  w.held_from = from;
  for (std::size_t k = 0; k < w.s.origin.size(); ++k) {
    const int i = static_cast<int>(k);
    if (std::binary_search(still.begin(), still.end(), i)) continue;
    const Origin& at = w.s.origin[k];
    const bool out = std::find(held.begin(), held.end(), at.experiment) != held.end() || at.begin >= from;
    if (!out && at.end > from) continue;  // astride
    (out ? w.test : w.train).push_back(i);
    w.lively.push_back(i);
  }
  d.held_out = held;
  if (w.train.size() < 4) {
    throw RecordError(record.name,
                      "only " + std::to_string(w.train.size()) + " stretches in which something moves are left to fit",
                      "record for longer, hold out less, or cut it shorter with --stretch");
  }
  d.self_paced = {true,
                  w.s.length,
                  w.s.spacing,
                  w.s.jitter,
                  static_cast<int>(w.s.origin.size()),
                  static_cast<int>(still.size()),
                  static_cast<int>(w.train.size()),
                  0.0,
                  {},
                  {},
                  {},
                  {}};

  const auto rows = static_cast<double>(std::count(cut.skip.begin(), cut.skip.end(), true));
  if (rows > 0.0) {
    std::string when;
    for (std::size_t i = 1; i < cut.skip.size(); ++i) {
      if (cut.skip[i] && !cut.skip[i - 1]) when += (when.empty() ? "" : ", ") + text(record.t[i], "%.2f");
    }
    d.notes.push_back(text(rows, "%.0f") + " rows around t = " + when +
                      " s were left out: a force many times what is missing elsewhere acted there, as if somebody had "
                      "touched the machine.");
  }
  if (w.s.ringing > 0) {
    d.notes.push_back("Impacts are not modelled: " + text(1e3 * cut.exclude, "%.0f") +
                      " ms on either side of a change of chart were left out (" + std::to_string(w.s.ringing) +
                      " rows), where the structure rings, and every step starts anew.");
  }
  if (!still.empty()) {
    d.notes.push_back(std::to_string(still.size()) + " of " + std::to_string(w.s.origin.size()) +
                      " stretches were left out because hardly anything moved in them.");
  }
  if (w.s.jitter > 0.01)
    d.notes.push_back("Time stamps jitter by up to " + text(100.0 * w.s.jitter, "%.0f") +
                      " % of the spacing; they are taken as they are.");
  d.notes.push_back(
      "Nothing repeats, so the sensors' noise is what neighbouring samples differ by, and at least their resolution.");
  return w;
}

// Squares in units of the sensors' noise, and raw, on stretches whose starts are fitted.
struct Misfit {
  double squares = 0.0, n = 0.0;
  Eigen::VectorXd raw, count;
  double error() const { return std::sqrt(squares / std::max(1.0, n)); }
};
Misfit misfit(const Work& w, const std::vector<int>& segments, const Fit& values) {
  FitOptions o;
  o.refit_parameters = false;
  o.iterations = 10;
  const auto ny = w.sensors.size();
  Misfit m{0.0, 0.0, Eigen::VectorXd::Zero(ny), Eigen::VectorXd::Zero(ny)};
  const Fit f = fit(w.p, segments, values, {}, o);
  const auto r = residuals(w.p, segments, f);
  for (const int k : segments) {
    const auto& e = r[static_cast<std::size_t>(k)];
    const Segment& s = w.s.data.segments[static_cast<std::size_t>(k)];
    for (Eigen::Index i = 0; i < e.size(); ++i) {
      if (!(s.count[i] > 0.0)) continue;
      const double x = e[i] / w.sensors[i % ny];
      m.squares += x * x;
      m.raw[i % ny] += e[i] * e[i];
      m.count[i % ny] += 1.0;
      m.n += 1.0;
    }
    m.n -= static_cast<double>(s.guess.x.size());
  }
  return m;
}

// Free runs of one length over the held-out part, or over the fitted one.
void run_free(Diagnosis& d, const Record& record, const Work& w, double horizon, bool held,
              const std::vector<double>& declared, const std::vector<double>& refit, const std::vector<double>& after,
              bool traces) {
  Cut cut;
  cut.length = horizon;
  cut.exact = true;
  cut.skip = touched(record, *w.p.machine, cut);
  if (std::isfinite(w.held_from)) {  // windows begin where the held-out part does
    if (cut.skip.empty()) cut.skip.assign(record.rows(), false);
    for (std::size_t i = 0; i < record.rows(); ++i) {
      if ((record.t[i] >= w.held_from) != held) cut.skip[i] = true;
    }
  }
  Stretches s;
  try {
    s = cut_into_stretches(record, *w.p.machine, cut);
  } catch (const RecordError&) {
    return;  // nothing that long
  }
  Problem p = w.p;
  p.data = &s.data;
  s.data.noise = w.sensors;
  std::vector<int> which;
  for (std::size_t k = 0; k < s.origin.size(); ++k) {
    const bool out = std::find(d.held_out.begin(), d.held_out.end(), s.origin[k].experiment) != d.held_out.end();
    if (std::isfinite(w.held_from) || out == held) which.push_back(static_cast<int>(k));
  }
  if (which.empty()) return;
  FreeRun f = free_runs(p, which, horizon, declared, refit, after, traces ? &d.self_paced.traces : nullptr);
  f.data = held ? "held out" : "fitted";
  d.self_paced.runs.push_back(std::move(f));
}

// Where the held-out part goes beyond what was fitted.
std::string outside(const Work& w) {
  const auto ny = w.sensors.size();
  std::string r;
  for (Eigen::Index j = 0; j < ny; ++j) {
    const auto widest = [&](const std::vector<int>& segments) {
      double m = 0.0;  // of one stretch, from its first sample
      for (const int k : segments) {
        const Segment& s = w.s.data.segments[static_cast<std::size_t>(k)];
        for (Eigen::Index i = j; i < s.y.size(); i += ny)
          m = std::max(m, std::abs(s.y[i] - s.y[j]) / (s.t.back() - s.t[s.first]));
      }
      return m;
    };
    const double fitted = widest(w.train), held = widest(w.test);
    if (held > 1.2 * fitted)
      r = " There " + w.p.machine->outputs[static_cast<std::size_t>(j)].name + " moves " + text(held / fitted, "%.1f") +
          " times as fast as anywhere in the fitted part.";
  }
  return r;
}

}  // namespace

Diagnosis diagnose_self_paced(const Record& record, Machine& machine, const Options& options) {
  Diagnosis d;
  auto last = std::chrono::steady_clock::now();
  const auto lap = [&](const char* what) {
    const auto now = std::chrono::steady_clock::now();
    d.seconds.emplace_back(what, std::chrono::duration<double>(now - last).count());
    last = now;
  };
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
  Work w = lay_out(record, machine, options, d);
  Data& data = w.s.data;
  const Problem& p = w.p;
  const auto name_of = [&](int c) {
    const auto k = static_cast<std::size_t>(c);
    return (k < machine.declared && !machine.coefficients[k].candidate ? "parameter:" : "") +
           machine.coefficients[k].name;
  };
  const auto names_of = [&](const std::vector<int>& set) {
    std::vector<std::string> r;
    for (const int c : set) r.push_back(name_of(c));
    return r;
  };
  std::vector<int> candidates;
  for (std::size_t i = 0; i < machine.coefficients.size(); ++i) {
    if (is_candidate(machine, i, p.tolerance, options.candidates)) candidates.push_back(static_cast<int>(i));
  }
  if (candidates.empty())
    throw RecordError(record.name, "no candidate has such a name", "leave --candidates out to see them all");
  lap("reading the record");
  progress(0.02, "fitting the declared model");

  // Parts that are left out in turn: experiments, or quarters.
  std::vector<int> blocks;
  for (std::size_t i = 0; i < w.train.size(); ++i) blocks.push_back(static_cast<int>(4 * i / w.train.size()));
  Selection search(p, data, w.train, blocks, candidates, options.false_alarm);
  const Fit declared = declared_fit(p);
  search.baseline(declared);
  lap("refitting the declared parameters");
  search.run([&](double f) { progress(f, "tracing the residual"); });
  const Fit refit = search.base().fit;
  const Attempt found = search.result();
  const auto ties = search.ties();
  const Evidence left = search.evidence_of(found), e0 = search.base_evidence();
  d.threshold = search.threshold();
  d.tried = static_cast<int>(candidates.size());
  d.self_paced.independent = found.independent;
  for (const Trial1& t : search.account()) {
    d.self_paced.steps.push_back(
        {name_of(t.effect), names_of(t.beside), t.gain, t.predicted, t.better, t.parts, t.taken});
  }
  lap("searching for effects");

  // Everything once more on all of the data, for the values; what is said of held-out data is of the fit without them.
  progress(0.75, "estimating jointly");
  std::vector<int> all_blocks;
  for (std::size_t i = 0; i < w.lively.size(); ++i) all_blocks.push_back(static_cast<int>(4 * i / w.lively.size()));
  data.noise = w.sensors;
  Selection joint(p, data, w.lively, all_blocks, candidates, options.false_alarm);
  const Attempt all = joint.adopt(found);
  const Eigen::VectorXd error = joint.errors(all);
  const Fit all_refit = joint.base().fit;
  const Eigen::VectorXd refit_error = joint.errors(joint.base());
  lap("estimating jointly");

  data.noise = w.sensors;
  for (Segment& s : data.segments)
    s.count = (s.count.array() > 0.0).select(Eigen::VectorXd::Ones(s.count.size()), 0.0 * s.count);
  progress(0.85, "predicting what was held out");
  const auto errors = [&](const std::vector<int>& segments, Errors& e) {
    const Misfit m[3] = {misfit(w, segments, declared), misfit(w, segments, refit), misfit(w, segments, found.fit)};
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
  const bool steps = record.chart_names.size() > 1;
  const double horizon = options.horizon > 0.0 ? options.horizon : steps ? 0.2 : 4.0;
  if (!w.test.empty()) {
    run_free(d, record, w, horizon, true, declared.values, refit.values, found.fit.values, true);
    const double rest = w.s.origin.back().end - w.held_from;
    if (std::isfinite(w.held_from) && rest > 1.5 * horizon) {
      run_free(d, record, w, rest - 2.0 * w.s.spacing, true, declared.values, refit.values, found.fit.values, false);
    }
  }
  run_free(d, record, w, horizon, false, declared.values, all_refit.values, all.fit.values, w.test.empty());
  lap("running free");

  // The verdict.
  const std::vector<int>& effects = found.effects;
  const bool quiet = std::sqrt(search.base().scale) < noise_like;
  d.self_paced.explained.assign(data.outputs(), false);
  for (const FreeRun& f : d.self_paced.runs) {
    for (std::size_t j = 0; j < f.after.size(); ++j) {
      const bool better =
          f.median_after[j] < clearly_better * f.median_refit[j] || f.after[j] < clearly_better * f.refit[j];
      if (&f == &d.self_paced.runs.front()) d.self_paced.explained[j] = better;
    }
  }
  const bool any = std::count(d.self_paced.explained.begin(), d.self_paced.explained.end(), true) > 0;
  if (!effects.empty()) {
    // Each has predicted, part by part, what it was not fitted to. The last part may lie outside of what was fitted.
    const double ratio = d.heldout.after / d.heldout.refit;
    const bool predicted = any && d.self_paced.runs.front().data == "held out";
    const bool improves = w.test.empty() || predicted || ratio < 0.97;
    d.verdict = improves || ratio < 1.5 ? Verdict::effect_found : Verdict::unexplained;
    if (!improves)
      d.notes.push_back("On the held-out part what was found does not help: error " + text(d.heldout.refit) +
                        " refitted, " + text(d.heldout.after) + " with it, in units of the noise." + outside(w));
  } else if (quiet) {
    const double gain = d.self_paced.independent * std::log(whole[0].squares / std::max(1e-300, whole[1].squares));
    d.verdict = gain > d.threshold * d.threshold ? Verdict::parameters_only : Verdict::no_discrepancy;
  } else {
    d.verdict = Verdict::unexplained;
  }
  for (std::size_t i = 0; i < effects.size() && d.verdict != Verdict::unexplained; ++i) {
    const int c = effects[i];
    const auto k = static_cast<std::size_t>(c);
    const auto at = std::find(all.fit.free.begin(), all.fit.free.end(), c) - all.fit.free.begin();
    Finding f;
    f.name = name_of(c);
    f.unit = machine.coefficients[k].unit;
    f.value = all.fit.values[k];
    const double sigma = std::max(error[at], std::sqrt(std::max(0.0, all.fit.covariance(at, at))));
    f.low = f.value - 1.96 * sigma;
    f.high = f.value + 1.96 * sigma;
    f.z = sigma > 0.0 ? (f.value - machine.coefficients[k].nominal) / sigma : 0.0;
    for (const Selection::Tie& t : ties) {
      if (t.from != c) continue;
      if (std::abs(t.cosine) > 0.9) d.twins.push_back({name_of(t.from), name_of(t.to), t.cosine});
      std::vector<int> set;
      for (const int e : effects) set.push_back(e == t.from ? t.to : e);
      if (t.above < 4.0 * close) d.rivals.push_back({names_of(set), t.above});
      if (t.above > close) continue;
      f.ties.push_back(name_of(t.to));
      if (std::abs(t.cosine) < 0.8) d.verdict = Verdict::ambiguous;
    }
    d.effects.push_back(std::move(f));
  }
  std::sort(d.rivals.begin(), d.rivals.end(), [](const Rival& a, const Rival& b) { return a.bic < b.bic; });

  for (std::size_t k = 0; k < machine.declared; ++k) {
    const Coefficient& c = machine.coefficients[k];
    if (c.candidate) continue;
    const Fit& last_fit = d.effects.empty() ? all_refit : all.fit;
    const auto error_of = [&](const Fit& f, const Eigen::VectorXd& sigma) {
      const auto at = std::find(f.free.begin(), f.free.end(), static_cast<int>(k));
      return at == f.free.end() ? 0.0 : sigma[at - f.free.begin()];
    };
    d.parameters.push_back({c.name, c.unit, c.nominal, p.tolerance[k], all_refit.values[k],
                            error_of(all_refit, refit_error), last_fit.values[k],
                            error_of(last_fit, d.effects.empty() ? refit_error : error)});
    const double off = (last_fit.values[k] - c.nominal) / std::max(1e-300, p.tolerance[k]);
    if (p.tolerance[k] > 0.0 && std::abs(off) > 3.0) {
      d.notes.push_back("Parameter " + c.name + " lies " + text(std::abs(off), "%.1f") +
                        " tolerances from its declared value: " + text(last_fit.values[k], "%.5g") + " " + c.unit +
                        " instead of " + text(c.nominal, "%.5g") + ".");
    }
  }
  for (std::size_t i = 0; i < e0.candidate.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const int c = e0.candidate[i];
    CandidateRow row{name_of(c), machine.coefficients[static_cast<std::size_t>(c)].unit,
                     e0.z[k],    e0.value[k],
                     nan,        nan,
                     e0.kept[k], 0.0,
                     ""};
    if (const auto t = search.alone().find(c); t != search.alone().end()) {
      row.bic = t->second.first;
      row.value = t->second.second;
    }
    if (!(e0.error[k] > 0.0)) {
      row.remark = "leaves no trace to first order";
    } else if (!e0.usable(k)) {
      row.remark = "unidentifiable while " + e0.imitated_by[i] + " is free";
    } else {
      row.limit = (d.threshold + 1.645) * e0.error[k];
    }
    const auto j = left.find(c);
    if (j >= 0 && left.usable(j) && left.z[j] < -d.threshold && !search.physical(c, left.z[j])) {
      row.remark = "what is left asks for an unphysical sign";
      d.notes.push_back(row.name + ": what is left would be smaller with " + text(left.value[j]) + " " + row.unit +
                        " (score " + text(left.z[j], "%.1f") +
                        "), a sign that makes no physical sense. Not taken; the model errs in some other way there.");
    }
    d.candidates.push_back(std::move(row));
  }
  std::sort(d.candidates.begin(), d.candidates.end(), [](const CandidateRow& a, const CandidateRow& b) {
    const bool ua = a.limit > 0.0, ub = b.limit > 0.0;
    return ua != ub ? ua : std::abs(a.z) > std::abs(b.z);
  });
  d.experiments = static_cast<int>(experiments(record).size());
  d.quality = data.quality;
  if (data.quality.missing > 0) d.notes.push_back(std::to_string(data.quality.missing) + " values were missing.");
  d.notes.insert(d.notes.end(), data.notes.begin(), data.notes.end());
  tell_self_paced(d);
  progress(1.0, "done");
  return d;
}

}  // namespace saltus::diagnosis
