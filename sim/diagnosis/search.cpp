#include "search.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/trace/statistics.hpp"
#include "past_events.hpp"
#include "sets.hpp"
#include "setup.hpp"

namespace saltus::diagnosis {

Search::Search(const Problem& p, std::vector<int> segments, std::vector<int> candidates, double false_alarm)
    : p_(p), segments_(std::move(segments)), candidates_(std::move(candidates)) {
  for (const int s : segments_) measurements_ += p.data->segments[static_cast<std::size_t>(s)].count.sum();
  samples_ = samples_of(segments_);
  threshold_ = largest_of(std::max(1, static_cast<int>(candidates_.size())), false_alarm);
  view_level_ = 0.1 * false_alarm;
}

double Search::samples_of(const std::vector<int>& segments) const {
  double n = 0.0;
  for (const int s : segments) n += p_.data->segments[static_cast<std::size_t>(s)].measured();
  return n;
}

const Trial& Search::store(Trial t) {
  if (!sensible(*p_.machine, t.fit)) t.fit.chi2 = std::numeric_limits<double>::infinity();
  t.bic = t.fit.cost() / inflation_ +
          static_cast<double>(t.effects.size()) * std::log(std::max(2.0, samples_ / inflation_));
  auto [it, added] = pool_.try_emplace(t.effects, t);
  if (!added && t.bic < it->second.bic) it->second = std::move(t);
  return it->second;
}

const Trial& Search::best() const {
  const Trial* b = &base();
  for (const auto& [set, t] : pool_) {
    if (t.bic < b->bic) b = &t;
  }
  return *b;
}

// Fits to their end what is within `bic` of the best, so that none wins, or loses, for having been left early. Three
// effects or more that have converged, or fall in a round by less than one more would have to, will not make up for
// that; nor does it matter where even the best leaves much.
void Search::finish_near(double bic) {
  constexpr int most_rounds = 3;
  constexpr double slow = 100.0;  // [-] what one that ran out of iterations may still fall by
  const bool far = clearly_left(best()) > 0.5 * clear_in(base_gate_.views);
  const auto many = [&](const std::vector<int>& set) { return set.size() > 2 || (far && !set.empty()); };
  const bool any = std::any_of(pool_.begin(), pool_.end(), [&](const auto& p) { return many(p.first); });
  const double most_needed = any ? needed_beside(best()) : 0.0;
  const auto needed = [&](const Trial& t) { return many(t.effects) ? most_needed : 0.0; };
  for (;;) {
    const double limit = best().bic + bic;
    const Trial* left = nullptr;
    for (const auto& [set, t] : pool_) {
      const bool done = ((t.thorough || needed(t) > bic) && t.fit.converged) || t.rounds >= most_rounds;
      if (!done && !(t.bic > limit + (t.fit.converged ? 0.0 : slow)) && (left == nullptr || t.bic < left->bic))
        left = &t;
    }
    if (left == nullptr) return;
    const std::vector<int> set = left->effects;
    int rounds = left->rounds + 1;
    const Fit before = left->fit;
    store({set, fit(p_, segments_, before, set), 0.0, true});
    Trial& t = pool_.at(set);
    const double least = std::max(1.0, needed(t));
    if (!t.fit.converged && t.fit.cost() < before.cost() - least)  // it creeps along a bent valley
      store({set, fit(p_, segments_, leapt(before, t.fit), set), 0.0, true});
    if (before.cost() - t.fit.cost() < needed(t)) rounds = most_rounds;
    t.thorough = true;
    t.rounds = rounds;
  }
}

bool Search::strayed() const { return farthest_off(p_, base().fit) > 4.0; }

double Search::left_by(const Trial& t) const {
  const double z = gate(t.fit).worst_z;
  return std::max(t.fit.chi2 - samples_, z * z);
}

const Trial* Search::leaving_a_trifle() const {
  constexpr double of_explained = 0.005;                          // [-] of squares
  const double of_noise = p_.data->noise_measured ? 0.02 : 0.05;  // [-] of squares
  const double trifle = std::min(of_explained * (base().fit.chi2 - samples_), of_noise * measurements_);
  if (!(trifle > 0.0)) return nullptr;  // nothing was left to begin with
  const Trial* best = nullptr;
  for (const auto& [set, t] : pool_) {
    if (set.size() == 1 && t.fit.chi2 - samples_ < trifle && (best == nullptr || t.bic < best->bic)) best = &t;
  }
  return best != nullptr && left_by(*best) < trifle ? best : nullptr;
}

void Search::baseline(const Fit& declared) {
  declared_ = fit(p_, segments_, declared, {}, {.iterations = 0});
  store({{}, fit_past_events(p_, segments_, declared, {}), 0.0, true});
  base_gate_ = gate(base().fit);
  inflation_ = std::max(1.0, base_gate_.evidence.inflation);
  if (p_.data->coloured) {  // scores over a scatter that is itself estimated are Student's: Cornish and Fisher
    const double z = threshold_, freedom = base_gate_.evidence.freedom;
    threshold_ += (z * z * z + z) / (4.0 * std::max(1.0, freedom));
    judge_scores(base_gate_);
  }
  const Fit plain = base().fit;
  pool_.clear();
  store({{}, plain, 0.0, true});
  // A refinement of another law is a candidate of its own only where the data can tell the two apart.
  const Evidence& e = base_gate_.evidence;
  std::vector<int> kept;
  for (const int c : candidates_) {
    const std::string& refined = p_.machine->coefficients[static_cast<std::size_t>(c)].refines;
    bool keep = true;
    for (const int o : candidates_) {
      if (refined.empty() || p_.machine->coefficients[static_cast<std::size_t>(o)].name != refined) continue;
      const auto i = e.find(c), j = e.find(o);
      if (i >= 0 && j >= 0 && std::abs(e.cosine(i, j)) > 0.98) keep = false;
    }
    if (keep) kept.push_back(c);
  }
  if (kept.size() != candidates_.size()) {
    candidates_ = std::move(kept);
    base_gate_.evidence = among(e, candidates_);
    judge_scores(base_gate_);
  }
}

const Signatures& Search::signatures_at(const Fit& f) const {
  constexpr std::size_t most = 4;
  for (const Known& k : known_) {
    if (k.free == f.free && k.values == f.values) return k.signatures;
  }
  if (known_.size() == most) known_.pop_front();
  known_.push_back({f.free, f.values, signatures(p_, segments_, f, candidates_)});
  return known_.back().signatures;
}

double Search::beyond_mean_cycle(const Trial& t, int effect) const {
  return diagnosis::beyond_mean_cycle(p_, segments_, t.fit, signatures_at(t.fit), effect);
}

std::vector<int> Search::judged() const {
  std::vector<int> r;
  const Evidence& e = base_gate_.evidence;
  for (std::size_t i = 0; i < e.candidate.size(); ++i) {
    if (e.usable(static_cast<Eigen::Index>(i))) r.push_back(e.candidate[i]);
  }
  return r;
}

Gate Search::look(const Fit& f) const {
  Gate g;
  g.views = views(p_, segments_, f);
  for (const View& v : g.views) g.views_pass = g.views_pass && v.p > view_level_;
  return g;
}

// Squares that no chance leaves, in the view that shows most of them; nothing where none shows any.
double Search::clear_in(const std::vector<View>& views) const {
  double most = 0.0;
  for (const View& v : views) {
    if (!(v.p > view_level_)) most = std::max(most, v.freedom * (v.ratio - 1.0));
  }
  return most;
}

double Search::clearly_left(const Trial& t) const {
  if (asked_of_ != std::pair{t.effects, t.fit.cost()}) {
    asked_of_ = {t.effects, t.fit.cost()};
    clearly_left_ = clear_in(look(t.fit).views);
  }
  return clearly_left_;
}

// Squares that one more effect has to take away.
double Search::needed_beside(const Trial& t) const { return 0.25 * clearly_left(t); }

bool Search::passes(const Fit& f) const { return look(f).views_pass && gate(f).passes(); }

Gate Search::gate(const Fit& f) const {
  Gate g = look(f);
  g.evidence = among(weigh(p_, segments_, f, signatures_at(f)), candidates_);
  judge_scores(g);
  return g;
}

void Search::judge_scores(Gate& g) const {
  g.worst = -1;
  g.worst_z = 0.0;
  g.scores_pass = true;
  for (std::size_t i = 0; i < g.evidence.candidate.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    if (!g.evidence.usable(k)) continue;
    if (std::abs(g.evidence.z[k]) > std::max(threshold_, std::abs(g.worst_z))) {
      g.worst = g.evidence.candidate[i];
      g.worst_z = g.evidence.z[k];
      g.scores_pass = false;
    }
  }
}

std::vector<Search::Lead> Search::leads_at(const Trial& t, const Evidence& e, std::size_t most) const {
  std::vector<Lead> leads;
  for (std::size_t i = 0; i < e.candidate.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const int c = e.candidate[i];
    // Where the response is curved the sign of a linear estimate, taken after the parameters imitated the effect,
    // says nothing about the effect itself.
    const bool linear = !p_.machine->coefficients[static_cast<std::size_t>(c)].changes_charts();
    if (!e.usable(k) || (linear && !may_change(*p_.machine, c, e.value[k]))) continue;
    if (std::find(t.effects.begin(), t.effects.end(), c) != t.effects.end()) continue;
    leads.push_back({t.effects, c, e.value[k], e.z[k] * e.z[k]});
  }
  std::sort(leads.begin(), leads.end(), [](const Lead& a, const Lead& b) { return a.gain > b.gain; });
  if (leads.size() > most) leads.resize(most);
  return leads;
}

const Trial& Search::run(const std::function<void(double)>& progress) {
  const std::vector<Lead> leads = leads_at(base(), base_gate_.evidence, candidates_.size());
  for (std::size_t i = 0; i < leads.size(); ++i) {
    const Lead& l = leads[i];
    if (l.gain < 4.0 || l.gain < 0.02 * leads[0].gain || (i > 7 && !curved(l.added))) continue;
    explore(l.from, base().fit, l.added, l.estimate, (curved(l.added) && l.gain > 0.1 * leads[0].gain) || i < 2);
    progress(0.1 + 0.2 * static_cast<double>(i) / static_cast<double>(leads.size()));
  }
  if (strayed()) {  // the way back from there may be barred: once more from where the parameters were declared
    const Evidence e = among(weigh(p_, segments_, declared_, signatures_at(declared_)), candidates_);
    const std::vector<Lead> others = leads_at(base(), e, 4);
    for (std::size_t i = 0; i < others.size(); ++i) {
      explore({}, declared_, others[i].added, others[i].estimate, curved(others[i].added));
      progress(0.3 + 0.1 * static_cast<double>(i) / static_cast<double>(others.size()));
    }
  }
  if (finer_step(p_, best().fit) < p_.h_max) return best();  // what else there is shows with finer steps alone
  // Of what changes the charts the slope at nothing says little, and the first fit may be trapped.
  constexpr double little = 250.0, near = 100.0;  // [-] of BIC: evidence another cause may well match; in reach
  for (const int c : judged()) {
    if (!p_.machine->coefficients[static_cast<std::size_t>(c)].changes_charts()) continue;
    if (pool_.count({c}) == 0 && best().bic > base().bic - little) explore({}, base().fit, c, 0.0, true);
    const auto t = pool_.find({c});
    if (t != pool_.end() && t->second.bic < std::min(base().bic, best().bic + near)) step_aside(c);
  }
  const bool none_is_it = left_by(best()) > 0.05 * (base().fit.chi2 - samples_);
  enlarge(progress);
  // Nor are several. Of an effect that changes the charts the evidence near zero says little, and it may be another
  // gait, of which the squares would tell.
  const bool squares_tell = left_by(best()) > 3.0 * std::sqrt(2.0 * samples_);
  if (p_.data->sections > 0 && !p_.data->wandering && squares_tell && !passes(best().fit)) {
    const std::vector<int> before = best().effects;
    for (const int c : candidates_) {
      if (!p_.machine->coefficients[static_cast<std::size_t>(c)].changes_charts()) continue;
      if (!none_is_it && !has(best().effects, c)) continue;
      if (pool_.count({c}) == 0) explore({}, base().fit, c, 0.0, true);
      grow(c);
    }
    if (best().effects != before) enlarge(progress);
  }
  finish_near(30.0);
  return settle();
}

// All pairs, to first order at the baseline, the most promising first.
std::vector<Search::Pair> Search::likely_pairs() const {
  const Evidence& e = base_gate_.evidence;
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < e.candidate.size(); ++i) {
    for (std::size_t j = i + 1; j < e.candidate.size(); ++j) {
      const auto a = static_cast<Eigen::Index>(i), c = static_cast<Eigen::Index>(j);
      if (!e.usable(a) || !e.usable(c) || std::abs(e.cosine(a, c)) > 0.98) continue;
      const Eigen::Vector2d s(e.score[a], e.score[c]);
      const Eigen::Vector2d v = e.information_of(a, c).inverse() * s;
      if (!may_change(*p_.machine, e.candidate[i], v[0]) || !may_change(*p_.machine, e.candidate[j], v[1])) continue;
      pairs.push_back({e.candidate[i], e.candidate[j], v[0], v[1], s.dot(v)});
    }
  }
  std::sort(pairs.begin(), pairs.end(), [](const Pair& x, const Pair& y) { return x.gain > y.gain; });
  return pairs;
}

