// The parts of a diagnosis of a record that a clock paces.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "diagnosis.hpp"
#include "search.hpp"

namespace saltus::diagnosis {

// What is asked of a record.
struct Question {
  // Lays the record out and fits the declared model's starts, or throws RecordError saying what to mend. Steps are as
  // short as the declared model needs, and no longer than `longest_step` [s].
  Question(const Record& record, const Machine& m, const Options& options, Repeats taken, double longest_step);
  Question(const Question&) = delete;

  const Machine& machine;
  Data data;
  Problem p;
  std::vector<int> all, train, test;         // segments
  std::vector<int> candidates;               // coefficients
  std::vector<Search::Repeating> repeating;  // forces, asked when none of those is it
  Fit declared;                              // declared values, starts fitted

  // Is there a part that is held out, and one to fit?
  bool split() const { return !test.empty() && !train.empty(); }
  // Values fixed, starts free: how well does it predict data it was not fitted to?
  Fit predict(const std::vector<int>& segments, const Fit& f) const;
  // The held-out part, predicted with effects fitted without it. `drawn`: set where not the fitted values do but others
  // that the fitted part leaves open.
  Fit on_held_out(const Fit& f, const std::vector<int>& effects, bool* drawn = nullptr) const;
};

// chi squared where nothing but noise is left.
double expected_chi2(const Problem& p, const std::vector<int>& segments);

// What was found.
struct Answer {
  Fit refit;  // nothing but the declared parameters
  Trial chosen;
  Gate before, after;
  std::vector<Search::Swap> swaps;
  std::vector<Search::Interval> intervals;  // of the effects found
  std::vector<std::pair<int, int>> ties;    // effect chosen, its twin
  std::vector<int> doubted;                 // effects chosen in whose place any force that repeats may be
  Fit held_refit, held_after;               // the held-out part predicted; empty where there is none

  // What the verdict stands for: with the effects where they explain the record.
  const Fit& final_fit(Verdict v) const { return v == Verdict::unexplained ? refit : chosen.fit; }
};

// The tables, with what they give cause to note.
void list_findings(Diagnosis& d, const Question& q, const Answer& a);
void list_parameters(Diagnosis& d, const Question& q, const Answer& a);
void list_errors(Diagnosis& d, const Question& q, const Answer& a, const Search& search);
void list_candidates(Diagnosis& d, const Question& q, const Answer& a, const Search& search);
void list_data(Diagnosis& d, const Question& q);

}  // namespace saltus::diagnosis
