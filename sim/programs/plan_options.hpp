// The choice of a plan of experiments on a command line.
#pragma once

#include <stdexcept>

#include "../experiment_design.hpp"
#include "program.hpp"

namespace saltus::program {

inline void add_plan_options(CLI::App& command, PlanOptions& plan) {
  command
      .add_option("--period", plan.period,
                  "cycles after which the stimulus repeats: the resolution of f is its inverse")
      ->check(CLI::Range(3, 2 * max_tones))
      ->capture_default_str();
  command.add_option("--band", plan.band, "lines strictly below this f, cycles per cycle")->capture_default_str();
  command.add_option("--amplitude", plan.amplitude, "of each cosine, in the unit of the input")->capture_default_str();
  command.add_option("--seed", plan.seed, "of phases, random partition and noise")
      ->check([](const std::string& text) { return text.find('-') == text.npos ? "" : text + " is negative"; })
      ->capture_default_str();
}

inline void add_share_option(CLI::App& command, PlanOptions& plan) {
  command
      .add_option("--share", plan.share,
                  "of --amplitude that each of several inputs gets, in its own unit (default: all of it)")
      ->delimiter(',');
}

inline void add_design_options(CLI::App& command, PlanOptions& plan, DesignOptions& design) {
  command.add_flag("--half-multiples", plan.half_multiples,
                   "the multiples of half the pumping frequency too, a constant included: each is played twice, a "
                   "quarter turn apart, which seldom takes more experiments");
  command.add_option("--tones", design.tones, "at most so many tones in an experiment")
      ->check(CLI::Range(1, max_tones));
  command.add_flag("--odd", design.odd,
                   "odd lines only, with an even period: even-order distortion falls on the silent even lines");
  command
      .add_option("--detection", design.detection,
                  "with --odd: classes of odd lines left silent in each experiment, where odd-order distortion shows")
      ->check(CLI::Range(0, max_tones));
  command.add_option("--realisations", design.realisations, "play the plan so many times, with other phases each time")
      ->check(CLI::Range(1, 100));
  command.add_flag("--crest", design.crest, "seek phases of a low crest factor, peaks between samples counted");
  command.add_option("--peak", design.peak_limit, "scale stimuli down to this largest input, between samples too")
      ->check(CLI::PositiveNumber);
}

inline Plan plan_of(const PlanOptions& plan, const DesignOptions& design) {
  try {
    return design.plain() ? make_plan(plan) : design_plan(plan, design);
  } catch (const std::invalid_argument& e) {
    throw UsageError(e.what());
  }
}

}  // namespace saltus::program