void Search::fit_likely_pairs(const std::vector<Pair>& pairs) {
  struct Begun {
    std::vector<int> set;
    Fit fit;
  };
  std::vector<Begun> begun;
  const std::vector<int> part = few_and_rest().first;
  for (std::size_t k = 0; k < pairs.size() && k < 3; ++k) {
    const Pair& q = pairs[k];
    const std::vector<int> set = with({q.i}, q.j);
    if (pool_.count(set) > 0) continue;
    Fit f = base().fit;
    f.values[static_cast<std::size_t>(q.i)] += q.vi;
    f.values[static_cast<std::size_t>(q.j)] += q.vj;
    begun.push_back({set, fit(p_, part, f, set, briefly_to_beat(part, true))});
  }
  std::sort(begun.begin(), begun.end(), [](const Begun& x, const Begun& y) { return x.fit.cost() < y.fit.cost(); });
  for (const Begun& b : begun) complete(b.set, b.fit, briefly);
}

// From the best sets of one effect to sets of two, and on, until the gate passes or nothing larger helps.
void Search::enlarge(const std::function<void(double)>& progress) {
  constexpr std::size_t most_effects = 4;
  double left_before = std::numeric_limits<double>::infinity(), needed_before = left_before;
  for (std::size_t size = 1; size <= most_effects; ++size) {
    finish_near(0.0);
    Trial b = best();
    if (b.effects.size() < size) break;  // nothing larger helped
    if (passes(b.fit) || size == most_effects) break;
    if (size == 1) {  // a twin of it may be all there is: a second effect would only make up for the difference
      swap_twins(b);
      b = best();
      if (b.effects.size() == 1 && passes(b.fit)) break;
    }
    if (size > 1) {  // where one leaves a trifle, more must leave much less
      const Trial* one = leaving_a_trifle();
      if (one != nullptr && b.fit.chi2 - samples_ > 0.5 * (one->fit.chi2 - samples_)) break;
    }
    // More effects only where these already explain most of what there is, and the last of them much of what was left.
    const double excess = base().fit.chi2 - samples_, left = b.fit.chi2 - samples_;
    if (size > 1 && left > 0.15 * excess) break;
    if (size > 1 && left > left_before / 3.0) break;
    const std::vector<Pair> pairs = size == 1 ? likely_pairs() : std::vector<Pair>();
    if (size == 1) {  // where one explains next to nothing, and to first order no two do, more would be a description
      const double clear = clear_in(base_gate_.views);
      const double gain = pairs.empty() ? 0.0 : pairs.front().gain;
      if (clearly_left(b) > 0.9 * clear && gain < 0.5 * clear) break;
    }
    const double needed = needed_beside(b);
    if (needed > 0.9 * needed_before) break;
    left_before = left;
    needed_before = needed;
    // From the best few sets of this size to the next.
    std::vector<const Trial*> sets;
    for (const auto& [set, t] : pool_) {
      if (set.size() == size && std::isfinite(t.bic)) sets.push_back(&t);
    }
    std::sort(sets.begin(), sets.end(), [](const Trial* x, const Trial* y) { return x->bic < y->bic; });
    if (sets.size() > 2) sets.resize(2);
    const double before = best().bic;
    std::vector<Lead> next, more;
    for (const Trial* t : sets) {
      const Evidence e = among(weigh(p_, segments_, t->fit, signatures_at(t->fit)), candidates_);
      const bool much = size == 1 && t == sets.front() && left < 0.4 * excess;
      const auto some = leads_at(*t, e, much ? 8 : 3);
      const auto first = some.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(3, some.size()));
      next.insert(next.end(), some.begin(), first);
      more.insert(more.end(), first, some.end());  // should none of these be it
    }
    if (size == 1) fit_likely_pairs(pairs);
    const std::size_t likely = next.size();
    next.insert(next.end(), more.begin(), more.end());
    for (std::size_t i = 0; i < next.size(); ++i) {
      if (i == likely && passes(best().fit)) break;
      const Lead& l = next[i];
      const bool patient = curved(l.added) && i < 3;
      if (size > 1 && !curved(l.added) && l.gain < needed) continue;
      if (l.gain < 4.0 || (!patient && pool_.count(with(l.from, l.added)) > 0)) continue;
      explore(l.from, pool_.at(l.from).fit, l.added, l.estimate, patient, needed);
      progress(0.4 + 0.1 * static_cast<double>(size) + 0.1 * static_cast<double>(i) / static_cast<double>(next.size()));
    }
    if (size == 1) beside(sets.front()->effects);
    if (!(best().bic < before)) break;
  }
}

