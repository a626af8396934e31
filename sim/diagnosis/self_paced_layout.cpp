#include <algorithm>
#include <cmath>
#include <limits>

#include "../format.hpp"
#include "self_paced.hpp"

namespace saltus::diagnosis {
namespace {

constexpr std::size_t enough_stretches = 8;
constexpr std::size_t least_fitted = 3;
constexpr double shortest = 0.25;  // [s] of a stretch that was not asked for

}  // namespace

std::vector<int> parts_of(std::size_t stretches) {
  const std::size_t parts = stretches < 16 ? std::min<std::size_t>(8, stretches) : 4;
  std::vector<int> r;
  for (std::size_t i = 0; i < stretches; ++i) r.push_back(static_cast<int>(parts * i / stretches));
  return r;
}

Work lay_out(const Record& record, const Machine& machine, const Options& o, double length, Diagnosis& d) {
  Work w;
  Cut cut;
  cut.length = length;
  cut.skip = touched(record, machine, cut);
  w.p.machine = &machine;
  w.p.data = &w.s.data;
  for (std::size_t i = 0; i < machine.declared; ++i) {
    const Coefficient& c = machine.coefficients[i];
    double tolerance = c.candidate ? 0.0 : (c.uncertainty >= 0.0 ? c.uncertainty : 0.02) * std::abs(c.nominal);
    for (const auto& [key, sigma] : o.tolerance) {
      if (key == c.name) tolerance = sigma;
    }
    w.p.tolerance.push_back(tolerance);
  }
  std::vector<int> still;
  for (;;) {
    w.s = cut_into_stretches(record, machine, cut);
    w.p.h_max = 1.2 * w.s.spacing;
    guess_starts_from_data(w.p, w.s.data, record.name);
    halve_unstable(w.p, w.s, record.name);
    still = standing_still(w.s);
    // A short record, or one in which little moves, is cut finer.
    const bool few = w.s.origin.size() - still.size() < enough_stretches;
    if (!few || length > 0.0 || machine.in_steps || w.s.length < 2.0 * shortest) break;
    cut.length = 0.5 * w.s.length;
  }
  w.sensors = w.s.data.noise;

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
  if (w.train.size() < least_fitted && w.lively.size() >= least_fitted) {
    w.train = w.lively;
    w.test.clear();
    held.clear();
    w.held_from = std::numeric_limits<double>::infinity();
  }
  d.held_out = held;
  if (w.train.size() < least_fitted) {
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
      if (!cut.skip[i] || cut.skip[i - 1]) continue;
      when += (when.empty() ? "" : ", ") + text(record.t[i], "%.2f") + " s";
      if (list.size() > 1) when += " of experiment " + std::to_string(record.experiment[i]);
    }
    d.notes.push_back(text(rows, "%.0f") + " rows around t = " + when +
                      " were left out: a force many times what is missing elsewhere acted there, as if somebody had "
                      "touched the machine.");
  }
  if (w.s.ringing > 0) {
    d.notes.push_back("Impacts are not modelled: " + text(1e3 * cut.exclude, "%.0f") +
                      " ms on either side of an event were left out (" + std::to_string(w.s.ringing) +
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

}  // namespace saltus::diagnosis
