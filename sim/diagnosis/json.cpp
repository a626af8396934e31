#include "json.hpp"

#include <cmath>

namespace saltus::diagnosis {
namespace {

nlohmann::json number(double x) { return std::isfinite(x) ? nlohmann::json(x) : nlohmann::json(nullptr); }

nlohmann::json views_json(const std::vector<View>& views) {
  nlohmann::json j = nlohmann::json::array();
  for (const View& v : views)
    j.push_back({{"name", v.name}, {"ratio", number(v.ratio)}, {"freedom", v.freedom}, {"p", number(v.p)}});
  return j;
}

nlohmann::json self_paced_json(const Diagnosis& d) {
  using nlohmann::json;
  const SelfPaced& q = d.self_paced;
  json j{{"stretch_s", q.stretch},     {"spacing_s", q.spacing}, {"stretches", q.stretches},
         {"still", q.still},           {"fitted", q.fitted},     {"independent", q.independent},
         {"free_runs", json::array()}, {"steps", json::array()}, {"explained", json::object()}};
  for (std::size_t o = 0; o < q.explained.size(); ++o)
    j["explained"][d.output_names[o]] = static_cast<bool>(q.explained[o]);
  for (const Step& t : q.steps) {
    j["steps"].push_back({{"effect", t.effect},
                          {"beside", t.beside},
                          {"gain", number(t.gain)},
                          {"error_left", number(t.predicted)},
                          {"parts", t.parts},
                          {"better", t.better},
                          {"taken", t.taken}});
    if (t.instead.empty()) continue;
    j["steps"].back()["instead_of"] = t.instead;
    j["steps"].back()["free_run_ratio"] = number(t.free_run);
  }
  for (const FreeRun& f : q.runs) {
    for (std::size_t o = 0; o < f.after.size(); ++o) {
      // Angles in degrees.
      const std::string& unit = d.output_units[o];
      const bool angle = unit.substr(0, 3) == "rad";
      const double k = angle ? 57.295779513082323 : 1.0;
      json each = json::array();
      for (std::size_t i = 0; i < f.begin.size(); ++i) {
        const std::size_t ny = f.after.size();
        each.push_back({{"t", f.begin[i]},
                        {"before", k * f.each[o][i]},
                        {"refit", k * f.each[ny + o][i]},
                        {"after", k * f.each[2 * ny + o][i]}});
      }
      j["free_runs"].push_back({{"data", f.data},
                                {"unstable", f.unstable},
                                {"horizon_s", f.horizon},
                                {"output", d.output_names[o]},
                                {"unit", angle ? "deg" + unit.substr(3) : unit},
                                {"runs", f.runs},
                                {"lost", f.lost},
                                {"before", k * f.before[o]},
                                {"refit", k * f.refit[o]},
                                {"after", k * f.after[o]},
                                {"end_before", k * f.end_before[o]},
                                {"end_refit", k * f.end_refit[o]},
                                {"end_after", k * f.end_after[o]},
                                {"median_before", k * f.median_before[o]},
                                {"median_refit", k * f.median_refit[o]},
                                {"median_after", k * f.median_after[o]},
                                {"noise", k * d.noise[o]},
                                {"each", each}});
    }
  }
  return j;
}

}  // namespace

nlohmann::json to_json(const Diagnosis& d) {
  using nlohmann::json;
  json j;
  j["verdict"] = name(d.verdict);
  j["record"] = d.record;
  j["model"] = d.model;
  j["effects"] = json::array();
  for (const Finding& f : d.effects) {
    j["effects"].push_back({{"name", f.name},
                            {"value", f.value},
                            {"unit", f.unit},
                            {"ci95", {f.low, f.high}},
                            {"declared", f.declared},
                            {"z", f.z},
                            {"ties", f.ties}});
    if (std::isfinite(f.phase)) j["effects"].back()["phase"] = f.phase;
  }
  j["parameters"] = json::array();
  for (const ParameterRow& p : d.parameters) {
    j["parameters"].push_back({{"name", p.name},
                               {"unit", p.unit},
                               {"declared", p.declared},
                               {"tolerance", p.tolerance},
                               {"refitted", p.refitted},
                               {"refitted_sigma", p.refitted_error},
                               {"with_effect", p.with_effect},
                               {"with_effect_sigma", p.with_effect_error}});
  }
  json rms;
  for (const OutputError& o : d.outputs) {
    rms[o.name] = {{"unit", o.unit}, {"before", o.before}, {"refit", o.refit}, {"after", o.after}, {"noise", o.noise}};
  }
  j["error"] = {{"before", number(d.all.before)},
                {"refit", number(d.all.refit)},
                {"after", number(d.all.after)},
                {"heldout_before", number(d.heldout.before)},
                {"heldout_refit", number(d.heldout.refit)},
                {"heldout_after", number(d.heldout.after)},
                {"excess_explained", number(d.excess_explained)},
                {"excess_explained_declared", number(d.excess_explained_declared)},
                {"chi2_refit", number(d.chi2_refit)},
                {"chi2_after", number(d.chi2_after)},
                {"dof", d.expected},
                {"rms", rms}};
  j["candidates"] = j["detection_limits"] = json::array();
  for (const CandidateRow& c : d.candidates) {
    j["candidates"].push_back({{"name", c.name},
                               {"unit", c.unit},
                               {"z", number(c.z)},
                               {"value", number(c.value)},
                               {"bic", number(c.bic)},
                               {"heldout", number(c.heldout)},
                               {"kept", number(c.kept)},
                               {"remark", c.remark}});
    if (!(c.limit > 0.0)) continue;
    json limit{{"name", c.name}, {"value", c.limit}, {"unit", c.unit}};
    for (const Seen& s : c.clarity) limit["sizes"].push_back({s.size, s.z});
    j["detection_limits"].push_back(std::move(limit));
  }
  j["candidates_tried"] = d.tried;
  j["threshold"] = d.threshold;
  j["rivals"] = json::array();
  for (const Rival& r : d.rivals) {
    j["rivals"].push_back({{"effects", r.names}, {"bic", r.bic}});
    if (std::isfinite(r.predicted)) j["rivals"].back()["predicted"] = r.predicted;
  }
  j["twins"] = json::array();
  for (const Twin& t : d.twins) j["twins"].push_back({{"names", {t.first, t.second}}, {"cosine", t.cosine}});
  j["where"] = json::object();
  if (d.where.known)
    j["where"] = {{"chart", d.where.chart}, {"phase", {d.where.from, d.where.to}}, {"port", d.where.port}};
  j["force_profiles"] = json::array();
  for (const Profile& p : d.profiles) {
    j["force_profiles"].push_back({{"port", p.port},
                                   {"unit", p.unit},
                                   {"phase", p.phase},
                                   {"force", p.force},
                                   {"sigma", p.error},
                                   {"limit", p.limit},
                                   {"explained", p.explained}});
  }
  j["views"] = {{"declared", views_json(d.views_declared)},
                {"refit", views_json(d.views_refit)},
                {"after", views_json(d.views_after)}};
  j["noise"] = json::object();
  for (std::size_t i = 0; i < d.noise.size(); ++i)
    j["noise"][d.output_names[i]] = {{"value", d.noise[i]}, {"unit", d.output_units[i]}};
  j["data"] = {{"experiments", d.experiments},
               {"repeats", d.repeats},
               {"held_out", d.held_out},
               {"rows", d.quality.rows},
               {"missing", d.quality.missing},
               {"outliers", d.quality.outliers},
               {"filled_inputs", d.quality.filled_inputs}};
  if (d.self_paced.is) j["self_paced"] = self_paced_json(d);
  j["separate"] = d.separate;
  j["story"] = d.story;
  j["notes"] = d.notes;
  j["seconds"] = json::object();
  for (const auto& [what, s] : d.seconds) j["seconds"][what] = s;
  return j;
}

}  // namespace saltus::diagnosis
