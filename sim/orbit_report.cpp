#include "orbit_report.hpp"

#include <cstdio>

namespace saltus {
namespace {

std::string text(const char* format, double x) {
  char r[64];
  std::snprintf(r, sizeof r, format, x);
  return r;
}
std::string edge_name(const std::vector<std::string>& edges, int edge) {
  return edge < 0 ? "the section" : edges[static_cast<std::size_t>(edge)];
}

}  // namespace

template WideAnalysis analyse<orbit_width>(const WideCycle&, const WideCycle&) noexcept;
template WideMultipliers multipliers_at<orbit_width>(const WideCycle&, const WideCycle&, int, Bounds) noexcept;
template std::array<double, orbit_width> singular_values<orbit_width>(const Mat<orbit_width, orbit_width>&) noexcept;

std::optional<bool> OrbitReport::stable() const {
  double most = 0.0;
  double least = 0.0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(multipliers.dim); ++i) {
    most = std::max(most, std::abs(multipliers.value[i]) + multipliers.error[i]);
    least = std::max(least, std::abs(multipliers.value[i]) - multipliers.error[i]);
  }
  if (multipliers.dim == 0 || !(most < 1.0 || least > 1.0)) return {};
  return most < 1.0;
}

std::string explain(const Search& s, const std::vector<std::string>& edges) {
  const std::string after = s.after < 0 ? "from the start " : "after " + edge_name(edges, s.after) + " ";
  switch (s.outcome) {
    case SearchOutcome::found:
      return {};
    case SearchOutcome::no_convergence:
      return "Newton's method stands still at a mismatch of " + text("%.2g", s.residual);
    case SearchOutcome::other_event:
      return after + edge_name(edges, s.met) + " comes where " + edge_name(edges, s.expected) +
             " should: the gait changes its order of events";
    case SearchOutcome::no_event:
      return after + "no event follows: it comes to rest, falls or runs away";
    case SearchOutcome::fell:
      return after + "it falls";
    case SearchOutcome::no_cycle:
      return "its events do not repeat";
    case SearchOutcome::too_many:
      return "so many returns take more than " + std::to_string(max_cycle_events) +
             " events, which is all there is room for";
    case SearchOutcome::collapsed:
      return "the search ends in a state at rest, or chattering, where a cycle takes no time";
    case SearchOutcome::trouble:
      break;
  }
  switch (s.status) {
    case Status::zeno:
      return after + "events accumulate (chattering)";
    case Status::escaped:
      if (s.behind < 0) return after + "it leaves its chart without an event";
      if (s.behind == s.after) {
        return after + "it leaves its chart without an event, for it stays on the guard of " +
               edge_name(edges, s.behind) + ": events accumulate (chattering)";
      }
      return after + "it leaves its chart without an event, for the guard of " + edge_name(edges, s.behind) +
             " is passed already: the gait changes its order of events";
    case Status::diverged:
      return after + "a coordinate grows beyond all numbers";
    default:
      return after + "the flow reports '" + std::string(name(s.status)) + "'";
  }
}

std::string explain(const OrbitReport& r) {
  const int from = r.analysis.at % std::max(1, r.fine.count);
  const auto at = static_cast<std::size_t>(from);
  const std::string edge = r.fine.count > 0 ? edge_name(r.edges, r.fine.map[at].edge) : "";
  const std::string finer = r.analysis.finer ? "; try --ticks " + std::to_string(4 * r.ticks)
                                             : "; it is rounding that hides it, and smaller steps do not help";
  switch (r.analysis.doubt) {
    case Doubt::none:
      return {};
    case Doubt::other_order:
      return "half the step sees another order of events: one was missed" + finer;
    case Doubt::grazing:
      return edge + " is met almost tangentially (sine " + text("%.1e", transversality(r.fine.arrival(r.analysis.at))) +
             "): its time, the saltation matrix and every rank and multiplier through it are ill-conditioned";
    case Doubt::coarse:
      return "the derivative of the flow after " + edge + " does not agree with the flow (eq. 3)" + finer;
    case Doubt::undecided_rank:
      return "at " + edge + " a singular value lies too near its error for the rank to be told" + finer;
    case Doubt::undecided_image:
      return "whether the flow crosses the image of " + edge + " cannot be told, the sine is " +
             text("%.1e", r.analysis.edge[at].image_angle) + " +- " +
             text("%.1e", r.analysis.edge[at].image_tolerance) + finer;
    case Doubt::outside_bounds:
      return "a rank at " + edge + " lies outside its bounds: it was misjudged" + finer;
    case Doubt::unequal_spectra:
      return "the non-zero multipliers at " + edge +
             " differ from those at the other guards by more than their errors" + finer;
    case Doubt::not_isolated:
      return "at " + edge +
             " a multiplier is 1 but for rounding: the cycle is one of a family, or ends here in a fold, so that its "
             "state and its stability are not determined";
    case Doubt::not_periodic:
      return r.periodicity.same_order
                 ? "a second round ends a relative " + text("%.1e", r.periodicity.state) +
                       " off, more than what is left of Newton's method explains: it is no cycle (Definition 4)"
                 : "a second round has other events: it is no cycle (Definition 4)";
    case Doubt::rank_changes:
      return "the rank of the reset of " + edge +
             " is not constant around its guard (A3): bounds and rank mean nothing";
  }
  return {};
}

}  // namespace saltus
