// The choice of Poincaré sections on a command line.
#pragma once

#include <cmath>

#include "../../core/orbit/section.hpp"
#include "../../core/status.hpp"
#include "program.hpp"

namespace saltus::program {

inline constexpr int sections_per_cycle = 32;

// --sections clock|kinematic and, for the latter, --kinematic o_p,o_v,s_p,s_v.
struct SectionChoice {
  std::string family = "clock";
  std::vector<double> kinematic;

  void add_to(CLI::App& command, bool both) {
    auto* option = command.add_option("--sections", family, "Poincare sections: clock (isochrons) or kinematic");
    option->check(both ? CLI::IsMember({"clock", "kinematic", "both"}) : CLI::IsMember({"clock", "kinematic"}));
    option->capture_default_str();
    command
        .add_option("--kinematic", kinematic,
                    "origin and scale of the kinematic phase: o_p,o_v,s_p,s_v, in the units of the first two outputs "
                    "(default: 1.9,0,0.3,1.9, the paper's for the hopper)")
        ->delimiter(',')
        ->expected(4);
  }

  // Calls f(family) once for each chosen family.
  template <class M, class F>
  void visit(F&& f) const {
    if (family == "clock" && !kinematic.empty()) {
      throw UsageError("--kinematic: the sections are those of the clock; add --sections kinematic");
    }
    if constexpr (clocked<M>) {
      if (family != "kinematic") f(ClockPhases{sections_per_cycle});
    } else if (family == "clock") {
      throw UsageError("--sections clock: " + std::string(M::name) + " has no clock; use --sections kinematic");
    }
    if (family == "clock") return;
    if constexpr (output_count<M> >= 2) {
      KinematicPhases k{sections_per_cycle};
      if (kinematic.size() == 4) {
        k.o_p = kinematic[0];
        k.o_v = kinematic[1];
        k.s_p = kinematic[2];
        k.s_v = kinematic[3];
        for (const double x : kinematic) {
          if (!std::isfinite(x)) throw UsageError("--kinematic: give four finite numbers");
        }
        if (!(k.s_p > 0.0 && k.s_v > 0.0)) throw UsageError("--kinematic: the scales s_p and s_v must be positive");
      } else if (M::name != std::string_view("hopper")) {
        throw UsageError(
            "--sections kinematic: give --kinematic o_p,o_v,s_p,s_v, a point inside the orbit and its size");
      }
      f(k);
    } else {
      throw UsageError("--sections kinematic: " + std::string(M::name) + " has fewer than two outputs");
    }
  }
};

// Why a search for the limit cycle failed, and what to try.
inline std::string no_orbit(std::string_view model, Status status, bool clock) {
  return std::string(model) + ": no limit cycle found (" + std::string(name(status)) + "); change --set" +
         (clock ? "" : ", or --kinematic where the orbit does not circle its point");
}

inline const char* name_of(const ClockPhases&) { return "clock"; }
inline const char* name_of(const KinematicPhases&) { return "kinematic"; }
inline const char* title_of(const ClockPhases&) { return "isochrons"; }
inline const char* title_of(const KinematicPhases&) { return "kinematic phase"; }

// "out.csv" -> "out-kinematic.csv"
inline std::string beside(const std::string& path, const std::string& word) {
  const auto dot = path.rfind('.');
  const auto slash = path.rfind('/');
  if (dot == std::string::npos || (slash != std::string::npos && dot < slash)) return path + "-" + word;
  return path.substr(0, dot) + "-" + word + path.substr(dot);
}

}  // namespace saltus::program
