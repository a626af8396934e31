// A plan of experiments: which tones are played together, for how long.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/spectrum/lines.hpp"
#include "core/spectrum/stimulus.hpp"

namespace saltus {

inline constexpr int max_tones = 64;     // a stimulus
inline constexpr int max_lines = 16384;  // a plan

struct PlanOptions {
  int sections = 32;        // [-] a cycle
  int period = 64;          // [cycle] of the stimulus
  double band = 10.0;       // [cycles a cycle] lines strictly below
  int subsets = 0;          // random partition into so many experiments; 0: the fewest possible
  double amplitude = 0.01;  // [input unit] of each cosine
  bool opposed = false;     // play every stimulus a second time with its sign reversed: even-order distortion cancels
  std::uint64_t seed = 1;   // of phases and of the random partition
};

struct Plan {
  PlanOptions options;
  Clique bound;  // the certificate: so many lines exclude one another that no plan has fewer experiments
  std::vector<Multisine<max_tones>> experiments;

  // Tones of all experiments; an opposed pair counts once.
  int lines() const {
    int n = 0;
    for (const auto& e : experiments) n += e.tones();
    return options.opposed ? n / 2 : n;
  }
};

// The same stimuli at another amplitude of a tone [input unit].
inline Plan scaled(const Plan& plan, double amplitude) {
  Plan p{plan.options, plan.bound, {}};
  p.options.amplitude = amplitude;
  for (const auto& u : plan.experiments) {
    Multisine<max_tones> v(u.samples());
    for (int k = 0; k < u.tones(); ++k) {
      Tone t = u.tone(k);
      t.amplitude *= amplitude / plan.options.amplitude;
      if (!v.add(t)) break;  // not finite
    }
    p.experiments.push_back(v);
  }
  return p;
}

// Throws std::invalid_argument, naming the option and the mend, when there is no such plan.
Plan make_plan(const PlanOptions& options);

}  // namespace saltus
