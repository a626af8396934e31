// The part of the selection that asks whether another cause, or two, would do in the place of one.
#include <Eigen/LU>

#include <algorithm>
#include <cmath>

#include "selection.hpp"
#include "sets.hpp"

namespace saltus::diagnosis {
namespace {
constexpr double worth_asking = 24.0;  // [-] BIC above the result: what a rival predicts
}  // namespace

bool Selection::take_pair(int first) {
  const Attempt current = pool_.at(result_);
  const Attempt one = attempt(with(current.effects, first), current.fit, current.noise);
  const double enough = bar(current.effects.size());
  if (cost(current, current) - cost(one, current) < enough) return false;
  const Evidence e = evidence_of(one);
  int second = -1;
  double best = 2.0;
  for (std::size_t i = 0; i < e.candidate.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const int c = e.candidate[i];
    if (!e.usable(k) || !may_change(*p_.machine, c, e.value[k]) || has(one.effects, c) || !(std::abs(e.z[k]) > best))
      continue;
    if (!refinable(one.effects, c)) continue;
    second = c;
    best = std::abs(e.z[k]);
  }
  if (second < 0) return false;
  const auto started = [&](Fit f, int c, double estimate) {
    f.values[static_cast<std::size_t>(c)] = p_.machine->coefficients[static_cast<std::size_t>(c)].nominal + estimate;
    return f;
  };
  const Attempt both = attempt(with(one.effects, second), started(one.fit, second, e.value[e.find(second)]), one.noise);
  const Attempt other = attempt(with(current.effects, second), started(both.fit, first, 0.0), both.noise);
  if (std::min(cost(one, both), cost(other, both)) - cost(both, both) < bar(one.effects.size())) return false;
  Trial1 a = examine(both, other, first), b = examine(both, one, second);
  a.taken = b.taken = convincing(a) && convincing(b);
  account_.push_back(a);
  account_.push_back(b);
  if (a.taken) result_ = both.effects;
  return a.taken;
}

bool Selection::take_pair_instead() {
  constexpr std::size_t most = 3;
  const Attempt one = result();
  const int single = one.effects[0];
  const auto nominal = [&](int c) { return p_.machine->coefficients[static_cast<std::size_t>(c)].nominal; };
  data_.noise = one.noise;
  const Evidence e = evidence(p_, segments_, with_fixed(one.fit, single), candidates_);
  const auto own = e.find(single);
  if (own < 0 || !(e.error[own] > 0.0)) return false;
  const double size = one.fit.values[static_cast<std::size_t>(single)] - nominal(single);
  // To first order, with the single one gone: what it does is left to others.
  const Eigen::VectorXd score = e.score + size * e.information.col(own);
  const double gain_of_one = score[own] * score[own] / e.information(own, own);
  struct Pair {
    int i, j;
    Eigen::Vector2d value;
    double gain;
  };
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < e.candidate.size(); ++i) {
    for (std::size_t j = i + 1; j < e.candidate.size(); ++j) {
      const auto a = static_cast<Eigen::Index>(i), b = static_cast<Eigen::Index>(j);
      const int first = e.candidate[i], second = e.candidate[j];
      if (a == own || b == own || !(e.error[a] > 0.0) || !(e.error[b] > 0.0) || std::abs(e.cosine(a, b)) > 0.98)
        continue;
      if (!refinable({second}, first) || !refinable({first}, second)) continue;
      const Eigen::Vector2d s(score[a], score[b]), value = e.information_of(a, b).inverse() * s;
      if (!may_change(*p_.machine, first, value[0]) || !may_change(*p_.machine, second, value[1])) continue;
      const double gain = s.dot(value);
      if (gain > gain_of_one + bar(1)) pairs.push_back({first, second, value, gain});
    }
  }
  std::sort(pairs.begin(), pairs.end(), [](const Pair& x, const Pair& y) { return x.gain > y.gain; });
  if (pairs.size() > most) pairs.resize(most);
  for (const Pair& q : pairs) {
    Fit f = one.fit;
    f.values[static_cast<std::size_t>(single)] = nominal(single);
    f.values[static_cast<std::size_t>(q.i)] = nominal(q.i) + q.value[0];
    f.values[static_cast<std::size_t>(q.j)] = nominal(q.j) + q.value[1];
    const Attempt both = attempt(with({q.i}, q.j), f, one.noise);
    if (cost(one, both) - cost(both, both) < bar(1)) continue;
    Trial1 better = examine(both, one, q.i);
    if (!convincing(better)) continue;
    // Each beside the other.
    const auto alone = [&](int kept, int gone) {
      Fit g = both.fit;
      g.values[static_cast<std::size_t>(gone)] = nominal(gone);
      return attempt({kept}, g, both.noise);
    };
    Trial1 a = examine(both, alone(q.j, q.i), q.i), b = examine(both, alone(q.i, q.j), q.j);
    a.taken = b.taken = convincing(a) && convincing(b);
    if (!a.taken) continue;
    retract(single);
    account_.push_back(a);
    account_.push_back(b);
    result_ = both.effects;
    return true;
  }
  return false;
}

