// What is known of a limit cycle, in plain data: every model's in the same form, so that its analysis, its tables and
// its pictures are compiled once.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/orbit/analysis.hpp"
#include "core/orbit/assumptions.hpp"

namespace saltus {

inline constexpr int orbit_width = 6;  // room for the charts of every model
using WideCycle = Cycle<orbit_width>;
using WideAnalysis = CycleAnalysis<orbit_width>;
using WideMultipliers = ConditionedMultipliers<orbit_width>;
static_assert(sizeof(WideCycle) <= 16384 && sizeof(WideAnalysis) <= 16384);  // no object of core's is larger

// Expensive to compile, so compiled once.
extern template WideAnalysis analyse<orbit_width>(const WideCycle&, const WideCycle&) noexcept;
extern template WideMultipliers multipliers_at<orbit_width>(const WideCycle&, const WideCycle&, int, Bounds) noexcept;
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
  std::int64_t ticks = 0;  // a return, of the coarser computation; the numbers are of the finer one, with twice as many
  int returns = 1;         // a cycle
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
  int compared = 0;      // of how many

  double energy_drift = -1.0;  // along the legs, relative; negative: the model has no energy

  std::string x_label, y_label;
  std::vector<Series> portrait;
  std::vector<std::pair<std::string, std::vector<std::pair<double, double>>>> marks;  // events in the portrait

  std::vector<std::string> notes;

  double period() const { return fine.period(); }
  double modulus() const { return std::abs(multipliers.value[0]); }  // the largest
  // Whether all moduli are below 1 with their errors; none where these leave it open, or nothing can be trusted.
  std::optional<bool> stable() const;
  bool superstable() const { return multipliers.nonzero + multipliers.untold == 0; }
};

// A sentence on why no limit cycle was found, or why its numbers cannot be trusted; empty when they can.
std::string explain(const Search& search, const std::vector<std::string>& edges);
std::string explain(const OrbitReport& report);

}  // namespace saltus
