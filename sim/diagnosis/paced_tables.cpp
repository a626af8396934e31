// The tables of a diagnosis of a record that a clock paces.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "../format.hpp"
#include "paced.hpp"
#include "sets.hpp"

namespace saltus::diagnosis {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

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

}  // namespace

void list_findings(Diagnosis& d, const Question& q, const Answer& a) {
  for (std::size_t i = 0; i < a.chosen.effects.size() && d.verdict != Verdict::unexplained; ++i) {
    const int c = a.chosen.effects[i];
    const Coefficient& k = q.machine.coefficients[static_cast<std::size_t>(c)];
    if (!k.sine_of.empty()) continue;  // told with the cosine
    const Search::Interval& interval = a.intervals[i];
    Finding f;
    f.name = name_of(q.machine, c);
    f.unit = k.unit;
    f.value = a.chosen.fit.values[static_cast<std::size_t>(c)];
    for (const int other : a.chosen.effects) {
      if (q.machine.coefficients[static_cast<std::size_t>(other)].sine_of != f.name) continue;
      const double sine = a.chosen.fit.values[static_cast<std::size_t>(other)];
      f.phase = std::atan2(sine, f.value) / (2.0 * std::numbers::pi);
      f.phase -= std::floor(f.phase);
      f.value = std::hypot(f.value, sine);
    }
    f.low = interval.low;
    f.high = interval.high;
    f.declared = k.nominal;
    f.z = interval.sigma > 0.0 ? (f.value - k.nominal) / interval.sigma : 0.0;
    for (const auto& [mine, other] : a.ties) {
      if (mine == c) f.ties.push_back(name_of(q.machine, other));
    }
    if (has(a.doubted, c)) f.ties.push_back("periodic_force");
    d.effects.push_back(std::move(f));
  }
  d.views_after = a.after.views;
}

void list_parameters(Diagnosis& d, const Question& q, const Answer& a) {
  const Fit& last = a.final_fit(d.verdict);
  for (std::size_t k = 0; k < q.machine.declared; ++k) {
    const Coefficient& c = q.machine.coefficients[k];
    if (c.candidate) continue;
    const double tolerance = q.p.tolerance[k];
    const double widened = std::max(q.data.colour, a.before.evidence.inflation);  // as of effects
    const auto error = [&](const Fit& f) {
      const auto i = std::find(f.free.begin(), f.free.end(), static_cast<int>(k)) - f.free.begin();
      return i == static_cast<std::ptrdiff_t>(f.free.size()) ? 0.0 : std::sqrt(f.covariance(i, i) * widened);
    };
    d.parameters.push_back(
        {c.name, c.unit, c.nominal, tolerance, a.refit.values[k], error(a.refit), last.values[k], error(last)});
    const double off = (last.values[k] - c.nominal) / std::max(1e-300, tolerance);
    if (tolerance > 0.0 && std::abs(off) > 3.0) {
      d.notes.push_back("Parameter " + c.name + " lies " + text(std::abs(off), "%.1f") +
                        " tolerances from its declared value: " + text(last.values[k], "%.5g") + " " + c.unit +
                        " instead of " + text(c.nominal, "%.5g") + ".");
    }
  }
}

// Before and after, on all data and on data held out.
void list_errors(Diagnosis& d, const Question& q, const Answer& a, const Search& search) {
  const Fit& last = a.final_fit(d.verdict);
  const Data& data = q.data;
  const auto errors = [&](const Sum& declared, const Sum& refit, const Sum& after) {
    return Errors{normalised(data, declared), normalised(data, refit), normalised(data, after), 1.0};
  };
  const Sum declared = raw_squares(q.p, q.all, q.declared), refit = raw_squares(q.p, q.all, a.refit),
            after = raw_squares(q.p, q.all, last);
  d.all = errors(declared, refit, after);
  for (std::size_t j = 0; j < data.outputs(); ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    const double n = std::max(1.0, declared.count[i]);
    const Channel& o = q.machine.outputs[j];
    d.outputs.push_back({o.name, o.unit, std::sqrt(declared.squares[i] / n), std::sqrt(refit.squares[i] / n),
                         std::sqrt(after.squares[i] / n), data.noise[i]});
  }
  d.expected = expected_chi2(q.p, q.all);
  d.chi2_refit = a.refit.chi2;
  d.chi2_after = last.chi2;

  if (!q.split()) {
    d.heldout = {nan, nan, nan, 1.0};
    d.notes.push_back("Nothing could be held out: the errors are of fitted data only.");
    return;
  }
  for (const int i : q.test) d.held_out.push_back(data.segments[static_cast<std::size_t>(i)].experiment);
  const Fit h_declared = q.predict(q.test, q.declared);
  d.heldout = errors(raw_squares(q.p, q.test, h_declared), raw_squares(q.p, q.test, a.held_refit),
                     raw_squares(q.p, q.test, a.held_after));
  const double n = expected_chi2(q.p, q.test);
  const auto share = [&](double before) {
    const double excess = before - n;
    return excess > 2.0 * std::sqrt(2.0 * n) ? std::clamp(1.0 - (a.held_after.chi2 - n) / excess, -1.0, 1.0) : 0.0;
  };
  d.excess_explained = share(a.held_refit.chi2);
  d.excess_explained_declared = share(h_declared.chi2);
  if (!d.effects.empty() && d.excess_explained < 0.0) {
    d.notes.push_back(
        "No values that the fitted part leaves open predict what was held out better than refitting alone.");
  }
  // Rivals on the same held-out data; if one predicts clearly better, likelihood and prediction disagree: a tie.
  for (const auto& [set, t] : search.pool()) {
    if (d.effects.empty() || set == a.chosen.effects || t.bic > a.chosen.bic + 2.0 * no_telling ||
        !(t.bic > a.chosen.bic + no_telling) || set.size() > a.chosen.effects.size())
      continue;
    if (!(q.on_held_out(t.fit, set).chi2 < a.held_after.chi2 - no_telling)) continue;
    d.notes.push_back("Held-out data prefer " + listed(names_of(q.machine, set)) + ".");
    if (d.verdict == Verdict::effect_found) d.verdict = Verdict::ambiguous;
    if (const auto swap = swapped(a.chosen.effects, set)) {
      for (Finding& f : d.effects) {
        if (f.name == name_of(q.machine, swap->first)) f.ties.push_back(name_of(q.machine, swap->second));
      }
    }
  }
}

