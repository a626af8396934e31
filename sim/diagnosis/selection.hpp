// The search for effects where the model is never quite true. On a real machine what is left is not noise: it is larger
// than the sensors' and correlated in time. So nothing is tested against the sensors' noise. An effect must earn its
// place against the residual itself, counted as the few independent numbers that it is, and in prediction: fitted on
// part of the data it must predict the rest better.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "evidence.hpp"

namespace saltus::diagnosis {

// A set of effects fitted, with the residual that it leaves.
struct Attempt {
  std::vector<int> effects;  // sorted
  Fit fit;
  double scale = 1.0;        // [-] mean square of the residual in units of the sensors' noise
  double independent = 1.0;  // [-] independent numbers in it
  Eigen::VectorXd noise;     // (outputs) [unit] such that the residual's sum of squares over it counts those
  bool brief = false;        // a few steps only, to see whether it is worth more
  bool quiet = false;        // the residual is hardly larger than the sensors' noise, and hardly correlated in time
};

// Why an effect was taken, or was not.
struct Trial1 {
  int effect = -1;
  std::vector<int> beside;    // the effects it joined
  double gain = 0.0;          // [-] fall of -2 log likelihood, the residual's own variance
  double predicted = 0.0;     // [-] error left of that before, on parts left out of the fit: root mean square
  int better = 0, parts = 0;  // parts that were predicted better
  bool quiet = false;         // nothing but noise is left with it
  bool trifle = false;        // it refines another law, by next to nothing
  bool taken = false;
  int instead = -1;       // of this effect, with a likelihood that is no better reason
  double free_run = 1.0;  // [-] error of free runs, over what it is with that one
};

// Error of free runs over the fitted part with effect c in the place of effect `over`, as fitted, over what it is with
// that; NaN where it is not known, or does not count.
using FreeRunRatio = std::function<double(int c, const Attempt& a, int over, const Attempt& with)>;

class Selection {
 public:
  // Changes data.noise as it goes, and the weights (count) of stretches that disagree with the others; `blocks`: for
  // every segment the part it is left out with.
  Selection(const Problem& p, Data& data, std::vector<int> segments, std::vector<int> blocks,
            std::vector<int> candidates, double false_alarm);

  void baseline(const Fit& declared);
  const Attempt& run(const std::function<void(double)>& progress, const FreeRunRatio& free_run = {});

  // Takes a set of effects found elsewhere and fits it here.
  const Attempt& adopt(const Attempt& a);

  // Exchanges each effect of the result for what looks most like it.
  struct Tie {
    int from, to;
    double cosine, above;  // [-] BIC above the result
    double predicted;      // [-] error of predicting parts left out, over the result's; NaN where far above
  };
  std::vector<Tie> ties();
  // Takes the other of a tie for the result, and the result without one of its effects.
  const Attempt& prefer(const Tie& t);
  const Attempt& drop(int effect);

  const Attempt& base() const { return pool_.at({}); }
  const Attempt& result() const { return pool_.at(result_); }
  const Evidence& base_evidence() const { return base_evidence_; }
  Evidence evidence_of(const Attempt& a) const;
  const std::map<std::vector<int>, Attempt>& pool() const { return pool_; }
  const std::vector<Trial1>& account() const { return account_; }
  // By effect, of those tried alone: BIC against the baseline, and the value.
  const std::map<int, std::pair<double, double>>& alone() const { return alone_; }
  const std::vector<int>& candidates() const { return candidates_; }
  double threshold() const { return threshold_; }
  // False for a refinement of what has not been found and could be: a friction is asymmetric once there is friction.
  bool refinable(const std::vector<int>& effects, int coefficient) const;
  // -2 log likelihood with the penalty of the declared tolerances, for as many independent numbers as `like` has.
  double cost(const Attempt& a, const Attempt& like) const;
  double bic(const Attempt& a, const Attempt& like) const;

  // Standard errors of the free coefficients that hold whatever the residual is within a stretch: from how the
  // stretches disagree.
  Eigen::VectorXd errors(const Attempt& a) const;

 private:
  void reweigh();
  void retract(int effect);  // from the account
  const Attempt& attempt(const std::vector<int>& effects, const Fit& from, const Eigen::VectorXd& noise,
                         bool brief = false);
  // Sums of squares in units of the sensors' noise, part by part, of what a fit to the other parts predicts.
  const std::vector<double>& left_out(const Attempt& a);
  // Takes an effect together with what looks best beside it, where each convinces beside the other.
  bool take_pair(int first);
  // Exchanges the only effect found for two others, where those are far likelier: one law may be all that a linear look
  // sees of two that differ from it either way, and beside it neither helps.
  bool take_pair_instead();
  // Exchanges the effect just taken beside `current` for one of others that is nearly as likely and runs free better.
  void prefer_by_free_runs(const FreeRunRatio& free_run, const Attempt& current, const std::vector<int>& others);
  Trial1 examine(const Attempt& with, const Attempt& without, int effect);
  double bar(std::size_t beside) const;  // [-] least gain of an effect beside so many others
  bool refines_a_trifle(const Attempt& a, int effect) const;
  bool convincing(const Trial1& t) const;

  const Problem& p_;
  Data& data_;
  std::vector<int> segments_, blocks_, candidates_;
  double threshold_ = 4.0;
  Evidence base_evidence_;
  std::map<std::vector<int>, Attempt> pool_;
  std::map<std::vector<int>, std::vector<double>> left_out_;  // sum of squares by part, in units of the sensors' noise
  Eigen::VectorXd sensors_;                                   // (outputs) [unit] their noise
  std::vector<int> result_;
  std::vector<Trial1> account_;
  std::map<int, std::pair<double, double>> alone_;
};

}  // namespace saltus::diagnosis
