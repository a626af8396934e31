// The part of the search that says how sure a value is: by profile likelihood, for costs of events and frictions are
// not parabolas.
#include <algorithm>
#include <cmath>

#include "search.hpp"
#include "sets.hpp"

namespace saltus::diagnosis {

// From the end of the interval that the curvature at the best tells, outward while the cost, all else refitted, has not
// risen by what 95 % allow. Not inward: where a cost is kinked a fit may stop early and seem to rise too much.
std::vector<Search::Interval> Search::intervals(Trial& t) {
  for (int round = 0;; ++round) {
    std::vector<Interval> all;
    bool better = false;
    for (const int c : t.effects) {
      const auto k = static_cast<std::size_t>(c);
      const double value = t.fit.values[k], scale = std::max(p_.data->colour, inflation_);
      const auto at = std::find(t.fit.free.begin(), t.fit.free.end(), c) - t.fit.free.begin();
      const double sigma = std::sqrt(t.fit.covariance(at, at) * scale), allowed = wide_95 * wide_95 * scale;
      Interval interval{value, value, sigma};
      for (const double side : {-1.0, 1.0}) {
        double reach = wide_95 * sigma;
        for (int step = 0; step < 4 && !better; ++step) {
          double& end = side < 0.0 ? interval.low : interval.high;
          end = value + side * reach;
          if (end <= lower_bound(p_.machine->coefficients[k])) break;
          Fit f = t.fit;
          f.values[k] = end;
          f = fit(p_, segments_, f, without(t.effects, c));
          const double rise = f.cost() - t.fit.cost();
          if (!std::isfinite(rise)) break;
          if (rise < -1.0 && round < 2) {
            const Trial found{t.effects, fit(p_, segments_, f, t.effects), 0.0, true};
            better = found.fit.cost() < t.fit.cost() - 1.0;
            if (better) t = store(found);
          }
          if (rise > 0.8 * allowed) break;
          reach *= std::min(2.0, std::sqrt(allowed / std::max(rise, 0.25 * allowed)));
        }
      }
      all.push_back(interval);
      if (better) break;
    }
    if (!better) return all;
  }
}

}  // namespace saltus::diagnosis
