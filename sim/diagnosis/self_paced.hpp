// The parts of a diagnosis of a record that no clock paces.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis.hpp"
#include "selection.hpp"
#include "stretches.hpp"

namespace saltus::diagnosis {

// What is asked of a record, and what it is split into.
struct Work {
  Stretches s;
  Problem p;
  Eigen::VectorXd sensors;
  std::vector<int> train, test, lively;  // without the stretches in which nothing moves
  double held_from = 0.0;                // [s], where one experiment is split
};

// Cuts the record into stretches of a length [s], 0: chosen by the record, leaves out what says nothing, and holds a
// part out; says in `d` what it did.
Work lay_out(const Record& record, const Machine& machine, const Options& o, double length, Diagnosis& d);

// The part that each of so many stretches is left out with: quarters; of few stretches eighths at most, or so much of
// the motion would be missing that nothing tells the effects apart.
std::vector<int> parts_of(std::size_t stretches);

// Squares in units of the sensors' noise, and raw, on stretches whose starts are fitted.
struct Misfit {
  double squares = 0.0, n = 0.0;
  Eigen::VectorXd raw, count;
  double error() const { return std::sqrt(squares / std::max(1.0, n)); }
};
Misfit misfit(const Work& w, const std::vector<int>& segments, const Fit& values);

// Free runs of one length over the held-out part, or over the fitted one, into `d`.
struct Compared {
  const std::vector<double>&declared, &refit, &after;
};
// and say whether there were any.
bool run_free(Diagnosis& d, const Record& record, const Work& w, double horizon, bool held, const Compared& values,
              bool traces);

// Where the held-out part goes beyond what was fitted; empty where it does not.
std::string outside(const Work& w);

// What was found: on the fitted part, and of all of the record with that.
struct Found {
  Attempt part, all;
  Fit refit, all_refit;                // nothing but the declared parameters
  Eigen::VectorXd error, refit_error;  // of the free coefficients of `all`, of `all_refit`
  Evidence before, left;
  std::vector<Selection::Tie> ties;
  std::map<int, std::pair<double, double>> alone;  // Selection::alone()
};

// The tables of parameters and of candidates, with what they give cause to note.
void list_parameters(Diagnosis& d, const Work& w, const Found& f);
void list_candidates(Diagnosis& d, const Work& w, const Found& f);

}  // namespace saltus::diagnosis
