#include "identify_rhythm.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "../diagnosis/machines.hpp"
#include "../diagnosis/synthetic.hpp"
#include "../rhythm.hpp"
#include "declared.hpp"
#include "orbit_multipliers.hpp"
#include "rhythm_beside.hpp"

namespace saltus::program {
namespace {

// Refuses a record whose outputs or inputs are not the model's, by name and unit.
template <class M>
void match(const Record& record, const M&) {
  const auto find = [&](const auto& declared, const std::vector<Channel>& recorded, const char* kind) {
    for (const Channel& c : recorded) {
      bool known = false;
      for (const Quantity& q : declared) {
        if (q.name != c.name) continue;
        known = true;
        if (c.unit.empty() || q.unit == c.unit) continue;
        throw RecordError(
            record.name,
            c.name + " is in " + c.unit + "; " + std::string(M::name) + " has it in " + std::string(q.unit),
            "convert the column and correct its unit in the header");
      }
      if (!known) {
        throw RecordError(record.name, std::string(M::name) + " has no " + kind + " '" + c.name + "'",
                          "name the model that the record is of");
      }
    }
  };
  find(M::outputs, record.outputs, "output");
  find(M::inputs, record.inputs, "input");
}

// True for a model that may have a limit cycle of its own.
bool match_model(const std::string& model, const Record& record) {
  if (!record.model.empty() && record.model != model) {
    throw RecordError(record.name, "it is a record of the model '" + record.model + "', not of " + model,
                      "name that model on the command line");
  }
  bool recorded = false;
  visit_each(MachineModels{}, [&](auto m) {
    if (decltype(m)::name != model) return;
    recorded = true;
    match(record, m);
  });
  if (recorded) return false;
  const bool known = visit_model(model, [&](auto m) {
    if constexpr (clocked<decltype(m)>) {
      throw RecordError(record.name, "its sections are not paced by a clock, as " + model + " is",
                        "give `# sections: clock` and `# sections-per-cycle`, with columns cycle and section");
    }
    match(record, m);
  });
  if (!known) {
    throw UsageError("there is no model '" + model + "'; there are " + known_models() + ", " + machine_models());
  }
  return true;
}

std::string told(const Complex& z, const char* digits = "%.3f") {
  std::string s = number(z.real(), digits);
  if (z.imag() != 0.0) s += (z.imag() < 0.0 ? " - " : " + ") + number(std::abs(z.imag()), digits) + " i";
  return s;
}

nlohmann::json json_of(const Rhythm& r) {
  using Json = nlohmann::json;
  Json j{{"sections", r.plane.empty() ? "events" : "kinematic"},
         {"experiments", r.experiments},
         {"cycles", r.cycles},
         {"period", r.period},
         {"period_scatter", r.period_scatter},
         {"charts", r.charts},
         {"directions", r.directions},
         {"disagreement", r.disagreement},
         {"notes", r.notes},
         {"multipliers", Json::array()},
         {"htf", Json::array()}};
  if (!r.plane.empty()) {
    j["plane"] = r.plane;
    j["turns_refused"] = r.turns_refused;
  }
  for (const auto& [name, unit] : r.coordinates) j["coordinates"].push_back({{"name", name}, {"unit", unit}});
  for (const RhythmSection& s : r.sections) {
    j["places"].push_back({{"chart", s.chart},
                           {"output", s.output},
                           {"level", s.level},
                           {"passages", s.passages},
                           {"phase", s.phase},
                           {"mean", s.mean},
                           {"scatter", s.scatter},
                           {"noise", s.noise}});
  }
  for (const RhythmMultiplier& m : r.multipliers) {
    j["multipliers"].push_back(
        {{"re", m.value.real()}, {"im", m.value.imag()}, {"sigma", m.sigma}, {"modulus95", {m.low, m.high}}});
  }
  for (const RhythmHtf& h : r.htf) {
    j["htf"].push_back({{"m", h.m},
                        {"f", h.f},
                        {"output", r.coordinates[h.output].first},
                        {"re", h.value.real()},
                        {"im", h.value.imag()},
                        {"sigma", h.sigma},
                        {"cycles", r.cycles}});
  }
  if (!r.refusal.empty()) j["htf_refused"] = r.refusal;
  return j;
}

std::string csv_of(const Rhythm& r) {
  std::string csv = "m,f,output,re,im,sigma,cycles\n";
  for (const RhythmHtf& h : r.htf) {
    csv += std::to_string(h.m) + "," + number(h.f, "%.9g") + "," + r.coordinates[h.output].first + "," +
           number(h.value.real(), "%.12e") + "," + number(h.value.imag(), "%.12e") + "," + number(h.sigma, "%.4e") +
           "," + std::to_string(r.cycles) + "\n";
  }
  return csv;
}

void print(const Rhythm& r) {
  if (!r.plane.empty()) std::printf("  kinematic phase: the angle of %s\n", r.plane.c_str());
  std::string charts;
  for (const std::string& c : r.charts) charts += (charts.empty() ? "" : ", ") + (c.empty() ? "one chart" : c);
  std::printf("  %d cycles (%s) of %.4g s, scattering by %.2g s, in %d experiment%s\n", r.cycles, charts.c_str(),
              r.period, r.period_scatter, r.experiments, r.experiments == 1 ? "" : "s");
  std::printf("  %-8s %-22s %9s %7s  passages: scatter (of that, locating them)\n", "phase", "section", "passages", "");
  for (const RhythmSection& s : r.sections) {
    std::printf("  %-8.3f %-22s %9d ", s.phase,
                ((s.chart.empty() ? "" : s.chart + ", ") + (r.plane.empty() ? s.output : "angle") + " = " +
                 number(s.level, "%.3g"))
                    .c_str(),
                s.passages);
    for (std::size_t k = 0; k < s.scatter.size(); ++k) {
      std::printf("  %s %.2g (%.1g) %s", r.coordinates[k].first.c_str(), s.scatter[k], s.noise[k],
                  r.coordinates[k].second.c_str());
    }
    std::printf("\n");
  }
  for (const std::string& note : r.notes) std::printf("  note: %s\n", note.c_str());
  if (!r.multipliers.empty()) std::printf("  multipliers of a cycle, from the maps between sections\n");
  for (const RhythmMultiplier& m : r.multipliers) {
    std::printf("    %-22s standard error %.2g; modulus %.3f, 95 %% in [%.3f, %.3f]\n", told(m.value).c_str(), m.sigma,
                std::abs(m.value), m.low, m.high);
  }
  if (!r.multipliers.empty()) {
    std::printf("    at one section or another the first is told %.2g apart, root mean square\n", r.disagreement);
    const bool attracts =
        std::all_of(r.multipliers.begin(), r.multipliers.end(), [](const auto& m) { return m.high < 1.0; });
    std::printf("    %s\n", attracts ? "the rhythm attracts: all of them are below 1 with their whole intervals"
                                     : "whether the rhythm attracts is not decided: the interval of one reaches 1");
  }
  if (!r.refusal.empty()) {
    std::printf("  no harmonic transfer functions: %s\n", r.refusal.c_str());
    return;
  }
  std::printf("  harmonic transfer functions (%.0f %% of the input's deviations are told by the state before)\n",
              100.0 * r.told);
  for (std::size_t c = 0; c < r.coordinates.size(); ++c) {
    for (const int m : {-1, 0, 1}) {
      const RhythmHtf* best = nullptr;
      for (const RhythmHtf& h : r.htf) {
        if (h.m == m && h.output == c && (best == nullptr || std::abs(h.value) > std::abs(best->value))) best = &h;
      }
      if (best == nullptr) continue;
      std::printf("    %-12s H_%-2d largest %.4g at f = %.3f, standard error %.2g\n", r.coordinates[c].first.c_str(), m,
                  std::abs(best->value), best->f, best->sigma);
    }
  }
}

// Multipliers of the model's own limit cycle; what is said of them. `declared`: --set is known to be sound.
std::string add_model_multipliers(const IdentifyOptions& o, bool declared, nlohmann::json& j) {
  std::string said;
  try {
    for (const Complex& z : orbit_multipliers(o.model)) {
      j["model_multipliers"].push_back({{"re", z.real()}, {"im", z.imag()}});
      if (z.imag() < 0.0) continue;
      said += (said.empty() ? "" : ", ") + told(z, "%.4f") + (z.imag() > 0.0 ? " and its conjugate" : "");
    }
  } catch (const RunError& e) {
    said = std::string("none: ") + e.what();
  } catch (const UsageError& e) {
    if (!declared) throw;
    said = std::string("none: ") +
           e.what();  // an effect has been declared of it, and the cycle is that of the model alone
  }
  return said;
}

// The multipliers of one family beside the other's: how many of their errors they are apart. A turn of the
// phase may be several cycles between events.
nlohmann::json compare(const Rhythm& events, const Rhythm& kinematic, bool quiet) {
  const int cycles = std::max(1, static_cast<int>(std::lround(kinematic.period / events.period)));
  auto list = nlohmann::json::array();
  if (!quiet)
    std::printf("multipliers of a turn of the phase, %d cycle%s, both ways\n", cycles, cycles == 1 ? "" : "s");
  std::vector<bool> taken(kinematic.multipliers.size(), false);
  for (const RhythmMultiplier& e : events.multipliers) {
    const Complex z = std::pow(e.value, cycles);
    const double sigma = e.sigma * cycles * std::pow(std::abs(e.value), cycles - 1);
    std::size_t nearest = taken.size();
    for (std::size_t k = 0; k < taken.size(); ++k) {
      const auto off = [&](std::size_t i) { return std::abs(kinematic.multipliers[i].value - z); };
      if (!taken[k] && (nearest == taken.size() || off(k) < off(nearest))) nearest = k;
    }
    if (nearest == taken.size()) break;
    taken[nearest] = true;
    const RhythmMultiplier& k = kinematic.multipliers[nearest];
    const double error = std::hypot(sigma, k.sigma);
    const double off = std::abs(k.value - z) / std::max(1e-300, error);
    list.push_back({{"events", {{"re", z.real()}, {"im", z.imag()}, {"sigma", sigma}}},
                    {"kinematic", {{"re", k.value.real()}, {"im", k.value.imag()}, {"sigma", k.sigma}}},
                    {"off", off}});
    if (!quiet) {
      std::printf("    events %s, kinematic %s: %.1f of their errors apart\n", told(z).c_str(), told(k.value).c_str(),
                  off);
    }
  }
  return list;
}

}  // namespace

void identify_rhythm(const IdentifyOptions& o, const Record& record) {
  const bool may_cycle = match_model(o.model.name, record);
  if (!o.pictures.empty() || o.confidence.wanted()) {
    throw UsageError("no clock paces " + o.record +
                     ": of such a record there are --csv and --json, no pictures and no realisation");
  }
  if (o.sections.family == "clock" && !o.sections.kinematic.empty()) {
    throw UsageError("--kinematic: the sections are at its own events; add --sections kinematic");
  }
  const bool quiet = check_outputs({{"--csv", o.csv}, {"--json", o.json}});
  if (o.csv == "-" && o.sections.family == "both") {
    throw UsageError("--csv -: there is one table for each family of sections; name a file, or choose --sections");
  }
  const auto machine = diagnosis::make_walker(o.model.name);
  std::vector<double> values;
  if (machine) diagnosis::values_with(*machine, declared(o.model.settings, *machine, !quiet), values);
  if (!quiet) std::printf("%s: %zu rows, paced by the machine itself\n", o.record.c_str(), record.rows());

  nlohmann::json all = nlohmann::json::array();
  std::vector<Rhythm> found;
  for (const char* const family : {"clock", "kinematic"}) {
    if (o.sections.family != family && o.sections.family != "both") continue;
    RhythmOptions options;
    options.harmonics = std::min(1, o.campaign.harmonics);
    options.kinematic = family == std::string_view("kinematic");
    options.plane = o.sections.kinematic;
    rhythm::Layout layout;
    Rhythm r;
    try {
      r = saltus::identify_rhythm(record, options, &layout);
    } catch (const RecordError& e) {
      if (o.sections.family != "both") throw;
      if (!quiet) std::printf("sections %s: refused: %s\n", options.kinematic ? "by phase" : "at levels", e.what());
      all.push_back({{"sections", options.kinematic ? "kinematic" : "events"}, {"refused", e.what()}});
      continue;
    }
    nlohmann::json j = json_of(r);
    j["model"] = o.model.name;
    j["record"] = o.record;
    if (!quiet) {
      std::printf("sections %s\n", options.kinematic ? "where the kinematic phase passes a value"
                                                     : "where an output passes a level, between events");
      print(r);
    }
    if (machine) {
      const auto beside = diagnosis::run_beside(layout, r, *machine, values, options);
      j["model_maps"] = json_of(beside, r);
      if (!quiet) print(beside, r);
    }
    const std::string own = may_cycle ? add_model_multipliers(o, machine != nullptr, j)
                                      : "none: it has no rhythm of its own without the controller that drove it";
    if (!quiet) std::printf("  multipliers of the model's own limit cycle: %s\n", own.c_str());
    if (!o.csv.empty()) write_text(found.empty() ? o.csv : beside(o.csv, "kinematic"), csv_of(r));
    all.push_back(std::move(j));
    found.push_back(std::move(r));
  }
  if (found.empty()) throw RunError(o.record + ": neither family of sections applies to it; see above");
  if (found.size() == 2) all.push_back({{"agreement", compare(found[0], found[1], quiet)}});
  if (!o.json.empty()) write_json(o.json, all.size() == 1 ? all[0] : all);
}

}  // namespace saltus::program
