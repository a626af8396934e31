#include "json.hpp"

#include <cmath>

namespace saltus::diagnosis {
namespace {

nlohmann::json number(double x) { return std::isfinite(x) ? nlohmann::json(x) : nlohmann::json(nullptr); }

nlohmann::json views_json(const std::vector<View>& views) {
  nlohmann::json j = nlohmann::json::array();
  for (const View& v : views) j.push_back({{"name", v.name}, {"ratio", number(v.ratio)}, {"freedom", v.freedom}, {"p", number(v.p)}});
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
    j["effects"].push_back({{"name", f.name}, {"value", f.value}, {"unit", f.unit}, {"ci95", {f.low, f.high}}, {"z", f.z}, {"ties", f.ties}});
  }
  j["parameters"] = json::array();
  for (const ParameterRow& p : d.parameters) {
    j["parameters"].push_back({{"name", p.name}, {"unit", p.unit}, {"declared", p.declared}, {"tolerance", p.tolerance},
                               {"refitted", p.refitted}, {"refitted_sigma", p.refitted_error},
                               {"with_effect", p.with_effect}, {"with_effect_sigma", p.with_effect_error}});
  }
  json rms;
  for (const OutputError& o : d.outputs) {
    rms[o.name] = {{"unit", o.unit}, {"before", o.before}, {"refit", o.refit}, {"after", o.after}, {"noise", o.noise}};
  }
  j["error"] = {{"before", number(d.all.before)}, {"refit", number(d.all.refit)}, {"after", number(d.all.after)},
                {"heldout_before", number(d.heldout.before)}, {"heldout_refit", number(d.heldout.refit)},
                {"heldout_after", number(d.heldout.after)}, {"excess_explained", number(d.excess_explained)},
                {"excess_explained_declared", number(d.excess_explained_declared)},
                {"chi2_refit", number(d.chi2_refit)}, {"chi2_after", number(d.chi2_after)}, {"dof", d.expected}, {"rms", rms}};
  j["candidates"] = j["detection_limits"] = json::array();
  for (const CandidateRow& c : d.candidates) {
    j["candidates"].push_back({{"name", c.name}, {"unit", c.unit}, {"z", number(c.z)}, {"value", number(c.value)}, {"bic", number(c.bic)},
                               {"heldout", number(c.heldout)}, {"kept", number(c.kept)}, {"remark", c.remark}});
    if (c.limit > 0.0) j["detection_limits"].push_back({{"name", c.name}, {"value", c.limit}, {"unit", c.unit}});
  }
  j["candidates_tried"] = d.tried;
  j["threshold"] = d.threshold;
  j["rivals"] = json::array();
  for (const Rival& r : d.rivals) j["rivals"].push_back({{"effects", r.names}, {"bic", r.bic}});
  j["twins"] = json::array();
  for (const Twin& t : d.twins) j["twins"].push_back({{"names", {t.first, t.second}}, {"cosine", t.cosine}});
  j["where"] = json::object();
  if (d.where.known) j["where"] = {{"chart", d.where.chart}, {"phase", {d.where.from, d.where.to}}, {"port", d.where.port}};
  j["force_profiles"] = json::array();
  for (const Profile& p : d.profiles) {
    j["force_profiles"].push_back({{"port", p.port}, {"unit", p.unit}, {"phase", p.phase}, {"force", p.force}, {"sigma", p.error}, {"explained", p.explained}});
  }
  j["views"] = {{"declared", views_json(d.views_declared)}, {"refit", views_json(d.views_refit)}, {"after", views_json(d.views_after)}};
  j["noise"] = json::object();
  for (std::size_t i = 0; i < d.noise.size(); ++i) j["noise"][d.output_names[i]] = {{"value", d.noise[i]}, {"unit", d.output_units[i]}};
  j["data"] = {{"experiments", d.experiments}, {"repeats", d.repeats}, {"held_out", d.held_out}, {"rows", d.quality.rows},
               {"missing", d.quality.missing}, {"outliers", d.quality.outliers}, {"filled_inputs", d.quality.filled_inputs}};
  j["separate"] = d.separate;
  j["story"] = d.story;
  j["notes"] = d.notes;
  j["seconds"] = json::object();
  for (const auto& [what, s] : d.seconds) j["seconds"][what] = s;
  return j;
}

}  // namespace saltus::diagnosis