// By evidence.
void list_candidates(Diagnosis& d, const Question& q, const Answer& a, const Search& search) {
  const Evidence& e = a.before.evidence;
  std::vector<std::string> hidden;
  for (std::size_t i = 0; i < e.candidate.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const int c = e.candidate[i];
    const Coefficient& own = q.machine.coefficients[static_cast<std::size_t>(c)];
    CandidateRow row{name_of(q.machine, c), own.unit, e.z[k], e.value[k], nan, nan, e.kept[k], 0.0, {}, ""};
    const auto t = search.pool().find({c});
    const bool fitted = t != search.pool().end();
    if (fitted && std::isfinite(t->second.bic)) {
      row.bic = t->second.bic - search.base().bic;
      row.value = t->second.fit.values[static_cast<std::size_t>(c)];
    }
    if (!(e.error[k] > 0.0)) {
      row.remark = "leaves no trace to first order";
    } else if (!e.usable(k)) {
      row.remark = "unidentifiable while " + e.imitated_by[i] + " is free";
    } else {
      row.limit = search.limit_z() * e.error[k];
      const bool holds = d.verdict == Verdict::no_discrepancy || d.verdict == Verdict::parameters_only;
      if (holds && own.changes_charts()) {
        row.clarity = search.clarity(c);
        row.limit = size_seen(row.clarity, search.limit_z());
      }
      if (!may_change(own, e.value[k]) && std::abs(e.z[k]) > search.threshold())
        row.remark = "would need an unphysical sign";
    }
    if (row.remark.empty() && fitted && !std::isfinite(t->second.bic))
      row.remark = t->second.outdone ? "fitted to a part, of which others leave far less" : "fitted, it leaves no less";
    d.candidates.push_back(std::move(row));
  }
  for (const Search::Repeating& r : search.asked()) {
    const Coefficient& own = q.machine.coefficients[static_cast<std::size_t>(r.cosine)];
    const double limit = r.z > 0.0 ? search.limit_z() * r.size / r.z : 0.0;
    CandidateRow row{own.name, own.unit, r.z, r.size, nan, nan, r.kept, limit, {}, "asked when no law explained all"};
    const auto t = search.pool().find(with({r.cosine}, r.sine));
    if (t != search.pool().end() && std::isfinite(t->second.bic)) {
      row.bic = t->second.bic - search.base().bic;
      row.value = std::hypot(t->second.fit.values[static_cast<std::size_t>(r.cosine)],
                             t->second.fit.values[static_cast<std::size_t>(r.sine)]);
    }
    d.candidates.push_back(std::move(row));
    ++d.tried;
  }
  std::sort(d.candidates.begin(), d.candidates.end(), [](const CandidateRow& x, const CandidateRow& y) {
    const bool seen = x.limit > 0.0, other_seen = y.limit > 0.0;
    return seen != other_seen ? seen : std::abs(x.z) > std::abs(y.z);
  });
  for (std::size_t i = 0; i < e.candidate.size(); ++i) {
    if (!e.imitated_by[i].empty() && !e.usable(static_cast<Eigen::Index>(i))) {
      hidden.push_back(name_of(q.machine, e.candidate[i]) + " (" + e.imitated_by[i] + ")");
    }
  }
  if (!hidden.empty()) {
    d.notes.push_back("Unidentifiable here, because declared parameters within their tolerances imitate them: " +
                      listed(hidden) + ".");
  }
}

void list_data(Diagnosis& d, const Question& q) {
  const Data& data = q.data;
  d.repeats = data.repeats;
  d.sections = data.sections;
  d.noise_measured = data.noise_measured;
  d.wandering = data.wandering;
  d.quality = data.quality;
  for (std::size_t j = 0; j < data.outputs(); ++j) {
    d.noise.push_back(data.noise[static_cast<Eigen::Index>(j)]);
    d.output_names.push_back(q.machine.outputs[j].name);
    d.output_units.push_back(q.machine.outputs[j].unit);
  }
  if (data.quality.missing > 0)
    d.notes.push_back(text(static_cast<double>(data.quality.missing), "%.0f") + " values were missing.");
  if (data.quality.outliers > 0) {
    d.notes.push_back(text(static_cast<double>(data.quality.outliers), "%.0f") + " values were left out as outliers.");
  }
  for (std::size_t j = 0; j < data.outputs(); ++j) {
    if (data.quality.resolution[j] > 2.0 * data.noise[static_cast<Eigen::Index>(j)]) {
      d.notes.push_back(q.machine.outputs[j].name + " comes in steps of " + text(data.quality.resolution[j]) + " " +
                        q.machine.outputs[j].unit + ", coarser than its noise.");
    }
  }
  d.notes.insert(d.notes.end(), data.notes.begin(), data.notes.end());
}

}  // namespace saltus::diagnosis
