// From harmonic transfer functions to a linear periodic state-space model, x[n+1] = A[n] x[n] + B[n] u[n],
// y[n] = C[n] x[n], that predicts and controls what was measured.
#pragma once

#include <string>
#include <vector>

#include "core/linalg.hpp"
#include "core/orbit/ldtp.hpp"
#include "identification.hpp"

namespace saltus {

// Harmonic transfer functions of one input: at omega[q] [rad/section], value[q](m mod N, output), and the standard
// errors sqrt(E |error|^2) in the same places (0: exact). Harmonics that were not measured are 0.
struct HtfTable {
  int sections = 0, outputs = 0;
  std::vector<double> omega;
  std::vector<Eigen::MatrixXcd> value;  // (N x ny) each
  std::vector<Eigen::MatrixXd> sigma;   // (N x ny) each
};

HtfTable table_of(const Identification& id, int outputs);

// Dimensions may change from section to section: A[n] is (dim(n + 1) x dim(n)).
struct PeriodicModel {
  int sections = 0, outputs = 0;
  std::vector<Eigen::MatrixXd> A, B, C;

  int dim(int n) const { return static_cast<int>(C[static_cast<std::size_t>(n)].cols()); }
  int smallest_section() const;            // where the dimension is least
  Eigen::MatrixXd monodromy(int n) const;  // A[n-1] ... A[n+1] A[n]
  // (N x ny) as in HtfTable.
  Eigen::MatrixXcd htf(double omega) const;
};

struct RealisationOptions {
  int order = 0;            // [-] largest dimension allowed; 0: whatever the test says
  double tolerance = 1e-9;  // [-] exact data: singular values below this part of the largest are zero
  int replicates = 0;       // of the parametric bootstrap that gives `sigma`
  std::uint64_t seed = 1;
};

struct Realisation {
  PeriodicModel model;
  std::vector<double> singular;      // the largest singular values of the section with the largest dimension
  double threshold = 0.0;            // what singular values had to exceed: the noise's own, or the tolerance
  int rank = 0;                      // of the return map; at most the least dimension of a section
  std::vector<Complex> multipliers;  // non-zero ones, falling modulus
  // Standard errors of the multipliers, sqrt(E |error|^2): noise, what a dimension more in every section
  // changes, and, where harmonics are missing, what one pair less changes;
  // empty without replicates.
  std::vector<double> sigma;
  double error = 0.0;          // largest |H model - H| over the largest |H_0| of that output
  double error_rms = 0.0;      // root mean square of the same
  double inconsistency = 0.0;  // largest difference between the multipliers of two sections: what rounding left
};

// Frequency-lifted subspace identification. The response to exp(i omega n) is G_n(omega) exp(i omega n) with
// G_n = sum_m H_m exp(2 pi i m n / N) (Ankarali & Cowan 2014, eq. 14). For every section the outputs of the cycle that
// follows, with the part that the inputs of that cycle can explain projected out, are the observability matrix times
// the state: its column space is found by singular values, over all lines at once (van Overschee & De Moor 1996,
// McKelvey, Akcay & Ljung 1996), and shifting it by one section gives A[n] and C[n]; B[n] is then linear least squares
// on the HTFs. A dimension is the number of singular values larger than those of the noise alone, which are drawn from
// the standard errors (parallel analysis). Exact where all N harmonics are given; with fewer, the missing ones are an
// error of their own size. Throws std::invalid_argument when there are too few lines.
Realisation realise(const HtfTable& table, const RealisationOptions& options = {});

// {"sections_per_cycle", "dim", "A", "B", "C", "rank", "multipliers", ...} and `matrix,section,row,column,value`.
std::string realisation_json(const Realisation& r);
std::string realisation_csv(const Realisation& r);

// Copies into fixed-size storage for the loop; false when a dimension is above NX or the numbers of sections and
// outputs differ.
template <int NX, int NY, int N>
bool copy_to(const PeriodicModel& from, Ldtp<NX, 1, NY, N>& to) {
  if (from.sections != N || from.outputs != NY) return false;
  for (int n = 0; n < N; ++n) {
    const auto i = static_cast<std::size_t>(n);
    const auto next = from.A[i].rows(), here = from.A[i].cols();
    if (next > NX || here > NX) return false;
    to.dim[i] = static_cast<int>(here);
    to.A[i].setZero();
    to.B[i].setZero();
    to.C[i].setZero();
    to.D[i].setZero();
    to.A[i].topLeftCorner(next, here) = from.A[i];
    to.B[i].topRows(next) = from.B[i];
    to.C[i].leftCols(here) = from.C[i];
  }
  return true;
}

}  // namespace saltus
