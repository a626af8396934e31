// Runs of a model from the passages of a machine that paces itself to the passages that follow.
#pragma once

#include <Eigen/Core>

#include <span>
#include <vector>

#include "../section_maps.hpp"
#include "machine.hpp"

namespace saltus::diagnosis {

// The model from one passage on: the passage itself, as the model has it, the next one and that of a step later; empty
// where it does not get there.
struct Journey {
  Eigen::VectorXd x, next, step;
  double lasted = 0.0;  // [s] to the next
};

// From every passage (visits)(sections of a chart), under the recorded input; the start is what the samples about the
// passage ask for. Throws RecordError where the record is not of such a machine.
std::vector<std::vector<Journey>> journeys_of(const rhythm::Layout& layout, const Machine& machine,
                                              std::span<const double> values);

}  // namespace saltus::diagnosis
