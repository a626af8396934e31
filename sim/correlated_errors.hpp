// Private to multiplier_region(): errors that go together within a line, the covariance that they give the common
// denominator, and noise drawn like them.
#pragma once

#include <vector>

#include "common_denominator.hpp"
#include "core/random.hpp"
#include "identification.hpp"

namespace saltus::common_denominator {

// The estimates of one line: the series and the row where each stands, as its conjugate where `mirrored`, and how their
// errors go together.
struct Errors {
  struct Place {
    std::size_t series;
    Eigen::Index row;
    bool mirrored;
  };
  std::vector<Place> place;
  Eigen::MatrixXcd correlation;
  double own = 0.0;  // complex degrees of freedom of the line's own repeats
};

// Of the lines of p, in their order; empty where one of them has no repeats to tell.
std::vector<Errors> errors_of(const Identification& id, const Problem& p, const std::vector<HtfEstimate>& lines);

// Covariance of the solution where the errors of a line go together, the weights being those of errors that do not:
// M^-1 (sum over the lines of S* C S / 2) M^-1 (Eicker, Huber & White). A line's errors are circular, those of
// different lines independent.
struct Sandwich {
  Eigen::MatrixXd covariance;
  double freedom = 0.0;  // real, by Satterthwaite's rule: each line tells with what its own repeats do
};

Sandwich covariance_of(const Problem& p, const Solution& s, const std::vector<Errors>& errors);

// Noise of every series in units of its sigma, as the errors go together or, where nothing tells, independent.
std::vector<Eigen::VectorXcd> draw(const Problem& p, const std::vector<Errors>& errors, Random& random);

}  // namespace saltus::common_denominator
