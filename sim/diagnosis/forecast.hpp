// Free runs: started where the record is, driven as recorded, and left alone. What a model is good for.
#pragma once

#include <string>

#include "stretches.hpp"

namespace saltus::diagnosis {

// Errors of many runs of one length, by output [unit of the output].
struct FreeRun {
  std::string data;                          // what it was run on: "held out", "fitted"
  double horizon = 0.0;                      // [s]
  int runs = 0, lost = 0;                    // made, and of those not finished by one of the models
  int unstable = 0;                          // not made: there an error of the start grows more than twentyfold
  std::vector<double> before, refit, after;  // (outputs) root mean square over the runs
  std::vector<double> end_before, end_refit, end_after;           // (outputs) the same of the last tenth of each run
  std::vector<double> median_before, median_refit, median_after;  // (outputs) of the runs' root mean squares
  std::vector<double> begin;                                      // (runs) [s] of those finished
  std::vector<std::vector<double>> each;                          // (3 x outputs)(runs) declared, refitted, after
};

// A run to look at: the outputs measured and of the models.
struct Trace {
  std::size_t output = 0;
  std::vector<double> t, measured, refit, after;  // [s], [unit]
};

// The stretches are those of a record cut at the horizon. Each start is what the first samples ask of that model: a
// tenth of the run, ten samples at least and eighty at most.
FreeRun free_runs(const Problem& p, const std::vector<int>& segments, double horizon,
                  const std::vector<double>& declared, const std::vector<double>& refit,
                  const std::vector<double>& after, std::vector<Trace>* traces);

}  // namespace saltus::diagnosis
