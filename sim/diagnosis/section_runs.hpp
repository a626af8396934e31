// The section maps of a model beside those of a machine that paces itself: from every passage of a section that the
// record has, the model is run under the recorded input until it passes the next section and until it has made a step.
// These pairs go through the estimator that the record's own went through, with the same instruments and the same
// passages, so that what feeds the input back, and what the estimator does to noise, is in both.
#pragma once

#include <Eigen/Core>

#include <span>
#include <string>
#include <vector>

#include "../section_maps.hpp"
#include "machine.hpp"

namespace saltus::diagnosis {

// From one section to the next.
struct SectionBeside {
  int section = 0, next = 0;  // of the rhythm's
  int runs = 0, lost = 0;     // that have a measurement beside them; that did not get to the next section
  // Coordinates of the next section over those of this one, in the directions told; of the difference its standard
  // error. Empty where there are too few runs.
  Eigen::MatrixXd measured, model, sigma;
  double off = 0.0, worst = 0.0;         // [-] differences in those directions over their errors, rms and largest
  std::vector<double> error;             // (coordinates) measured less predicted, root mean square
  std::vector<double> bias, bias_sigma;  // (coordinates) its mean, and the standard error of that
  std::vector<double> scatter;           // (coordinates) of the measured passages
  double late = 0.0, late_sigma = 0.0;   // [s] of the model, mean over the runs and its standard error
};

struct MultiplierBeside {
  Complex model, measured;  // of the same passages
  double sigma = 0.0;       // of the model's
  double off = 0.0;         // [-] of their difference, in its standard errors
};

struct RhythmBeside {
  std::vector<SectionBeside> sections;
  std::vector<MultiplierBeside> multipliers;  // of a cycle, in the order of the rhythm's
  std::string refusal;                        // why there are none
};

// `values`: of every coefficient of the machine. Throws RecordError where the record is not of such a machine.
RhythmBeside run_beside(const rhythm::Layout& layout, const Rhythm& rhythm, const Machine& machine,
                        std::span<const double> values, const RhythmOptions& options = {});

}  // namespace saltus::diagnosis
