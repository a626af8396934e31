// The pictures of harmonic transfer functions: magnitudes as in Fig. 3 of Ankarali & Cowan 2014, magnitude and phase
// with the fitted form as in Fig. 4.
#pragma once

#include <complex>
#include <string>
#include <vector>

#include "plot.hpp"

namespace saltus {

struct HtfCurve {
  int m = 0;
  std::vector<std::pair<double, std::complex<double>>> points;  // f [cycles a cycle], H_m
};

// One output under one family of sections.
struct HtfPanel {
  std::string output, unit, sections;  // "y_M", "m/N", "isochrons"
  std::vector<HtfCurve> exact, identified;
  std::vector<std::pair<double, std::complex<double>>> fit;  // of H_0
};

Figure magnitude_figure(const std::vector<HtfPanel>& panels);  // abs(H_0), abs(H_1), abs(H_-1)
Figure fit_figure(const std::vector<HtfPanel>& panels);        // abs and phase of H_0 with its fit

}  // namespace saltus
