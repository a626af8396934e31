// The search for the smallest set of effects that leaves nothing but noise.
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "evidence.hpp"

namespace saltus::diagnosis {

struct Trial {
  std::vector<int> effects;  // sorted
  Fit fit;
  double bic = 0.0;
  bool thorough = false;  // fitted with fresh sensitivities
  int rounds = 0;         // how often it was taken further
  bool outdone = false;   // given up: of a part of the data the best leaves far less
};

// Is anything left? Views against the repeats' noise, and the score along every candidate.
struct Gate {
  std::vector<View> views;
  Evidence evidence;
  int worst = -1;  // candidate of the largest significant score
  double worst_z = 0.0;
  bool views_pass = true, scores_pass = true;
  bool passes() const { return views_pass && scores_pass; }
};

class Search {
 public:
  Search(const Problem& p, std::vector<int> segments, std::vector<int> candidates, double false_alarm);

  // Fits the baseline; then everything else may be asked.
  void baseline(const Fit& declared);
  Gate gate(const Fit& f) const;

  // Looks for effects until the gate passes, the gain stops, there are four, or what is found asks for finer steps.
  // Returns the best trial.
  const Trial& run(const std::function<void(double)>& progress);
  // The same by way of what another search found, on samples along which the cost is smoother.
  const Trial& run_from(const Search& smooth, const std::function<void(double)>& progress);

  // The best trial there is, without what does not earn its place in it.
  const Trial& settle();

  // Exchanges each effect of a trial for its near twins, so that ties are found; cosines to those tried.
  struct Swap {
    int from = -1, to = -1;
    double cosine = 0.0;
  };
  std::vector<Swap> swap_twins(const Trial& best);

  // 95 % intervals of a trial's effects, in their order. Where one leads to a better fit the trial becomes that.
  struct Interval {
    double low = 0.0, high = 0.0, sigma = 0.0;  // [unit of the effect]; sigma by the curvature at the best
  };
  std::vector<Interval> intervals(Trial& t);

  // A force that repeats with the cycle, by its coefficients along the cosine and the sine of the clock's angle.
  struct Repeating {
    int cosine = -1, sine = -1;
    // At the baseline, to first order: [-] by how much it is off, [unit of the force], [-] share of its signature kept.
    double z = 0.0, size = 0.0, kept = 0.0;
  };
  // Asked when no law explains the record: fits those that may. What was asked is kept.
  void ask(const std::vector<Repeating>& forces);
  // Fits one in the place of a trial's only effect, where it does nearly the same.
  std::vector<Swap> swap_for_force(const Trial& t, const std::vector<Repeating>& forces);
  // The best of those fitted, if it leaves nothing but noise; else null.
  const Trial* force() const;
  const std::vector<Repeating>& asked() const { return asked_; }
  Interval size_of_force(const Trial& t) const;  // of the only one a trial has

  // The best single effect that leaves a trifle, far below both the noise and what it explains: with enough data every
  // law is seen to be off. Null where there is none.
  const Trial* leaving_a_trifle() const;
  // Standard errors by which an effect of a trial is seen in all but the mean cycle.
  double beyond_mean_cycle(const Trial& t, int effect) const;

  const Trial& base() const { return pool_.at({}); }
  const Gate& base_gate() const { return base_gate_; }
  // Has the refit carried a declared parameter so far off that it may be imitating an effect?
  bool strayed() const;
  // Squares that a trial leaves over the noise: all of them, or what one more candidate would take away, where chance
  // in the others hides it.
  double left_by(const Trial& t) const;
  const std::map<std::vector<int>, Trial>& pool() const { return pool_; }
  const std::vector<int>& candidates() const { return candidates_; }
  double threshold() const { return threshold_; }
  // What an effect at its detection limit is off by, in standard errors: seen with a power of 95 %.
  double limit_z() const { return threshold_ + power_95; }
  // How clearly a candidate would be seen at the baseline, by rising size: of one that changes the charts no straight
  // line tells. Empty where the machine does not follow.
  std::vector<Seen> clarity(int coefficient) const;
  double samples() const { return samples_; }
  // The base evidence's candidates that the data can judge, as coefficients.
  std::vector<int> judged() const;

