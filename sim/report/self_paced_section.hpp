// What the page shows of a record that no clock paces: free runs, and how each effect earned its place.
#pragma once

#include <string>
#include <vector>

#include "../diagnosis/diagnosis.hpp"
#include "plot.hpp"

namespace saltus {

// Measured against predicted, output by output, and how far off.
std::vector<Figure> free_run_figures(const diagnosis::Diagnosis& d);

// The free runs in a line, as HTML.
std::string free_run_headline(const diagnosis::Diagnosis& d);

// Tables, as HTML.
std::string free_run_table(const diagnosis::Diagnosis& d);
std::string step_table(const diagnosis::Diagnosis& d);

}  // namespace saltus