// Is this the first time that a trial, as it is fitted now, is taken for the start of a set? It would come out the
// same.
bool Search::not_yet(const Trial& t, const std::vector<int>& set) {
  return started_.insert({set, t.effects, t.fit.cost()}).second;
}

const Trial& Search::settle() {
  if (best().effects.size() == 2 && not_yet(best(), best().effects)) unite(best());
  // Backward: an effect that no longer earns its place goes.
  for (bool again = true; again;) {
    again = false;
    const std::vector<int> set = best().effects;
    for (const int e : set) {
      if (set.size() < 2) break;
      const std::vector<int> smaller = without(set, e);
      const auto known = pool_.find(smaller);
      if (known != pool_.end() && !(known->second.outdone && smaller.size() == 1)) continue;
      Fit f = pool_.at(set).fit;
      f.values[static_cast<std::size_t>(e)] = p_.machine->coefficients[static_cast<std::size_t>(e)].nominal;
      const std::vector<int> part = few_and_rest().first;
      if (fit(p_, part, f, smaller, briefly_to_beat(part, false)).cost() > hopeless_on(part, false)) {
        dismiss(smaller);
      } else {
        store({smaller, fit(p_, segments_, f, smaller), 0.0, true});
      }
    }
    again = best().effects != set;
  }
  // What does not clear the threshold against the same without it is not there; the more there are the more it takes,
  // for every search is one more chance to be misled.
  const Trial* b = &best();
  for (bool again = true; again && !b->effects.empty();) {
    again = false;
    const double bar = inflation_ * threshold_ * threshold_ * (1.0 + 0.5 * static_cast<double>(b->effects.size() - 1));
    for (const int e : b->effects) {
      const std::vector<int> fewer = without(b->effects, e);
      const auto it = pool_.find(fewer);
      if (it == pool_.end()) continue;
      double loss = it->second.fit.cost() - b->fit.cost();
      const auto at = std::find(b->fit.free.begin(), b->fit.free.end(), e) - b->fit.free.begin();
      const double nominal = p_.machine->coefficients[static_cast<std::size_t>(e)].nominal;
      const double off = b->fit.values[static_cast<std::size_t>(e)] - nominal;
      const double own = off * off / b->fit.covariance(at, at);  // [-] of what its own error makes of it
      if (!(loss < bar) && !fewer.empty() && own < 4.0 * bar) {
        // Its own error says that the fit without it may have been trapped: once more, from here, by and by.
        if (not_yet(*b, fewer)) {
          Fit f = b->fit;
          for (const double part : {0.6, 0.3, 0.1, 0.0}) {
            f.values[static_cast<std::size_t>(e)] = nominal + part * off;
            f = fit(p_, segments_, f, fewer);
          }
          store({fewer, f, 0.0, true});
        }
        loss = pool_.at(fewer).fit.cost() - b->fit.cost();
      }
      if (loss < bar || (!fewer.empty() && own < 4.0)) {  // or nothing is known of it, and the rest is trapped
        b = &pool_.at(fewer);
        again = true;
        break;
      }
    }
  }
  return *b;
}

}  // namespace saltus::diagnosis
