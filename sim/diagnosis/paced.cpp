#include "paced.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "../format.hpp"
#include "core/random.hpp"
#include "setup.hpp"

namespace saltus::diagnosis {
namespace {

// Noise from what the refitted model leaves between neighbours, and single samples left out that are far from both
// neighbours' residual.
void noise_without_repeats(const Question& q, Data& data, const Fit& declared) {
  const auto r = residuals(q.p, q.all, fit(q.p, q.all, declared, {}));
  noise_from_residuals(data, r);
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  for (const int index : q.all) {
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
}

}  // namespace

double expected_chi2(const Problem& p, const std::vector<int>& segments) {
  double n = 0.0;
  for (const int index : segments) {
    const Segment& s = p.data->segments[static_cast<std::size_t>(index)];
    n += s.measured() - static_cast<double>(p.machine->free_coordinates(s.guess.chart).size());
  }
  return n;
}

Fit Question::predict(const std::vector<int>& segments, const Fit& f) const {
  return fit(p, segments, f, {}, starts_alone);
}

// Where the charts change, what the fitted part leaves open of the values may decide which gait the machine is led
// into. What follows best then stands for all that the fitted part allows.
Fit Question::on_held_out(const Fit& f, const std::vector<int>& effects, bool* drawn) const {
  constexpr int draws = 24;
  const Fit fitted = fit(p, train, f, effects);
  Fit best = predict(test, fitted);
  const bool charts_change = std::any_of(effects.begin(), effects.end(), [&](int e) {
    return machine.coefficients[static_cast<std::size_t>(e)].changes_charts();
  });
  if (!charts_change) return best;
  const double enough = 1.1 * expected_chi2(p, test);
  Random random(1);
  for (int draw = 0; draw < draws && !(best.chi2 < enough); ++draw) {
    const Fit there = predict(test, drawn_values(p, fitted, random));
    if (!(there.chi2 < best.chi2)) continue;
    best = there;
    if (drawn != nullptr) *drawn = true;
  }
  return best;
}

Question::Question(const Record& record, const Machine& m, const Options& options, Repeats taken, double longest_step)
    : machine(m), data(prepare(record, m, taken)) {
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
  p.h_max = std::min(choose_step(p, declared_fit(p)), longest_step);
  p.h_slope = std::min(spacing, 4.0 * p.h_max);

  for (std::size_t i = 0; i < data.segments.size(); ++i) all.push_back(static_cast<int>(i));
  const double rows = data.measured();
  const double unknowns = static_cast<double>(machine.declared) + static_cast<double>(all.size()) * machine.starts();
  if (rows < 5.0 * unknowns) {
    throw RecordError(record.name,
                      "it has " + text(rows, "%.0f") + " measurements for " + text(unknowns, "%.0f") + " unknowns",
                      "record for longer");
  }
  const int whole = static_cast<int>(all.size());
  const int held = std::min(options.holdout < 0 ? std::max(1, whole / 3) : options.holdout, whole - 1);
  for (const int i : all) (i + held >= whole ? test : train).push_back(i);

  // Effects, and declared parameters said to be exact.
  for (std::size_t i = 0; i < machine.coefficients.size(); ++i) {
    const Coefficient& c = machine.coefficients[i];
    const bool exact =
        i < machine.declared && !c.candidate && static_cast<int>(i) != machine.clock && p.tolerance[i] == 0.0;
    const bool effect = c.candidate && c.profile_of.empty();
    if ((effect || exact) && wanted(options.candidates, name_of(machine, static_cast<int>(i))))
      candidates.push_back(static_cast<int>(i));
  }
  for (std::size_t i = 0; i < machine.coefficients.size(); ++i) {
    const std::string& cosine = machine.coefficients[i].sine_of;
    if (cosine.empty() || !wanted(options.candidates, cosine)) continue;
    const auto first = std::find_if(machine.coefficients.begin(), machine.coefficients.end(),
                                    [&](const Coefficient& c) { return c.name == cosine; });
    repeating.push_back({static_cast<int>(first - machine.coefficients.begin()), static_cast<int>(i)});
  }
  if (!options.candidates.empty() && candidates.empty() && repeating.empty()) {
    throw RecordError(record.name, "no candidate has the name " + listed(options.candidates),
                      "leave --candidates out to see them all");
  }

  declared = predict(all, declared_fit(p));
  if (!std::isfinite(declared.chi2)) {
    throw RecordError(record.name, "the declared model, driven as recorded, leaves its charts",
                      "record with a smaller amplitude, or correct the model");
  }
  for (int round = 0; round < 2 && !data.noise_measured; ++round) {
    noise_without_repeats(*this, data, declared);
    declared = predict(all, declared_fit(p));
  }
  if (data.coloured) {
    std::vector<int> parameters;
    for (std::size_t i = 0; i < machine.declared; ++i) {
      if (p.tolerance[i] > 0.0) parameters.push_back(static_cast<int>(i));
    }
    p.widened = widening_along(p, all, declared, parameters);
  }
}

}  // namespace saltus::diagnosis
