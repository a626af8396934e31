// What a fitted model leaves unexplained: against the noise of the repeats, and along every candidate's signature.
#pragma once

#include "fit.hpp"

namespace saltus::diagnosis {

// A residual looked at in one way, as Fisher's ratio of its power to that of the noise seen the same way.
struct View {
  std::string name;      // "all samples", "mean cycle", "stimulus lines"
  double ratio = 1.0;    // [-] 1 on average when only noise is left
  double freedom = 0.0;  // [-] degrees of freedom
  double p = 1.0;        // [-] of a ratio this large or larger by chance
};

std::vector<View> views(const Problem& p, const std::vector<int>& segments, const Fit& f);

// The score of every candidate at a fit, what else could be refitted being refitted.
struct Evidence {
  std::vector<int> candidate;            // coefficients
  Eigen::VectorXd z;                     // [-] standard normal where the candidate is not there
  Eigen::VectorXd value;                 // first estimate of the coefficient
  Eigen::VectorXd error;                 // its standard deviation
  Eigen::VectorXd kept;                  // [-] share of its signature that the nuisance does not imitate
  Eigen::VectorXd identified;            // [-] share of its information that is not from the declared tolerances
  Eigen::MatrixXd information;           // (candidates x candidates)
  Eigen::VectorXd score;                 // information * value for one candidate alone
  std::vector<std::string> imitated_by;  // the nuisance that imitates it, where it is hardly identified

  double freedom = 0.0;    // [-] degrees of freedom of the scatter that gives it, 0 for white noise
  double inflation = 1.0;  // [-] variance along signatures over that of white noise, from the repeats

  Eigen::Index find(int coefficient) const;
  double cosine(Eigen::Index i, Eigen::Index j) const;
  Eigen::Matrix2d information_of(Eigen::Index i, Eigen::Index j) const;  // of two together
  bool usable(Eigen::Index i) const { return identified[i] > 0.1 && error[i] > 0.0; }
};
// `tolerances`: by what factor the declared tolerances are widened; large: what the data alone say.
Evidence evidence(const Problem& p, const std::vector<int>& segments, const Fit& f, const std::vector<int>& candidates,
                  double tolerances = 1.0);

// The same from signatures that are known already.
Evidence weigh(const Problem& p, const std::vector<int>& segments, const Fit& f, const Signatures& s,
               double tolerances = 1.0);
// The same for some of the candidates.
Evidence among(const Evidence& e, const std::vector<int>& candidates);

// By what chance a model that holds leaves as much along the signatures of these coefficients together, whatever the
// colour of the noise: against the scatter of the repeats along the same (Hotelling's T squared). NaN where repeats are
// too few to tell.
double chance_of_scores(const Problem& p, const std::vector<int>& segments, const Fit& f,
                        const std::vector<int>& coefficients);

// [-] The variance of noise along the signatures of these coefficients over that of white noise, on average; 1 or more.
double widening_along(const Problem& p, const std::vector<int>& segments, const Fit& f,
                      const std::vector<int>& coefficients);

// Standard errors by which an effect that is refitted at f, of signatures s there, is seen in all but the mean cycle;
// negative where that asks for the other sign. What is seen in the mean cycle alone could be any force that repeats
// with it.
double beyond_mean_cycle(const Problem& p, const std::vector<int>& segments, const Fit& f, const Signatures& s,
                         int effect);

constexpr double wide_95 = 1.96;    // [-] standard errors to either side of an interval of 95 %
constexpr double power_95 = 1.645;  // [-] standard errors above a threshold of what is seen with a power of 95 %
// An effect of some size, and by how many standard errors it would be off.
struct Seen {
  double size = 0.0, z = 0.0;
};
// The size that is off by `z`, between those asked; NaN where none is.
double size_seen(const std::vector<Seen>& curve, double z);

}  // namespace saltus::diagnosis
