// What a fitted machine predicts of a record that no clock paces.
#include <algorithm>
#include <cmath>

#include "../format.hpp"
#include "self_paced.hpp"

namespace saltus::diagnosis {

namespace {

// Each from where it is, and from its own samples by these values: the declared ones may have led to a start that these
// do not find back from.
Fit with_best_starts(const Work& w, const std::vector<int>& segments, const Fit& values) {
  constexpr FitOptions options{.refit_parameters = false, .iterations = 10};
  Fit f = values;
  for (const int k : segments) {
    const auto at = static_cast<std::size_t>(k);
    Fit best = fit(w.p, {k}, values, {}, options);
    if (const auto start = start_from_data(w.p, w.s.data.segments[at], values.values)) {
      Fit other = values;
      other.start[at] = *start;
      other = fit(w.p, {k}, other, {}, options);
      if (other.chi2 < best.chi2) best = std::move(other);
    }
    f.start[at] = best.start[at];
  }
  return f;
}

}  // namespace

Misfit misfit(const Work& w, const std::vector<int>& segments, const Fit& values) {
  const auto ny = w.sensors.size();
  Misfit m{0.0, 0.0, Eigen::VectorXd::Zero(ny), Eigen::VectorXd::Zero(ny)};
  const Fit f = with_best_starts(w, segments, values);
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

bool run_free(Diagnosis& d, const Record& record, const Work& w, double horizon, bool held, const Compared& values,
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
    return false;  // nothing that long
  }
  Problem p = w.p;
  p.data = &s.data;
  s.data.noise = w.sensors;
  std::vector<int> which;
  for (std::size_t k = 0; k < s.origin.size(); ++k) {
    const bool out = std::find(d.held_out.begin(), d.held_out.end(), s.origin[k].experiment) != d.held_out.end();
    if (std::isfinite(w.held_from) || out == held) which.push_back(static_cast<int>(k));
  }
  if (which.empty()) return false;
  FreeRun f = free_runs(p, which, horizon, values.declared, values.refit, values.after,
                        traces ? &d.self_paced.traces : nullptr);
  f.data = held ? "held out" : "fitted";
  if (f.runs == 0) return false;
  d.self_paced.runs.push_back(std::move(f));
  return true;
}

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
      r = " There " + w.p.machine->outputs[static_cast<std::size_t>(j)].name + " moves " +
          format("%.1f", held / fitted) + " times as fast as anywhere in the fitted part.";
  }
  return r;
}

}  // namespace saltus::diagnosis