 private:
  struct Lead {  // worth trying beside what is in `from`
    std::vector<int> from;
    int added;
    double estimate, gain;  // [unit of added], [-] of chi squared, both to first order
  };
  bool curved(int coefficient) const;
  std::vector<double> guesses(int added, double estimate, bool patient) const;
  std::vector<Lead> leads_at(const Trial& t, const Evidence& e, std::size_t most) const;
  void enlarge(const std::function<void(double)>& progress);
  // `needed`: [-] of chi squared, what it has to take away to be of use.
  const Trial& explore(const std::vector<int>& from, const Fit& start, int added, double estimate, bool patient,
                       double needed = 0.0);
  const Trial& complete(const std::vector<int>& set, Fit f, FitOptions options);
  const Trial& dismiss(const std::vector<int>& set, bool outdone = false);
  void grow(int added);
  void step_aside(int added);
  std::pair<std::vector<int>, std::vector<int>> few_and_rest() const;
  double samples_of(const std::vector<int>& segments) const;
  double cost_on(const std::vector<int>& segments, const Fit& f) const;
  double hopeless_on(const std::vector<int>& segments, bool one_more) const;
  FitOptions briefly_to_beat(const std::vector<int>& segments, bool one_more) const;
  bool dear(const std::vector<int>& set) const;
  struct Pair {
    int i, j;
    double vi, vj, gain;  // [unit of each], [-] of chi squared, both to first order
  };
  std::vector<Pair> likely_pairs() const;
  void fit_likely_pairs(const std::vector<Pair>& pairs);
  void fit_force(const Repeating& r, Fit f, const Eigen::Vector2d& force);
  void beside(const std::vector<int>& set);
  const Trial& store(Trial t);
  Gate look(const Fit& f) const;    // a gate's views alone
  bool passes(const Fit& f) const;  // the gate, without scores where the views tell enough
  double clear_in(const std::vector<View>& views) const;
  double clearly_left(const Trial& t) const;
  double needed_beside(const Trial& t) const;
  void judge_scores(Gate& g) const;
  const Signatures& signatures_at(const Fit& f) const;
  const Trial& best() const;
  void finish_near(double bic);
  Fit leapt(const Fit& from, const Fit& over) const;
  void unite(const Trial& t);
  bool not_yet(const Trial& t, const std::vector<int>& set);

  const Problem& p_;
  std::vector<int> segments_, candidates_;
  double threshold_ = 4.0;  // of |z|, for all candidates together
  double view_level_ = 1e-3;
  double samples_ = 0.0, measurements_ = 0.0;  // rows, and what went into them
  double inflation_ = 1.0;                     // [-] of a gain in chi^2, where the noise is correlated in time
  Gate base_gate_;
  Fit declared_;  // declared values, with the starts that go with them
  std::map<std::vector<int>, Trial> pool_;
  std::vector<Repeating> asked_;
  std::set<std::vector<int>> forces_;                                         // sets fitted that are such a force
  std::set<std::vector<int>> retried_;                                        // fitted once more from a twin
  std::set<std::tuple<std::vector<int>, std::vector<int>, double>> started_;  // set, from which other, of what cost
  // Signatures are most of the work, and asked for more than once at the same fit.
  struct Known {
    std::vector<int> free;
    std::vector<double> values;
    Signatures signatures;
  };
  mutable std::deque<Known> known_;
  mutable std::pair<std::vector<int>, double> asked_of_;  // a trial, by its effects and its cost
  mutable double clearly_left_ = 0.0;                     // [-] of squares, by that
};

}  // namespace saltus::diagnosis
