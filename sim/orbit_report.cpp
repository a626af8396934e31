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
template WideMultipliers multipliers_at<orbit_width>(const WideCycle&, const WideCycle&, int) noexcept;
template std::array<double, orbit_width> singular_values<orbit_width>(const Mat<orbit_width, orbit_width>&) noexcept;

double OrbitReport::modulus() const { return multipliers.nonzero > 0 ? std::abs(multipliers.value[0]) : 0.0; }
double OrbitReport::modulus_error() const { return multipliers.nonzero > 0 ? multipliers.error[0] : 0.0; }

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
    case SearchOutcome::collapsed:
      return "the search ends in a state at rest, or chattering, where a cycle takes no time";
    case SearchOutcome::trouble:
      break;
  }
  switch (s.status) {
    case Status::zeno:
      return after + "events accumulate (chattering)";
    case Status::escaped:
      return after + "it leaves its chart without an event";
    case Status::diverged:
      return after + "a coordinate grows beyond all numbers";
    default:
      return after + "the flow reports '" + std::string(name(s.status)) + "'";
  }
}

std::string explain(const OrbitReport& r) {
  const auto at = static_cast<std::size_t>(r.analysis.at % std::max(1, r.fine.count));
  const std::string edge = r.fine.count > 0 ? edge_name(r.edges, r.fine.map[at].edge) : "";
  const std::string finer = "; try --ticks " + std::to_string(4 * r.ticks);
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
      return "at " + edge + " a singular value lies too near the tolerance for its rank to be told" + finer;
    case Doubt::outside_bounds:
      return "a rank at " + edge + " lies outside its bounds: it was misjudged" + finer;
    case Doubt::unequal_spectra:
      return "the non-zero multipliers at " + edge +
             " differ from those at the other guards by more than their errors" + finer;
    case Doubt::not_isolated:
      return "at " + edge +
             " a multiplier is 1 but for rounding: the cycle is one of a family, or ends here in a fold, so that its "
             "state and its stability are not determined";
  }
  return {};
}

}  // namespace saltus
