// The choice of a plan of experiments on a command line.
#pragma once

#include "../plan.hpp"
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

}  // namespace saltus::program
