// Where a machine that paces itself passes its Poincare sections: stays in charts between events, the output that tells
// the phase, levels that it passes, and passages located on interpolated data.
#pragma once

#include <Eigen/Core>

#include <algorithm>
#include <string>
#include <vector>

#include "median.hpp"
#include "rhythm.hpp"

namespace saltus::rhythm {

inline std::size_t at(Eigen::Index i) { return static_cast<std::size_t>(i); }
double quantile(std::vector<double> v, double q);

// A stay in one chart, from one event to the next.
struct Visit {
  int chart = 0;
  std::size_t first = 0, rows = 0;  // without what rings
  double begin = 0.0, end = 0.0;    // [s] of the events
  int next = -1, previous = -1;     // the stays it is joined to by events
  std::vector<Eigen::VectorXd> x;   // (sections) coordinates; empty where not located
  std::vector<double> when, input;  // (sections) [s]; the input's mean from there to the next section
};

// The stays of a record, and where the machine passed its sections.
struct Passages {
  const Record* record = nullptr;
  double spacing = 0.0;  // [s]
  std::vector<Visit> visits;
  std::vector<int> order;  // charts of a cycle
  std::vector<std::vector<double>> y;
  std::vector<int> rate_of;         // (outputs) the output that it is the rate of, -1 for none
  std::vector<bool> rate_measured;  // (outputs) another one is its rate
  std::size_t phase = 0;            // the output that passes
  int per_chart = 0;
  std::vector<double> level;  // (sections)
  Eigen::Index dim = 0;       // coordinates

  int sections() const { return per_chart * static_cast<int>(order.size()); }
  int place(const Visit& v) const {
    return static_cast<int>(std::find(order.begin(), order.end(), v.chart) - order.begin()) * per_chart;
  }
};

// The stay and the section that come `ahead` sections after (before, where negative); null where the record is cut.
struct Place {
  const Visit* visit = nullptr;
  int j = 0;
  const Eigen::VectorXd* x() const {
    return visit != nullptr && visit->x[static_cast<std::size_t>(j)].size() > 0 ? &visit->x[static_cast<std::size_t>(j)]
                                                                                : nullptr;
  }
};
Place from_here(const Passages& w, const Visit& v, int j, int ahead);

// Finds them all, throws RecordError where there are none to speak of. `noise` (sections x coordinates) [unit^2], sums,
// is what locating them leaves, `count` (sections) how many were located.
Passages find_passages(const Record& record, const RhythmOptions& o, Eigen::MatrixXd& noise, Eigen::VectorXd& count,
                       Rhythm& r);

}  // namespace saltus::rhythm