// Where the model itself is wrong by more than the noise, a law that gains a quarter less may be the right one.
// Free runs tell better: across a stretch an error has time to grow that a start of its own would hide.
void Selection::prefer_by_free_runs(const FreeRunRatio& free_run, const Attempt& current,
                                    const std::vector<int>& others) {
  const Attempt likeliest = result();
  const Trial1 first_taken = account_.back();
  double least = 0.9;
  for (const int c : others) {
    const Attempt first = pool_.at(with(current.effects, c));
    const Attempt more = attempt(first.effects, first.fit, first.noise);
    const double ratio = free_run(c, more, first_taken.effect, likeliest);
    if (!(ratio < least)) continue;
    Trial1 t = examine(more, current, c);
    if (!(t.gain > 0.75 * first_taken.gain) || !convincing(t)) continue;
    t.taken = true;
    t.instead = first_taken.effect;
    t.free_run = least = ratio;
    retract(account_.back().effect);
    account_.push_back(t);
    result_ = more.effects;
  }
}

const Attempt& Selection::prefer(const Tie& t) {
  const Attempt before = result(), a = pool_.at(with(without(result_, t.from), t.to));
  Fit f = before.fit;
  f.values[static_cast<std::size_t>(t.from)] = p_.machine->coefficients[static_cast<std::size_t>(t.from)].nominal;
  const Attempt neither = attempt(without(result_, t.from), f, before.noise);
  retract(t.from);
  result_ = a.effects;
  const Attempt& now = attempt(a.effects, a.fit, a.noise);
  account_.push_back(examine(now, neither, t.to));
  account_.back().taken = true;
  return now;
}

std::vector<Selection::Tie> Selection::ties() {
  std::vector<Tie> r;
  const Attempt best = result();
  for (const int e : best.effects) {
    data_.noise = best.noise;
    const Evidence v = evidence(p_, segments_, with_fixed(best.fit, e), candidates_);
    const auto i = v.find(e);
    if (i < 0) continue;
    const double value =
        best.fit.values[static_cast<std::size_t>(e)] - p_.machine->coefficients[static_cast<std::size_t>(e)].nominal;
    std::vector<std::pair<double, Eigen::Index>> alike;
    for (std::size_t k = 0; k < v.candidate.size(); ++k) {
      const auto j = static_cast<Eigen::Index>(k);
      // Not `usable`: beside what was found even its exact twin is known only as well as the scale of all forces.
      if (v.candidate[k] == e || !(v.error[j] > 0.0) || has(best.effects, v.candidate[k])) continue;
      alike.emplace_back(-std::abs(v.cosine(i, j)), j);
    }
    std::sort(alike.begin(), alike.end());
    for (std::size_t k = 0; k < alike.size() && k < 3; ++k) {
      const Eigen::Index j = alike[k].second;
      const int c = v.candidate[static_cast<std::size_t>(j)];
      const double start = value * v.information(i, j) / v.information(j, j);
      if (!may_change(*p_.machine, c, start)) continue;
      Fit g = best.fit;
      g.values[static_cast<std::size_t>(e)] = p_.machine->coefficients[static_cast<std::size_t>(e)].nominal;
      g.values[static_cast<std::size_t>(c)] = p_.machine->coefficients[static_cast<std::size_t>(c)].nominal + start;
      const Attempt& a = attempt(with(without(best.effects, e), c), g, best.noise);
      const double above = bic(a, best) - bic(best, best);
      r.push_back({e, c, v.cosine(i, j), above, above < worth_asking ? examine(a, best, c).predicted : std::nan("")});
    }
  }
  return r;
}

}  // namespace saltus::diagnosis
