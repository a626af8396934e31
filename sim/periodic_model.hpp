// Private to realise(): the inputs that make a periodic model answer as was measured. The model is in realisation.hpp.
#pragma once

#include <vector>

#include "realisation.hpp"

namespace saltus {

// The B of least squares on all harmonics, given A and C: the phasors of the state are linear in it. `gains` are G_n at
// each line, (N x ny); outputs count in units of `scale`.
void fit_inputs(const HtfTable& t, const std::vector<Eigen::MatrixXcd>& gains, const Eigen::VectorXd& scale,
                PeriodicModel& m);

}  // namespace saltus
