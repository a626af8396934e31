// A plan of experiments: which tones are played together, for how long.
#pragma once

#include <cstdint>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "core/spectrum/lines.hpp"
#include "core/spectrum/stimulus.hpp"

namespace saltus {

inline constexpr int max_tones = 64;     // a stimulus
inline constexpr int max_lines = 16384;  // a plan
inline constexpr int most_inputs = 8;

struct PlanOptions {
  int sections = 32;        // [-] a cycle
  int period = 64;          // [cycle] of the stimulus
  double band = 10.0;       // [cycles a cycle] lines strictly below
  int subsets = 0;          // random partition into so many experiments; 0: the fewest possible
  double amplitude = 0.01;  // [input unit] of each cosine
  bool opposed = false;     // play every stimulus a second time with its sign reversed: even-order distortion cancels
  bool half_multiples = false;  // the lines k period / 2 too, line 0 included: see set_quadrature()
  std::uint64_t seed = 1;       // of phases and of the random partition
  int inputs = 1;               // every experiment is played so many times, with amplitudes that are orthogonal
  std::vector<double> share;    // [-] of the amplitude that each input gets, in its own unit; empty: all of it
};

struct Plan {
  PlanOptions options;
  Clique bound;  // the certificate: so many lines, or plays, exclude one another that no plan has fewer experiments
  std::vector<Multisine<max_tones>> experiments;  // each as the first input gets it in its first play
  int realisations = 1;                           // times that the plan is played, with other phases each time

  // What an input gets in an experiment. Play k of input j is the experiment times W_jk, W a Hadamard matrix for 1, 2,
  // 4 or 8 inputs, else that of the discrete Fourier transform, but for a constant, which goes to one input at a time.
  Multisine<max_tones> stimulus(std::size_t experiment, int input) const;

  // No plan has fewer: the certificate, which counts the machine's own cycle once however many inputs there are.
  int least_experiments() const { return bound.size * options.inputs - (bound.residue == 0 ? options.inputs - 1 : 0); }

  // Lines of all experiments, each counted once however often it is played.
  int lines() const {
    std::set<int> all;
    for (const auto& e : experiments) {
      for (int k = 0; k < e.tones(); ++k) all.insert(e.tone(k).line);
    }
    return static_cast<int>(all.size());
  }
};

// Of the experiments of one realisation: the second play of a half multiple of the pumping frequency gets the phase of
// the first and a quarter turn, so that both together tell the response from its mirror image, with the standard error
// of any other line played twice; line 0 gets phase 0. All else is left as it is.
void set_quadrature(std::span<Multisine<max_tones>> experiments, int period);

// Each stimulus as often as there are inputs, and where the options say so with its sign reversed after each. Throws
// std::invalid_argument where the inputs or their shares are none.
std::vector<Multisine<max_tones>> repeated(const std::vector<Multisine<max_tones>>& stimuli,
                                           const PlanOptions& options);

// The same stimulus with its sign reversed.
Multisine<max_tones> reversed(const Multisine<max_tones>& u);

// The same stimulus so many times as large, a finite number.
inline Multisine<max_tones> scaled(const Multisine<max_tones>& u, double factor) {
  Multisine<max_tones> v(u.samples());
  for (int k = 0; k < u.tones(); ++k) {
    Tone t = u.tone(k);
    t.amplitude *= factor;
    if (!v.add(t)) break;  // not finite
  }
  return v;
}

// The same stimuli at another amplitude of a tone [input unit].
inline Plan scaled(const Plan& plan, double amplitude) {
  Plan p = plan;
  p.options.amplitude = amplitude;
  for (auto& u : p.experiments) u = scaled(u, amplitude / plan.options.amplitude);
  return p;
}

// Throws std::invalid_argument, naming the option and the mend, when there is no such plan.
Plan make_plan(const PlanOptions& options);

}  // namespace saltus
