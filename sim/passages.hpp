// Where a machine that paces itself passes its Poincare sections: stays in charts between events, the output that tells
// the phase, levels that it passes, and passages located on interpolated data.
#pragma once

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "median.hpp"
#include "rhythm.hpp"

namespace saltus::rhythm {

inline std::size_t at(Eigen::Index i) { return static_cast<std::size_t>(i); }
double quantile(std::vector<double> v, double q);

// A stay in one chart, from one event to the next; or, by the kinematic phase, a turn.
struct Visit {
  int chart = 0;
  std::size_t first = 0, rows = 0;  // without what rings
  double begin = 0.0, end = 0.0;    // [s] of the events
  int next = -1, previous = -1;     // the stays it is joined to by events
  std::vector<Eigen::VectorXd> x;   // (sections) coordinates; empty where not located
  std::vector<double> when, input;  // (sections) [s]; the input's mean from there to the next section
};

// An output and its rate, of which the angle about a point is the phase (Ankarali & Cowan 2014, VI.B).
struct PhasePlane {
  std::size_t output = 0;
  int rate = -1;                // the output that is its rate; -1: it is told from the output
  double o_p = 0.0, s_p = 1.0;  // [unit of the output] origin and scale
  double o_v = 0.0, s_v = 1.0;  // [unit of the output/s]
};

// The stays of a record, and where the machine passed its sections.
struct Passages {
  const Record* record = nullptr;
  double spacing = 0.0;     // [s]
  std::vector<int> stay;    // (rows) between two events, counted; -1 where it rings
  std::size_t ringing = 0;  // [row] on either side of an event
  std::vector<Visit> visits;
  std::vector<int> order;  // charts of a cycle
  std::vector<std::vector<double>> y;
  std::vector<int> rate_of;         // (outputs) the output that it is the rate of, -1 for none
  std::vector<bool> rate_measured;  // (outputs) another one is its rate
  std::size_t phase = 0;            // the output that passes
  std::optional<PhasePlane> plane;  // what passes instead: its angle
  int per_chart = 0;
  std::vector<double> level;  // (sections) [unit of the output], or [turn]
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

inline constexpr Eigen::Index half_window = 6;  // [sample] of the parabola about a passage, on either side
inline constexpr double gap = 2.5;              // [-] of the usual spacing: beyond it samples are missing

// Samples of a record, or of a model that is run beside it.
struct Samples {
  const std::vector<double>& t;               // (n) [s]
  const std::vector<std::vector<double>>& y;  // (outputs)(n)
  const std::vector<int>& stay;               // (n)
};

// What passes, sample by sample: an output, or the angle [turn] about the point of the plane, from 0 to 1 and rising in
// time; NaN where it is not told.
std::vector<double> phase_of(const Passages& w, const Samples& s);

// A passage of a section within `rows` samples from `from` on.
struct Located {
  double when = 0.0;            // [s]
  Eigen::VectorXd x, variance;  // (coordinates); what locating adds to them
};
std::optional<Located> locate(const Passages& w, const Samples& s, const std::vector<double>& phase, std::size_t from,
                              std::size_t rows, int section);

// Stays and what joins them; throws RecordError where nothing marks the events, unless there need not be any.
void find_visits(Passages& w, double exclude, bool marked);
// Which outputs are rates of others: by their units and by what they say.
void find_rates(Passages& w);
// Names and units of the coordinates of a section.
void name_coordinates(Passages& w, Rhythm& r);
// Locates the passages of one stay.
void pass(const Passages& w, const Samples& s, const std::vector<double>& phase, Visit& v, Eigen::MatrixXd& noise,
          Eigen::VectorXd& count);
// The mean input from every passage to the next.
void add_inputs(Passages& w);

// Finds them all, throws RecordError where there are none to speak of. `noise` (sections x coordinates) [unit^2], sums,
// is what locating them leaves, `count` (sections) how many were located.
Passages find_passages(const Record& record, const RhythmOptions& o, Eigen::MatrixXd& noise, Eigen::VectorXd& count,
                       Rhythm& r);

}  // namespace saltus::rhythm
