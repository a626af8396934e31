// What is known of a limit cycle, in plain data: every model's in the same form, so that its analysis, its tables and
// its pictures are compiled once.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "core/orbit/analysis.hpp"
#include "core/orbit/assumptions.hpp"

namespace saltus {

inline constexpr int orbit_width = 8;  // room for the charts of every model
using WideCycle = Cycle<orbit_width>;
using WideAnalysis = CycleAnalysis<orbit_width>;
using WideMultipliers = ConditionedMultipliers<orbit_width>;

// Expensive to compile, so compiled once.
extern template WideAnalysis analyse<orbit_width>(const WideCycle&, const WideCycle&) noexcept;
extern template WideMultipliers multipliers_at<orbit_width>(const WideCycle&, const WideCycle&, int) noexcept;
extern template std::array<double, orbit_width> singular_values<orbit_width>(
    const Mat<orbit_width, orbit_width>&) noexcept;

struct OrbitReport {
  struct State {
    std::string chart;
    std::vector<double> x;
  };
  struct Event {
    std::string edge;
    double t = 0.0;  // [s] after section 0
    State before, after;
  };
  struct Series {  // a curve of the phase portrait
    std::string title, chart;
    bool transient = false;
    std::vector<std::pair<double, double>> points;
  };

  std::string model;
  std::vector<std::string> charts, edges;
  std::int64_t ticks = 0;  // of the coarser computation; the numbers are of the finer one, with twice as many
  Search search;
  WideCycle coarse, fine;
  WideAnalysis analysis;
  Periodicity periodicity;
  std::vector<ResetSample<orbit_width>> resets;
  double reset_reach = 0.0;  // [-] distance of the samples

  std::string sections;  // "clock", "kinematic", or an edge
  int sections_met = 1, sections_asked = 1;
  State fixed_point;            // on section 0
  WideMultipliers multipliers;  // there
  std::vector<Event> events;
  double spread = 0.0;   // largest distance of the non-zero multipliers over all sections, guards and charts
  double allowed = 0.0;  // what their errors allow

  double energy_drift = -1.0;  // along the legs, relative; negative: the model has no energy

  std::string x_label, y_label;
  std::vector<Series> portrait;
  std::vector<std::pair<std::string, std::vector<std::pair<double, double>>>> marks;  // events in the portrait

  std::vector<std::string> notes;

  double period() const { return fine.period(); }
  // The largest modulus, and its error.
  double modulus() const;
  double modulus_error() const;
  bool stable() const { return modulus() + modulus_error() < 1.0; }
};

// A sentence on why no limit cycle was found, or why its numbers cannot be trusted; empty when they can.
std::string explain(const Search& search, const std::vector<std::string>& edges);
std::string explain(const OrbitReport& report);

}  // namespace saltus
