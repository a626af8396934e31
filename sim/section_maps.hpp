// Maps between the sections of a machine that paces itself, by instruments: the section before sees the same deviations
// through noise of its own, so that noise does not bias them.
#pragma once

#include "passages.hpp"

namespace saltus::rhythm {

// Passages of one section, of the one `ahead` and of the one before, which sees the same deviations through noise of
// its own (an instrument): row by row.
struct Pairs {
  Eigen::MatrixXd x, y, z;
  Eigen::VectorXd u;       // the input from the section to the next
  std::vector<int> visit;  // whose the row is
};
Pairs pairs_of(const Passages& w, int section, int ahead);

// Less the weighted mean of its rows.
Eigen::MatrixXd centred(const Eigen::MatrixXd& m, const Eigen::VectorXd& weight);

// Directions of the scatter at every section, most lively first: what the section before sees of it as well, in units
// of what locating adds.
struct Frame {
  Eigen::MatrixXd in, out;  // (directions x coordinates), (coordinates x directions): out * in projects
  Eigen::MatrixXd seen;     // (directions x coordinates) of the section before, which tells them
  int directions = 0;
};
Frame frame_of(const Pairs& p, const Eigen::VectorXd& noise_x, const Eigen::VectorXd& noise_z);

// Multipliers of a cycle of steps, each from frame c to the next, the stays weighted; empty where they cannot be told.
std::vector<Complex> multipliers_of(const std::vector<Pairs>& steps, const std::vector<Frame>& frames, int directions,
                                    const Eigen::VectorXd& weight);

// x of the next section = A x + B u, section by section.
struct Chain {
  std::vector<Eigen::MatrixXd> A;
  std::vector<Eigen::VectorXd> B;
};
Chain chain_of(const std::vector<Pairs>& pairs, const std::vector<Frame>& frames, int directions,
               const Eigen::VectorXd& weight);

// H_m of every coordinate at f [cycles per cycle], (2 harmonics + 1 x coordinates): the answer to e^{i w k} is e^{i w
// k} times what repeats with the cycle.
Eigen::MatrixXcd htf_at(const Chain& chain, const std::vector<Frame>& frames, double f, int harmonics);

}  // namespace saltus::rhythm
