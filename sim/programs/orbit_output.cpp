#include "orbit_output.hpp"

#include <cmath>
#include <cstdio>

#include "program.hpp"

namespace saltus::program {
namespace {

using Json = nlohmann::json;

std::string edge_name(const OrbitReport& r, int edge) {
  return edge < 0 ? "section" : r.edges[static_cast<std::size_t>(edge)];
}
std::string chart_name(const OrbitReport& r, int chart) { return r.charts[static_cast<std::size_t>(chart)]; }

Json json_of(const WideMultipliers& m) {
  Json j = Json::array();
  for (int i = 0; i < m.dim; ++i) {
    const auto at = static_cast<std::size_t>(i);
    j.push_back({{"re", m.value[at].real()}, {"im", m.value[at].imag()}, {"error", m.error[at]}});
  }
  return j;
}
Json json_of(const Bounds& b) { return {b.lower, b.upper}; }
Json json_of(const OrbitReport::State& s) { return {{"chart", s.chart}, {"state", s.x}}; }
Json sigma_of(const Rank<orbit_width>& r, int count) {
  return std::vector<double>(r.sigma.begin(), r.sigma.begin() + count);
}

// "0.588351520 + 0.508407103i"; conjugates and equal zeros are told once.
std::string spectrum(const WideMultipliers& m, int digits) {
  std::string s;
  for (int i = 0; i < m.nonzero; ++i) {
    const Complex z = m.value[static_cast<std::size_t>(i)];
    if (z.imag() < 0.0) continue;
    s += s.empty() ? "" : ", ";
    char text[96];
    if (z.imag() == 0.0) {
      std::snprintf(text, sizeof text, "%.*f", digits, z.real());
    } else {
      std::snprintf(text, sizeof text, "%.*f +- %.*fi", digits, z.real(), digits, z.imag());
    }
    s += text;
  }
  const int zeros = m.dim - m.nonzero;
  if (zeros > 0) s += (s.empty() ? "" : ", ") + std::string(zeros > 1 ? std::to_string(zeros) + " times 0" : "0");
  return s;
}

std::string reasons(const ZeroMultipliers& z) {
  std::string s;
  const auto add = [&](int count, const char* why) {
    if (count > 0) s += (s.empty() ? "" : ", ") + std::to_string(count) + " " + why;
  };
  add(z.section, "section projection");
  add(z.dimension, "drop of dimension");
  add(z.reset, "rank of a reset");
  add(z.chain, "composition");
  add(z.nilpotent, "nilpotent");
  add(z.untold, "zero within the error");
  return s;
}

void print_state(const char* what, const OrbitReport::State& s) {
  std::printf("%s%s (", what, s.chart.c_str());
  for (std::size_t i = 0; i < s.x.size(); ++i)
    std::printf("%s%.10g", i == 0 ? "" : ", ", std::abs(s.x[i]) < 5e-14 ? 0.0 : s.x[i]);
  std::printf(")\n");
}

// "3", or where a theorem tells more than the numbers do, "3 (>= 2)".
std::string rank_text(const Rank<orbit_width>& r) {
  return std::to_string(r.value) + (r.counted < r.value ? " (>= " + std::to_string(r.counted) + ")" : "");
}

bool said_before(const OrbitReport& r, int j) {
  for (int k = 0; k < j; ++k) {
    if (r.fine[k].chart == r.fine[j].chart) return true;
  }
  return false;
}

void print_multipliers(const OrbitReport& r) {
  std::printf("\n  multipliers on section 0           error     modulus\n");
  for (int i = 0; i < r.multipliers.nonzero; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const Complex z = r.multipliers.value[at];
    std::printf("  %17.12f %+17.12fi  %7.1e  %.10f\n", z.real(), z.imag(), r.multipliers.error[at], std::abs(z));
  }
  const auto told = static_cast<std::size_t>(r.multipliers.nonzero + r.multipliers.untold);
  for (auto i = static_cast<std::size_t>(r.multipliers.nonzero); i < told; ++i) {
    std::printf("  %17s %18s  %7.1e\n", "0 within", "", r.multipliers.error[i]);
  }
  const int zeros = r.multipliers.dim - static_cast<int>(told);
  if (zeros > 0) {
    const std::string times = zeros == 1 ? "once 0" : std::to_string(zeros) + " times 0";
    std::printf("  %17s %18s  %7.1e\n", times.c_str(), "", r.multipliers.error[told]);
  }
  if (r.superstable()) {
    std::printf("  superstable: a perturbation is forgotten within %d passage%s\n", r.multipliers.index,
                r.multipliers.index == 1 ? "" : "s");
  }
  std::printf("  the non-zero ones agree on %d sections and guards within %.1e (their errors allow %.1e)\n", r.compared,
              r.spread, r.allowed);
}

void print_maps(const OrbitReport& r) {
  std::printf("\n  chart (its guard)     dimension  rank DP  Theorem %d  non-zero  zero multipliers because of\n",
              r.fine.count == 1 ? 3 : 4);
  for (int j = 0; j < r.fine.count; ++j) {
    const auto& g = r.analysis.guard[static_cast<std::size_t>(j)];
    const std::string label = chart_name(r, r.fine[j].chart) + " (" + edge_name(r, r.fine[j].edge) + ")";
    std::printf("  %-24s %6d  %7s     [%d, %d]  %8d  %s\n", label.c_str(), r.fine[j].dim, rank_text(g.rank).c_str(),
                g.bounds.lower, g.bounds.upper, g.spectrum.nonzero, reasons(g.zeros).c_str());
  }
  std::vector<EdgeRank> ranks;
  for (int j = 0; j < r.fine.count; ++j) ranks.push_back(r.analysis.edge[static_cast<std::size_t>(j)].rank);
  std::printf(
      "\n  edge                  rank DR  rank DP_e  Lemma 3  angle to guard (A2)  image to flow      rank constant "
      "(A3)\n");
  for (int j = 0; j < r.fine.count; ++j) {
    const auto& e = r.analysis.edge[static_cast<std::size_t>(j)];
    const std::string image = number(e.image_angle, "%.4f") + " +- " + number(e.image_tolerance, "%.0e");
    std::printf("  %-20s %8d  %9s   [%d, %d]  %19.4f  %-17s  margin %.1e\n", edge_name(r, r.fine[j].edge).c_str(),
                e.reset.value, rank_text(e.map).c_str(), e.bounds.lower, e.bounds.upper, e.guard_angle,
                e.rank.transverse ? image.c_str() : (e.rank.decreasing() ? "not needed" : "NOT transverse"),
                r.resets[static_cast<std::size_t>(j)].margin(e.reset.value));
  }
  std::printf(
      "  decreasing edges m = %d; angles are sines, 0 is tangential; A3 sampled %g away, its margin is the smallest\n"
      "  singular value that counts there, over its error\n",
      decreasing_edges(ranks), r.reset_reach);
  std::printf("\n  leg                            duration [s]    rank Dphi  eigenvalues of Dphi_tau\n");
  for (int j = 0; j < r.fine.count; ++j) {
    const auto& l = r.analysis.leg[static_cast<std::size_t>(j)];
    const Leg<orbit_width>& leg = r.fine[j].leg;
    const std::string label = chart_name(r, leg.chart) + " to " + edge_name(r, r.fine[j + 1].edge);
    std::printf("  %-28s %16.12f  %4s of %d  %s\n", label.c_str(), leg.duration, rank_text(l.total).c_str(), leg.dim,
                spectrum(l.eigenvalues, 9).c_str());
  }
  double invariant = 0.0;
  double kernel = 0.0;
  double one = 0.0;
  double margin = std::numeric_limits<double>::infinity();
  bool proved = false;
  for (int j = 0; j < r.fine.count; ++j) {
    const auto at = static_cast<std::size_t>(j);
    invariant = std::fmax(invariant, r.analysis.leg[at].invariant);
    kernel = std::fmax(kernel, r.analysis.leg[at].kernel);
    one = std::fmax(one, r.analysis.guard[at].one);
    for (const auto* rank : {&r.analysis.edge[at].reset, &r.analysis.edge[at].map, &r.analysis.leg[at].total,
                             &r.analysis.guard[at].rank}) {
      margin = std::fmin(margin, rank->margin);
      proved = proved || rank->counted < rank->value;
    }
  }
  std::printf(
      "  Phi f = f along every leg within %.1e, Dphi_tau f = 0 within %.1e, Phi_T f = f round the cycle within %.1e:\n",
      invariant, kernel, one);
  std::printf("  the trivial multiplier 1 of the flow's direction belongs to Phi_T, not to the return map\n");
  std::printf("  every singular value that counts is at least %.1e times its error\n", margin);
  if (proved)
    std::printf(
        "  (>= n): numerically the rank is at least n; that it is more follows from Theorem 1, 3 or 4, or Lemma 3\n");
}

}  // namespace

Json orbit_json(const OrbitReport& r) {
  Json j{{"model", r.model}, {"period", r.period()}, {"sections", r.sections}, {"ticks", r.ticks}, {"notes", r.notes}};
  j["fixed_point"] = json_of(r.fixed_point);
  j["events"] = Json::array();
  for (const auto& e : r.events) {
    j["events"].push_back({{"edge", e.edge}, {"t", e.t}, {"before", json_of(e.before)}, {"after", json_of(e.after)}});
  }
  j["charts"] = Json::object();
  const auto stable = r.stable();
  j["stable"] = stable ? Json(*stable) : Json();
  const std::string doubt = explain(r);
  if (!doubt.empty()) {
    j["doubt"] = doubt;
    j["multipliers"] = nullptr;
    return j;
  }
  j["superstable"] = r.superstable();
  j["multipliers"] = json_of(r.multipliers);
  j["spread"] = {{"value", r.spread},
                 {"allowed", r.allowed},
                 {"compared", r.compared},
                 {"sections_met", r.sections_met},
                 {"sections_asked", r.sections_asked}};
  j["edges"] = Json::array();
  j["legs"] = Json::array();
  for (int k = 0; k < r.fine.count; ++k) {
    const auto at = static_cast<std::size_t>(k);
    const auto& map = r.fine[k];
    const auto& g = r.analysis.guard[at];
    const auto& e = r.analysis.edge[at];
    const auto& l = r.analysis.leg[at];
    if (!said_before(r, k)) {
      j["charts"][chart_name(r, map.chart)] = {{"dim", map.dim},
                                               {"rank", g.rank.value},
                                               {"rank_counted", g.rank.counted},
                                               {"rank_bounds", json_of(g.bounds)},
                                               {"trivial", g.zeros.total()},
                                               {"nonzero", g.spectrum.nonzero},
                                               {"zeros",
                                                {{"section", g.zeros.section},
                                                 {"dimension", g.zeros.dimension},
                                                 {"reset", g.zeros.reset},
                                                 {"composition", g.zeros.chain},
                                                 {"nilpotent", g.zeros.nilpotent},
                                                 {"untold", g.zeros.untold}}},
                                               {"passages_to_forget", g.spectrum.index},
                                               {"multipliers", json_of(g.spectrum)},
                                               {"singular_values", sigma_of(g.rank, map.dim)},
                                               {"tolerance", g.rank.tolerance},
                                               {"flow_multiplier_error", g.one}};
    }
    j["edges"].push_back({{"edge", edge_name(r, map.edge)},
                          {"from", chart_name(r, map.chart)},
                          {"to", chart_name(r, map.leg.chart)},
                          {"rank_reset", e.reset.value},
                          {"rank", e.map.value},
                          {"rank_bounds", json_of(e.bounds)},
                          {"decreasing", e.rank.decreasing()},
                          {"guard_angle", e.guard_angle},
                          {"image_angle", e.image_angle},
                          {"image_tolerance", e.image_tolerance},
                          {"image_transverse", e.rank.transverse},
                          {"constant_rank", r.resets[at].constant(e.reset.value)},
                          {"constant_rank_margin", r.resets[at].margin(e.reset.value)}});
    j["legs"].push_back({{"chart", chart_name(r, map.leg.chart)},
                         {"to", edge_name(r, r.fine[k + 1].edge)},
                         {"duration", map.leg.duration},
                         {"rank", l.total.value},
                         {"eigenvalues", json_of(l.eigenvalues)},
                         {"invariant", l.invariant},
                         {"kernel", l.kernel}});
  }
  j["periodicity"] = {{"mismatch", r.search.residual},
                      {"same_order", r.periodicity.same_order},
                      {"time", r.periodicity.time},
                      {"state", r.periodicity.state},
                      {"allowed", r.periodicity.allowed}};
  return j;
}

void print_orbit(const OrbitReport& r) {
  const std::string doubt = explain(r);
  std::printf("%s: limit cycle of period %.12f s", r.model.c_str(), r.period());
  const auto stable = r.stable();
  if (stable || doubt.empty()) {
    std::printf(", %s (largest modulus %.9f)", !stable ? "at the edge of stability" : (*stable ? "stable" : "unstable"),
                r.modulus());
  }
  std::printf(
      "\n  by Newton's method to a mismatch of %.1e; all numbers at %lld steps a %s, errors from half as many\n",
      r.search.residual, static_cast<long long>(2 * r.ticks), r.returns > 1 ? "return" : "cycle");
  std::printf("  A1, Definition 4: a second round %s, %.1e s and a relative %.1e off (%.1e allowed)\n",
              r.periodicity.same_order ? "has the same events" : "has OTHER events", r.periodicity.time,
              r.periodicity.state, r.periodicity.allowed);
  if (r.energy_drift >= 0.0) std::printf("  energy is kept along the legs within a relative %.1e\n", r.energy_drift);
  if (r.sections_asked > 1) {
    std::printf("  sections: %s, %d of %d met\n", r.sections.c_str(), r.sections_met, r.sections_asked);
  } else {
    std::printf("  section: the guard of %s\n", r.sections.c_str());
  }
  print_state("  section 0: ", r.fixed_point);
  std::printf("\n  t [s]            event\n");
  for (const auto& e : r.events) {
    std::printf("  %.12f  %s\n", e.t, e.edge.c_str());
    print_state("                     before ", e.before);
    print_state("                     after  ", e.after);
  }
  if (doubt.empty()) {
    print_multipliers(r);
    print_maps(r);
  }
  for (const std::string& note : r.notes) std::printf("\n  note: %s\n", note.c_str());
}

}  // namespace saltus::program
