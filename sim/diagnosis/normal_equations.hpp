// The least squares of a fit, linear about one: whitened residuals, sensitivities, and the normal equations they sum
// to, from which the starts are eliminated segment by segment.
#pragma once

#include <Eigen/Core>

#include <limits>
#include <vector>

#include "fit.hpp"

namespace saltus::diagnosis {

struct Arrow {             // normal equations of one segment, its start apart
  Eigen::MatrixXd ss, sg;  // (starts x starts), (starts x free)
  Eigen::VectorXd s;       // (starts)
  Eigen::MatrixXd J;       // (rows x starts + free) whitened sensitivities
};

struct Normal {
  std::vector<Arrow> arrows;
  Eigen::MatrixXd gg;
  Eigen::VectorXd g;
  bool ok = true;
  Status status = Status::ok;
};

// Whitened residuals of the segments at a fit, and what they sum to.
struct Cost {
  std::vector<Eigen::VectorXd> r;  // (segments)(rows)
  double chi2 = 0.0, start_penalty = 0.0;
  bool ok = true;
  Status status = Status::ok;

  double total(const Fit& f) const {
    return ok ? chi2 + start_penalty + f.penalty : std::numeric_limits<double>::infinity();
  }
};

Cost cost_at(const Problem& p, const std::vector<int>& segments, const Fit& f);

// Sensitivities at a fit whose residuals are known.
Normal normal_equations(const Problem& p, const std::vector<int>& segments, const Fit& f, const Cost& cost);

// The right-hand sides for these residuals, with the sensitivities that are there.
void renew_gradient(const Problem& p, const std::vector<int>& segments, const Fit& f, const Cost& cost, Normal& n);

// Of a coefficient's declared value: one over the square of its tolerance, 0 where it has none.
double prior_of(const Problem& p, int coefficient);
double penalty_of(const Problem& p, const std::vector<double>& values);

// Starts eliminated: the information on the free coefficients and their gradient.
struct Reduced {
  Eigen::MatrixXd h;
  Eigen::VectorXd g;
  std::vector<Eigen::MatrixXd> back;    // (segments) what a step of the coefficients takes from the start's own
  std::vector<Eigen::VectorXd> back_r;  // (segments) that
};
Reduced reduce(const Problem& p, const Fit& f, const Normal& n, double damping);

}  // namespace saltus::diagnosis
