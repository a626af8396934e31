// The part of the search that asks whether another cause does the same: in the place of one effect, or of two.
#include <Eigen/Core>

#include <algorithm>
#include <cmath>

#include "search.hpp"
#include "sets.hpp"

namespace saltus::diagnosis {

// Two effects together may be one: a clock set off and an input delayed by the same are a sensor's delay. To first
// order at the pair every other candidate is asked how much of what the two do it does alone; the closest are fitted.
void Search::unite(const Trial& t) {
  const Trial pair = t;
  const int a = pair.effects[0], b = pair.effects[1];
  const auto nominal = [&](int c) { return p_.machine->coefficients[static_cast<std::size_t>(c)].nominal; };
  const auto change = [&](int c) { return pair.fit.values[static_cast<std::size_t>(c)] - nominal(c); };
  const Fit f = with_fixed(with_fixed(pair.fit, a), b);
  const Evidence v = among(weigh(p_, segments_, f, released(released(signatures_at(pair.fit), a), b)), candidates_);
  const auto i = v.find(a), j = v.find(b);
  if (i < 0 || j < 0) return;
  const Eigen::Vector2d x(change(a), change(b));
  const double done =
      x[0] * x[0] * v.information(i, i) + 2.0 * x[0] * x[1] * v.information(i, j) + x[1] * x[1] * v.information(j, j);
  struct Single {
    int c;
    double start, left;
  };
  std::vector<Single> singles;
  for (std::size_t k = 0; k < v.candidate.size(); ++k) {
    const auto l = static_cast<Eigen::Index>(k);
    const int c = v.candidate[k];
    if (c == a || c == b || !(v.information(l, l) > 0.0)) continue;
    const double start = (x[0] * v.information(i, l) + x[1] * v.information(j, l)) / v.information(l, l);
    if (!may_change(*p_.machine, c, start)) continue;
    singles.push_back({c, start, done - start * start * v.information(l, l)});
  }
  std::sort(singles.begin(), singles.end(), [](const Single& s, const Single& o) { return s.left < o.left; });
  for (std::size_t k = 0; k < singles.size() && k < 2; ++k) {
    const Single& s = singles[k];
    if (s.left > std::max(100.0, 0.1 * done)) break;
    Fit g = pair.fit;
    g.values[static_cast<std::size_t>(a)] = nominal(a);
    g.values[static_cast<std::size_t>(b)] = nominal(b);
    g.values[static_cast<std::size_t>(s.c)] = nominal(s.c) + s.start;
    store({{s.c}, fit(p_, segments_, g, {s.c}), 0.0, true});
  }
}

std::vector<Search::Swap> Search::swap_twins(const Trial& chosen) {
  std::vector<Swap> swaps;
  const Trial best_trial = chosen;
  for (const int e : best_trial.effects) {
    const Fit f = with_fixed(best_trial.fit, e);
    const Evidence v = among(weigh(p_, segments_, f, released(signatures_at(best_trial.fit), e)), candidates_);
    const auto i = v.find(e);
    if (i < 0 || !(v.error[i] > 0.0)) continue;
    const double value = best_trial.fit.values[static_cast<std::size_t>(e)] -
                         p_.machine->coefficients[static_cast<std::size_t>(e)].nominal;
    const double z2 = value * value / (v.error[i] * v.error[i]);
    struct Other {
      int c;
      double cosine, start, loss;
    };
    std::vector<Other> others;
    for (std::size_t k = 0; k < v.candidate.size(); ++k) {
      const auto j = static_cast<Eigen::Index>(k);
      const int c = v.candidate[k];
      if (c == e || !v.usable(j)) continue;
      const double cosine = v.cosine(i, j);
      if (std::find(best_trial.effects.begin(), best_trial.effects.end(), c) != best_trial.effects.end()) continue;
      const double start = value * v.information(i, j) / v.information(j, j);
      if (!may_change(*p_.machine, c, start)) continue;
      others.push_back({c, cosine, start, z2 * (1.0 - cosine * cosine)});
    }
    std::sort(others.begin(), others.end(), [](const Other& a, const Other& b) { return a.loss < b.loss; });
    for (std::size_t k = 0; k < others.size() && k < 4; ++k) {
      const Other& o = others[k];
      swaps.push_back({e, o.c, o.cosine});
      // First order is not enough to dismiss a near twin of a large effect.
      if (o.loss > 100.0 && std::abs(o.cosine) < 0.97) continue;
      const std::vector<int> set = with(without(best_trial.effects, e), o.c);
      // A fit that ended far above what the first order promises ended in a valley of its own, and one that ended close
      // by may have ended early where a force jumps: once more, from here.
      if (const auto it = pool_.find(set); it != pool_.end()) {
        const double above = it->second.bic - best_trial.bic;
        if ((above > 30.0 && above < 2.0 * o.loss / inflation_ + 10.0) || retried_.count(set) > 0) continue;
        retried_.insert(set);
      }
      Fit g = best_trial.fit;
      g.values[static_cast<std::size_t>(e)] = p_.machine->coefficients[static_cast<std::size_t>(e)].nominal;
      g.values[static_cast<std::size_t>(o.c)] += o.start;
      store({set, fit(p_, segments_, g, set), 0.0, true});
    }
  }
  return swaps;
}

}  // namespace saltus::diagnosis
