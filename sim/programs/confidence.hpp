// What `saltus identify` adds on request: how sure the numbers are, and the state-space model they make.
#pragma once

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

// Prints unless quiet, adds to the JSON object, and writes the model. `count` multipliers are sought.
void report_confidence(const Identified& r, const ConfidenceOptions& o, bool quiet, nlohmann::json& json);

}  // namespace saltus::program
