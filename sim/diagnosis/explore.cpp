// The part of the search that fits one set of effects from where it may lead to the best there is: a cost that is
// curved, or has hollows, is entered from several sides.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "pieces.hpp"
#include "search.hpp"
#include "sets.hpp"
#include "setup.hpp"

namespace saltus::diagnosis {

// Segments that show where a fit will end, and the others.
std::pair<std::vector<int>, std::vector<int>> Search::few_and_rest() const {
  const auto middle = segments_.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(3, segments_.size()));
  return {{segments_.begin(), middle}, {middle, segments_.end()}};
}

double Search::cost_on(const std::vector<int>& segments, const Fit& f) const {
  const std::vector<double> each = chi2_of_each(p_, segments, f);
  return std::accumulate(each.begin(), each.end(), f.penalty);
}

// [-] The cost on some segments above which a fit is behind the best of all by more than a few steps make up for. One
// with more effects than one would have to be before it by what they are to take away.
double Search::hopeless_on(const std::vector<int>& segments, bool one_more) const {
  constexpr double slack = 100.0;
  const double lead = segments == segments_ ? best().fit.cost() : cost_on(segments, best().fit);
  const double n = samples_of(segments);
  return lead + slack + (one_more ? -needed_beside(best()) * n / samples_ : 0.1 * std::max(0.0, lead - n));
}

// Where a linear estimate is apt to be trapped far below the truth.
bool Search::curved(int coefficient) const {
  const Coefficient& c = p_.machine->coefficients[static_cast<std::size_t>(coefficient)];
  return c.shifts_time || c.changes_charts() || c.name.find("damper") != std::string::npos;
}

FitOptions Search::briefly_to_beat(const std::vector<int>& segments, bool one_more) const {
  FitOptions o = briefly;
  o.to_beat = hopeless_on(segments, one_more);
  return o;
}

// Not to be fitted to all of the data before a part of it has shown that it may be worth it.
bool Search::dear(const std::vector<int>& set) const {
  return set.size() > 1 || p_.machine->coefficients[static_cast<std::size_t>(set.front())].kinked;
}

// How far from its nominal value to start an effect.
std::vector<double> Search::guesses(int added, double estimate, bool patient) const {
  const Coefficient& c = p_.machine->coefficients[static_cast<std::size_t>(added)];
  if (c.changes_charts()) {
    const auto alone = pool_.find({added});
    if (alone == pool_.end()) return {c.probe, 0.7 * c.probe, 0.1 * c.probe, 10.0 * c.probe, 100.0 * c.probe};
    const double found = alone->second.fit.values[static_cast<std::size_t>(added)] - c.nominal;
    return found > 0.1 * c.probe ? std::vector<double>{found, 0.1 * c.probe}
                                 : std::vector<double>{c.probe, 0.1 * c.probe};
  }
  if (!patient) return {estimate};
  const double turn = p_.machine->cycle_period;
  if (c.shifts_time) return {estimate, 0.09 * turn, 0.01 * turn, 0.03 * turn};
  return {estimate, 10.0 * estimate, 3.0 * estimate};
}

const Trial& Search::explore(const std::vector<int>& from, const Fit& start, int added, double estimate, bool patient,
                             double needed) {
  const std::vector<int> set = with(from, added);
  const auto at = static_cast<std::size_t>(added);
  const Coefficient& c = p_.machine->coefficients[at];
  const auto off_by = [&](double guess) {
    Fit f = start;
    f.values[at] = std::max(c.nominal + guess, lower_bound(c));
    if (c.shifts_time) f.values[at] = std::min(f.values[at], 0.1 * p_.machine->cycle_period);
    return f;
  };
  const std::vector<double> starts = guesses(added, estimate, patient);
  if (starts.size() == 1 && !dear(set))
    return store(
        {set, fit(p_, segments_, off_by(starts[0]), set, briefly_to_beat(segments_, set.size() > 1)), 0.0, false});

  // A few steps from each on part of the data, then from the best on all of it.
  constexpr double hopeless = 1e4;  // [-] times the best so far
  const std::vector<int> part = few_and_rest().first;
  FitOptions brief = briefly;
  if (starts.size() > 1) {
    brief.iterations = 4;
    brief.enough = 1.0;
  } else {
    brief = briefly_to_beat(part, set.size() > 1);
  }
  Fit best = start;
  best.chi2 = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < starts.size(); ++i) {
    Fit f = off_by(starts[i]);
    if (i > 0 && !(cost_on(part, f) < hopeless * best.cost())) continue;
    f = fit(p_, part, f, set, brief);
    // From below and from far above to the same: so would all between.
    const bool same = i == 1 && !c.changes_charts() && std::abs(f.cost() - best.cost()) < 10.0 * brief.enough &&
                      std::abs(f.values[at] - best.values[at]) < 0.05 * std::abs(f.values[at]);
    if (f.cost() < best.cost()) best = std::move(f);
    if (same) break;
  }
  const double gain = c.changes_charts() || needed > 0.0 ? cost_on(part, start) - best.cost() : 0.0;
  // At its nominal value, or worse than without it: it is not there.
  const bool absent = best.values[at] == c.nominal || (c.changes_charts() && !(gain > 0.0));
  const bool useless = needed > 0.0 && gain * samples_ / samples_of(part) < needed;
  return absent || useless ? dismiss(set) : complete(set, best, brief);
}

