// What a record of a machine that paces itself tells of its rhythm: Poincare sections located on interpolated data, the
// maps from one to the next, their multipliers with intervals, and harmonic transfer functions where the input excites
// the machine.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "core/linalg.hpp"
#include "hal/record.hpp"

namespace saltus {

namespace rhythm {
struct Layout;
}

struct RhythmOptions {
  int sections = 4;        // [-] of each chart
  double exclude = 0.035;  // [s] left out on either side of an event, where the structure rings
  int replicates = 400;    // of the bootstrap
  std::uint64_t seed = 1;
  int harmonics = 1;  // H_-harmonics ... H_harmonics
  // Sections at values of the kinematic phase, not at levels between events; twice as many.
  bool kinematic = false;
  std::vector<double> plane;  // its o_p, o_v, s_p, s_v, of the first output and its rate; empty: found
};

// A section: an output that runs through its chart in one direction passes a level, or the kinematic phase does.
struct RhythmSection {
  std::string chart;                         // empty where the record names none
  std::string output;                        // what passes
  double level = 0.0;                        // [unit of the output]; [turn] of the kinematic phase
  int passages = 0;                          // located
  double phase = 0.0;                        // [turn] of the cycle, its mean
  std::vector<double> mean, scatter, noise;  // (coordinates) of the passages; what locating them adds
};

struct RhythmMultiplier {
  Complex value;
  double sigma = 0.0;            // sqrt(E |error|^2)
  double low = 0.0, high = 0.0;  // [-] 95 % interval of its modulus
};

struct RhythmHtf {
  int m = 0;
  double f = 0.0;  // [cycle per cycle]
  std::size_t output = 0;
  Complex value;
  double sigma = 0.0;
};

struct Rhythm {
  int experiments = 0, cycles = 0;                               // cycles: whole ones
  double period = 0.0, period_scatter = 0.0;                     // [s] of a cycle
  std::vector<std::string> charts;                               // of a cycle, in order
  std::vector<std::pair<std::string, std::string>> coordinates;  // name and unit, of every section
  std::vector<RhythmSection> sections;
  std::string plane;                          // whose angle is the phase, where it is kinematic
  int turns_refused = 0;                      // cycles in which that phase does not go round in one direction
  int directions = 0;                         // in which the passages scatter beyond what locating them adds
  std::vector<RhythmMultiplier> multipliers;  // of a cycle, by falling modulus; one a direction
  double disagreement = 0.0;                  // [-] of the sections about the largest multiplier, root mean square
  std::vector<RhythmHtf> htf;                 // empty where refused
  std::string refusal;                        // why there are none
  double told = 0.0;                          // [-] share of the input's deviations that the state before tells
  std::vector<std::string> notes;
};

// Throws RecordError where the record has too little of a rhythm. `layout`: what it was laid out into, for whoever goes
// on from there; it refers to the record.
Rhythm identify_rhythm(const Record& record, const RhythmOptions& options = {}, rhythm::Layout* layout = nullptr);

}  // namespace saltus
