// What `saltus identify` adds on request: how sure the numbers are, and the state-space model they make.
#pragma once

#include "../multiplier_region.hpp"
#include "../realisation.hpp"
#include "program.hpp"

namespace saltus::program {

struct Identified;

struct ConfidenceOptions {
  double level = 0.0;   // of the regions; 0: not asked for
  int replicates = 0;   // of the bootstrap
  std::string realise;  // file for the state-space model

  bool wanted() const { return level > 0.0 || !realise.empty(); }
  void add_to(CLI::App& command);
};

// Prints unless quiet, adds to the JSON object, and writes the model. Returns the regions, failed where not asked for.
MultiplierRegion report_confidence(const Identified& r, const ConfidenceOptions& o, bool quiet, nlohmann::json& json);

// Whether two families of sections tell the same multipliers: how likely chance makes them differ so much.
void report_agreement(const MultiplierRegion& a, const MultiplierRegion& b, bool quiet, nlohmann::json& families);

// Writes FILE.json or FILE.csv, and says what it holds.
void write_model(const Realisation& model, const std::string& file, bool quiet);

}  // namespace saltus::program
