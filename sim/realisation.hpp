// From harmonic transfer functions to a linear periodic state-space model, x[n+1] = A[n] x[n] + B[n] u[n],
// y[n] = C[n] x[n], that predicts and controls what was measured.
#pragma once

#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "core/linalg.hpp"
#include "core/orbit/ldtp.hpp"
#include "core/orbit/rank.hpp"
#include "core/spectrum/htf.hpp"
#include "identification.hpp"

namespace saltus {

// Harmonic transfer functions of one input: at omega[q] [rad/section], value[q](m mod N, output), and the standard
// errors sqrt(E |error|^2) in the same places (0: exact). Harmonics that were not measured are 0.
struct HtfTable {
  int sections = 0, outputs = 0;
  std::vector<double> omega;
  std::vector<Eigen::MatrixXcd> value;   // (N x ny) each
  std::vector<Eigen::MatrixXd> sigma;    // (N x ny) each
  std::vector<ClassCorrelation> errors;  // how those of each omega go together; empty: independent
};

HtfTable table_of(const Identification& id, int outputs);

// All N harmonics of a known system at f = 1/resolution, 2/resolution ... band [cycles a cycle].
template <int NX, int NY, int N>
HtfTable exact_table(const Ldtp<NX, 1, NY, N>& system, int resolution, double band) {
  HtfTable t;
  t.sections = N;
  t.outputs = NY;
  for (int q = 1; q <= static_cast<int>(std::floor(band * resolution + 1e-9)); ++q) {
    const double omega = 2.0 * std::numbers::pi * q / (static_cast<double>(resolution) * N);
    const auto h = htf(system, omega);
    Eigen::MatrixXcd value(N, NY);
    for (int m = 0; m < N; ++m) value.row(m) = h(m).col(0).transpose();
    t.omega.push_back(omega);
    t.value.push_back(value);
    t.sigma.emplace_back(Eigen::MatrixXd::Zero(N, NY));
  }
  return t;
}

// What the rank of a return map lies between, given the maps from section to section that it is made of: Theorem 4 of
// Wendel & Ames 2012, with the ranks that these have instead of those that Lemma 3 foresees. The cycle starts where the
// dimension is least.
Bounds rank_bounds(const std::vector<Eigen::MatrixXd>& maps);
template <int NX, int NU, int NY, int N>
Bounds rank_bounds(const Ldtp<NX, NU, NY, N>& system) {
  std::vector<Eigen::MatrixXd> maps;
  for (std::size_t n = 0; n < N; ++n) {
    maps.emplace_back(system.A[n].topLeftCorner(system.dim[(n + 1) % N], system.dim[n]));
  }
  return rank_bounds(maps);
}

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
  double threshold = 0.0;            // what singular values had to exceed: the noise's own, the limit, or the tolerance
  double limit = 0.0;                // where harmonics are missing: the largest that the outermost measured pair has
  int rank = 0;                      // of the return map; at most the least dimension of a section
  std::optional<Bounds> bounds;      // of the machine's return map, where its model is known
  std::vector<Complex> multipliers;  // non-zero ones, falling modulus
  // Standard errors of the multipliers, sqrt(E |error|^2): noise, what a dimension more in every section
  // changes, and, where harmonics are missing, what one pair less changes;
  // empty without replicates.
  std::vector<double> sigma;
  double error = 0.0;          // largest |H model - H| over the largest |H_0| of that output
  double error_rms = 0.0;      // root mean square of the same
  double inconsistency = 0.0;  // largest difference between the multipliers of two sections: what rounding left

  bool stable() const { return multipliers.empty() || std::abs(multipliers[0]) < 1.0; }
};

// Frequency-lifted subspace identification. The response to exp(i omega n) is G_n(omega) exp(i omega n) with
// G_n = sum_m H_m exp(2 pi i m n / N) (Ankarali & Cowan 2014, eq. 14). For every section the outputs of the cycle that
// follows, with the part that the inputs of that cycle can explain projected out, are the observability matrix times
// the state: its column space is found by singular values, over all lines at once (van Overschee & De Moor 1996,
// McKelvey, Akcay & Ljung 1996), and shifting it by one section gives A[n] and C[n]; B[n] is then linear least squares
// on the HTFs. A dimension is the number of singular values larger than those of the noise alone, which are drawn from
// the standard errors (parallel analysis). Exact where all N harmonics are given; with fewer, the missing ones are an
// error of their own size, which the outermost measured pair tells: what that alone gives is no state either. Throws
// std::invalid_argument when there are too few lines.
Realisation realise(const HtfTable& table, const RealisationOptions& options = {});

// The same of what was identified. The multipliers of a subspace are biased by what was left out; multiplier_region()
// has no such bias, so the standard errors take in the distance to its own, and stand without replicates too.
Realisation realise(const Identification& id, int outputs, const RealisationOptions& options = {});

// {"sections_per_cycle", "dim", "A", "B", "C", "rank", "multipliers", ...} and `matrix,section,row,column,value`.
std::string realisation_json(const Realisation& r);
std::string realisation_csv(const Realisation& r);
// The model back from that JSON. Throws std::invalid_argument, saying what is wrong with it.
PeriodicModel periodic_model_of(const std::string& json);

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
