// Fits a machine to segments: declared parameters within their tolerances, chosen effects, and every segment's start.
// Levenberg-Marquardt on exact sensitivities; the starts are eliminated segment by segment (Schur complement).
#pragma once

#include <Eigen/Core>

#include <limits>
#include <string>
#include <vector>

#include "core/random.hpp"
#include "data.hpp"
#include "machine.hpp"

namespace saltus::diagnosis {

struct Problem {
  const Machine* machine = nullptr;
  const Data* data = nullptr;
  std::vector<double> tolerance;  // (declared) standard deviation of each; 0 = exact
  double widened = 1.0;           // [-] variance of the noise along what parameters do over that of white noise
  double h_max = 0.0;             // [s] longest step of a prediction
  double h_slope = 0.0;           // [s] longest step of its sensitivities, of which three digits are enough
};

struct Fit {
  bool converged = false;
  std::vector<int> free;       // coefficients that were fitted: declared ones, then effects
  std::vector<double> values;  // of every coefficient
  std::vector<Start> start;    // of every segment of the problem; fitted for those in use
  double chi2 = 0.0;           // of the data, means weighted by how many measurements went in
  double penalty = 0.0;        // of the declared parameters: squared deviations over tolerances, as chi2 is widened
  Eigen::MatrixXd covariance;  // (free x free), starts eliminated
  int iterations = 0;
  Status status = Status::ok;

  double cost() const { return chi2 + penalty; }
};

struct FitOptions {
  bool refit_parameters = true;  // false: declared values, only the starts and the effects move
  int iterations = 14;
  double enough = 0.05;  // stop when the cost falls by less
  bool brief = false;    // do not ask for fresh sensitivities before stopping
  // [-] Given up where falling as it does, in all iterations left, would not lead below this.
  double to_beat = std::numeric_limits<double>::infinity();
};
inline constexpr FitOptions briefly{.brief = true};
inline constexpr FitOptions starts_alone{.refit_parameters = false};

// `segments`: which to use. `from`: a fit to start at.
Fit fit(const Problem& p, const std::vector<int>& segments, const Fit& from, const std::vector<int>& effects,
        const FitOptions& options = {});

// A fit of which one coefficient is no longer refitted, and keeps its value.
Fit with_fixed(Fit f, int coefficient);

// [-] By how many tolerances the declared parameter farthest off is off.
double farthest_off(const Problem& p, const Fit& f);
// The names of those that are farther off than `far` tolerances.
std::vector<std::string> off_by_more(const Problem& p, const Fit& f, double far);

// Could it be? A friction that is less one way than the other must still oppose the motion both ways.
bool sensible(const Machine& machine, const Fit& f);

// A fit at declared values and guessed starts, nothing adjusted.
Fit declared_fit(const Problem& p);

// A fit at values drawn from what it leaves open of them, starts as they are.
Fit drawn_values(const Problem& p, const Fit& f, Random& random);

// chi squared of each of the segments named, in their order; infinite where the machine cannot follow.
std::vector<double> chi2_of_each(const Problem& p, const std::vector<int>& segments, const Fit& f);

// Residuals of the segments named, measured minus model [unit]; 0 where nothing was measured; empty for the others.
std::vector<Eigen::VectorXd> residuals(const Problem& p, const std::vector<int>& segments, const Fit& f);

// Sensitivities of the whitened, start-eliminated data at a fit.
struct Signatures {
  std::vector<int> nuisance;         // coefficients refitted with their priors
  std::vector<int> candidates;       // the others asked for
  Eigen::MatrixXd N, C;              // (rows x nuisance), (rows x candidates), starts projected out
  Eigen::VectorXd r;                 // (rows) whitened residual
  std::vector<Eigen::Index> offset;  // first row of each segment
};
// The same with a coefficient that was refitted among the candidates.
Signatures released(const Signatures& s, int coefficient);
Signatures signatures(const Problem& p, const std::vector<int>& segments, const Fit& f,
                      const std::vector<int>& candidates);

}  // namespace saltus::diagnosis
