#include "identify_rhythm.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "../rhythm.hpp"
#include "orbit_multipliers.hpp"

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
  Json j{{"sections", "events"},
         {"experiments", r.experiments},
         {"cycles", r.cycles},
         {"period", r.period},
         {"period_scatter", r.period_scatter},
         {"charts", r.charts},
         {"directions", r.directions},
         {"notes", r.notes},
         {"multipliers", Json::array()},
         {"htf", Json::array()}};
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
  std::string charts;
  for (const std::string& c : r.charts) charts += (charts.empty() ? "" : ", ") + (c.empty() ? "one chart" : c);
  std::printf("  %d cycles (%s) of %.4g s, scattering by %.2g s, in %d experiment%s\n", r.cycles, charts.c_str(),
              r.period, r.period_scatter, r.experiments, r.experiments == 1 ? "" : "s");
  std::printf("  %-8s %-22s %9s %7s  passages: scatter (of that, locating them)\n", "phase", "section", "passages", "");
  for (const RhythmSection& s : r.sections) {
    std::printf("  %-8.3f %-22s %9d ", s.phase,
                ((s.chart.empty() ? "" : s.chart + ", ") + s.output + " = " + number(s.level, "%.3g")).c_str(),
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

}  // namespace

void identify_rhythm(const IdentifyOptions& o, const Record& record) {
  const bool may_cycle = match_model(o.model.name, record);
  if (!o.pictures.empty() || o.confidence.wanted()) {
    throw UsageError("no clock paces " + o.record +
                     ": of such a record there are --csv and --json, no pictures and no realisation");
  }
  const bool quiet = check_outputs({{"--csv", o.csv}, {"--json", o.json}});
  RhythmOptions options;
  options.harmonics = std::min(1, o.campaign.harmonics);
  const Rhythm r = saltus::identify_rhythm(record, options);
  nlohmann::json j = json_of(r);
  j["model"] = o.model.name;
  j["record"] = o.record;
  if (!quiet) {
    std::printf("%s: %zu rows, paced by the machine itself; sections where an output passes a level\n",
                o.record.c_str(), record.rows());
    print(r);
  }
  std::string of_model;
  if (may_cycle) {
    try {
      for (const Complex& z : orbit_multipliers(o.model)) {
        j["model_multipliers"].push_back({{"re", z.real()}, {"im", z.imag()}});
        if (z.imag() < 0.0) continue;
        of_model += (of_model.empty() ? "" : ", ") + told(z, "%.4f") + (z.imag() > 0.0 ? " and its conjugate" : "");
      }
    } catch (const RunError& e) {
      of_model = std::string("none: ") + e.what();
    }
  } else {
    of_model = "none: it has no rhythm of its own without the controller that drove it";
  }
  if (!quiet) std::printf("  multipliers of the model: %s\n", of_model.c_str());
  if (!o.csv.empty()) write_text(o.csv, csv_of(r));
  if (!o.json.empty()) write_json(o.json, j);
}

}  // namespace saltus::program
