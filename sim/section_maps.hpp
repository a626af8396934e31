// Maps between the sections of a machine that paces itself, by instruments: the section before sees the same deviations
// through noise of its own, so that noise does not bias them.
#pragma once

#include "core/random.hpp"
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

// y = T x in the first `directions` of the frames, by the instrument, the stays weighted.
Eigen::MatrixXd map_of(const Pairs& p, const Frame& here, const Frame& there, Eigen::Index directions,
                       const Eigen::VectorXd& weight);

// Multipliers of a cycle of steps, each from frame c to the next, the stays weighted; empty where they cannot be told.
std::vector<Complex> multipliers_of(const std::vector<Pairs>& steps, const std::vector<Frame>& frames, int directions,
                                    const Eigen::VectorXd& weight);

// Of the same cycle at several sections, which all have the same multipliers: their mean, or, where some sections tell
// a pair that others tell as two real ones, the roots of the mean of their characteristic polynomials, so that pairs
// stay pairs.
std::vector<Complex> multipliers_of_all(const std::vector<std::vector<Pairs>>& steps,
                                        const std::vector<std::vector<Frame>>& frames, int directions,
                                        const Eigen::VectorXd& weight);

// How far those of single sections lie from these, root mean square: where directions are left out it is more than
// drawing anew tells, for what is left out differs from section to section.
std::vector<double> spread_of(const std::vector<std::vector<Pairs>>& steps,
                              const std::vector<std::vector<Frame>>& frames, const std::vector<Complex>& multipliers,
                              const Eigen::VectorXd& weight);

// The values nearest to those of `like`, in its order.
std::vector<Complex> in_order(std::vector<Complex> values, const std::vector<Complex>& like);

// How often each of n stays is drawn when as many are drawn with replacement.
Eigen::VectorXd drawn(std::size_t n, Random& random);

// From a median of squared errors to their standard deviation, real or complex: a replicate whose map is nearly
// singular lies anywhere. Of two Gaussian numbers the median square is 2 ln 2 / 2 of its mean, of one 0.455.
double sigma_of(const std::vector<double>& squares, bool complex);

// What a record is laid out into: passages, what locating adds to each section's coordinates, and the directions of
// their scatter.
struct Layout {
  Passages passages;
  std::vector<Eigen::VectorXd> noise;  // (sections)(coordinates)
  std::vector<Frame> frames;           // (sections); of rhythm.directions where there are any
};

// Steps of a cycle, chart by chart, from the section j of each to the same of the next.
std::vector<Pairs> steps_of(const Passages& w, int j);
std::vector<Frame> frames_at(const Layout& layout, int j);

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