// Of an effect that changes the charts the cost has small hollows: from larger and smaller values, with all else
// fitted there first, as long as that leads to less.
void Search::step_aside(int added) {
  const std::vector<int> set{added};
  const auto at = static_cast<std::size_t>(added);
  const double nominal = p_.machine->coefficients[at].nominal;
  double wide = 0.1;
  for (int round = 0; round < 4 && wide > 0.04; ++round) {
    const Fit from = pool_.at(set).fit;
    const double explained = base().fit.cost() - from.cost();
    for (const double factor : {1.0 - wide, 1.0 + wide}) {
      Fit f = from;
      f.values[at] = nominal + factor * (from.values[at] - nominal);
      f = fit(p_, segments_, f, {}, briefly);
      if (f.cost() < from.cost() + 0.5 * explained) store({set, fit(p_, segments_, f, set, briefly), 0.0, false});
    }
    if (!(pool_.at(set).fit.cost() < from.cost() - 1.0)) wide *= 0.5;
  }
}

// From a fit to the few segments to one to all, where it is worth it.
const Trial& Search::complete(const std::vector<int>& set, Fit f, FitOptions options) {
  const auto [part, rest] = few_and_rest();
  if (dear(set) && f.cost() > hopeless_on(part, set.size() > 1)) return dismiss(set, true);
  if (!rest.empty()) {  // their starts belong to other values still
    options.refit_parameters = false;
    const Fit moved = fit(p_, rest, f, {}, options);
    if (std::isfinite(moved.chi2)) f.start = moved.start;
  }
  return store({set, fit(p_, segments_, f, set, briefly_to_beat(segments_, set.size() > 1)), 0.0, false});
}

const Trial& Search::dismiss(const std::vector<int>& set, bool outdone) {
  Trial t{set, base().fit, 0.0, false};
  t.outdone = outdone;
  t.fit.chi2 = std::numeric_limits<double>::infinity();
  return store(std::move(t));
}

// A change of gait leaves hollows between the start and the truth. From the value at which short runs fit best, at
// first with the parameters as they are, which would fill the gap with anything.
void Search::grow(int added) {
  const std::vector<int> set{added};
  const auto at = static_cast<std::size_t>(added);
  const auto [part, rest] = few_and_rest();
  Fit f = declared_;
  f.values[at] = p_.machine->coefficients[at].nominal + scan(p_, part, f, added);
  if (!std::isfinite(f.values[at])) return;
  // With fewer of a run's ties than the best without it, it leaves half as much, or will not be it with more.
  const Trial* rival = &base();
  for (const auto& [other, t] : pool_) {
    if (!has(other, added) && t.bic < rival->bic) rival = &t;
  }
  const double samples = samples_of(part);
  const double hopeless = samples + 0.5 * std::max(0.0, cost_on(part, rival->fit) - samples);
  // It may do to move the starts there, all of them: a few alone may draw the value to where the others cannot follow.
  const Fit there = fit(p_, segments_, f, {}, starts_alone);
  if (std::isfinite(there.chi2) && passes(store({set, fit(p_, segments_, there, set), 0.0, true}).fit)) return;
  f = fit_growing(p_, part, f, set, hopeless);
  if (!std::isfinite(f.chi2)) return;
  Fit settled = f;
  if (!rest.empty() && settle_starts(p_, settled)) {
    for (const int s : rest) f.start[static_cast<std::size_t>(s)] = settled.start[static_cast<std::size_t>(s)];
    const Fit grown = fit_growing(p_, segments_, f, set, std::numeric_limits<double>::infinity(), part);
    if (std::isfinite(grown.chi2)) f = grown;
  }
  store({set, fit(p_, segments_, f, set), 0.0, true});
}

// What changes the charts, beside what is there already: its slope at nothing may not show that it is wanted.
void Search::beside(const std::vector<int>& set) {
  const double needed = needed_beside(pool_.at(set));
  for (const int c : judged()) {
    const bool changes = p_.machine->coefficients[static_cast<std::size_t>(c)].changes_charts();
    if (!changes || pool_.count(with(set, c)) > 0 || passes(best().fit)) continue;
    explore(set, pool_.at(set).fit, c, 0.0, true, needed);
  }
}

// From one fit over another and as far again, a few times.
Fit Search::leapt(const Fit& from, const Fit& over) const {
  constexpr double far = 4.0;
  Fit r = over;
  for (const int c : over.free) {
    const auto k = static_cast<std::size_t>(c);
    r.values[k] += far * (over.values[k] - from.values[k]);
    r.values[k] = std::max(r.values[k], lower_bound(p_.machine->coefficients[k]));
  }
  for (const int s : segments_) {
    const auto k = static_cast<std::size_t>(s);
    if (from.start[k].chart != over.start[k].chart) continue;
    for (const int i : p_.machine->free_coordinates(over.start[k].chart)) {
      const auto at = static_cast<std::size_t>(i);
      r.start[k].x[at] += far * (over.start[k].x[at] - from.start[k].x[at]);
    }
  }
  return r;
}

// What a search on some of the samples found, fitted to all of them; searched on only where that is not it.
const Trial& Search::run_from(const Search& smooth, const std::function<void(double)>& progress) {
  constexpr double near = 100.0;  // [-] of BIC
  const double limit = smooth.best().bic + near;
  for (const auto& [set, t] : smooth.pool_) {
    if (t.bic < limit) store({set, fit(p_, segments_, t.fit, set), 0.0, true});
  }
  if (finer_step(p_, best().fit) < p_.h_max) return best();
  if (!passes(best().fit)) return run(progress);
  finish_near(30.0);
  return settle();
}

}  // namespace saltus::diagnosis
