// Multipliers of a return map that is known to within an error, each with its own. The zeros come first, by rank
// decisions: deflation leaves a matrix of full rank whose eigenvalues are the non-zero ones, so that a nilpotent part
// does not show as a ring of small numbers. Expensive to compile: instantiate for one size.
#pragma once

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "rank.hpp"

namespace saltus {

template <int N>
struct ConditionedMultipliers {
  Status status = Status::failed;  // ok, or failed: the matrix is not finite, or the rank that zeros rest on undecided
  int dim = 0;                     // of the chart
  int nonzero = 0;                 // more than their errors
  int untold = 0;                  // the next ones, zero within their errors; all others are zero by rank
  int index = 0;                   // passages after which the part that is zero by rank is forgotten
  std::array<Complex, static_cast<std::size_t>(N)> value{};     // by falling modulus, (dim)
  std::array<double, static_cast<std::size_t>(N)> error{};      // how far each may be off
  std::array<double, static_cast<std::size_t>(N)> condition{};  // [-] of each non-zero one: its error over the matrix's
};

// The eigenvalues of a matrix of the given rank, (dim x dim) in its upper left corner, zeros beyond. Where ranks are
// undecided, what may be zero is carried along: the errors hold all the same. The error entry by entry is used, so that
// badly scaled coordinates do no harm.
template <int N>
ConditionedMultipliers<N> conditioned_multipliers(const Measured<N>& m, int dim, Rank<N> rank) noexcept {
  const Mat<N, N>& matrix = m.value;
  const Mat<N, N>& error = m.error;
  ConditionedMultipliers<N> r;
  r.dim = dim;
  if (!matrix.allFinite() || !m.coarse.allFinite() || !(m.tolerance >= 0.0)) return r;
  r.status = rank.status;
  // A = U S V^T of rank k has the non-zero eigenvalues of the (k x k) matrix S V^T U = U^T A U, and so on until the
  // rank stays. `right` and `left` carry the eigenvectors of what remains back to those of A.
  Mat<N, N> core = matrix;
  Mat<N, N> right = Mat<N, N>::Identity();
  Mat<N, N> left = Mat<N, N>::Identity();
  int size = dim;
  while (rank.known() && rank.value < size) {
    const Decomposition<N> svd = decompose<N>(core);
    ++r.index;
    size = rank.value;
    if (size == 0) break;
    Mat<N, N> u = svd.u;
    Mat<N, N> sv = svd.v.transpose();
    for (int i = 0; i < N; ++i) {
      if (i >= size) u.col(i).setZero();
      sv.row(i) *= i < size ? svd.sigma[static_cast<std::size_t>(i)] : 0.0;
    }
    core = sv * u;
    right = (right * u).eval();
    left = (sv * left).eval();
    const Mat<N, N> coarse = right.transpose() * m.coarse * right;
    rank = orbit::decide(singular_values<N>(core), singular_values<N>(coarse), m.tolerance, m.rounding, {0, size});
  }

  if (size > 0) {
    // Numbers larger than any eigenvalue keep the idle corner apart from what is asked for.
    const double size_of_core = core.norm();
    const double idle = 4.0 * size_of_core;
    for (int i = size; i < N; ++i) core(i, i) = idle;
    const Eigen::EigenSolver<Mat<N, N>> solver(core, true);
    const Mat<N, N, Complex> z = solver.eigenvectors();
    const Mat<N, N, Complex> w = Eigen::PartialPivLU<Mat<N, N, Complex>>(z).inverse();
    std::array<int, static_cast<std::size_t>(N)> order{};
    for (int i = 0; i < N; ++i) order[static_cast<std::size_t>(i)] = i;
    std::sort(order.begin(), order.end(), [&](int a, int b) {
      const Complex x = solver.eigenvalues()[a];
      const Complex y = solver.eigenvalues()[b];
      const double d = std::abs(x) - std::abs(y);
      if (std::abs(d) > 1e-12 * (std::abs(x) + std::abs(y))) return d > 0.0;
      return x.imag() > y.imag();
    });
    // Where eigenvectors nearly coincide the first order is no bound, and Elsner's is taken.
    const double elsner =
        std::pow(2.0 * matrix.norm() + error.norm(), 1.0 - 1.0 / dim) * std::pow(error.norm(), 1.0 / dim);
    for (int i = 0; i < size; ++i) {
      const int k = order[static_cast<std::size_t>(i + N - size)];
      const auto at = static_cast<std::size_t>(i);
      r.value[at] = solver.eigenvalues()[k];
      const Vec<N> x = (right.template cast<Complex>() * z.col(k)).cwiseAbs();
      const Vec<N> y =
          (w.row(k) * left.template cast<Complex>()).cwiseAbs().transpose() / std::pow(std::abs(r.value[at]), r.index);
      r.condition[at] = x.norm() * y.norm();
      // The matrix's error, and what the solver adds, which knows no scales.
      const double solver_error = 4.0 * std::numeric_limits<double>::epsilon() * size_of_core;
      const double first_order = y.dot(error * x) + solver_error * z.col(k).norm() * w.row(k).norm();
      r.error[at] = first_order < elsner ? first_order : elsner;
      // By falling modulus: behind one that is not told from zero none is.
      if (r.nonzero == i && std::abs(r.value[at]) > r.error[at]) ++r.nonzero;
    }
    for (int i = r.nonzero; i < size; ++i) {
      const auto at = static_cast<std::size_t>(i);
      r.error[at] += std::abs(r.value[at]);
      r.value[at] = 0.0;
    }
    r.untold = size - r.nonzero;
  }
  // A zero in a chain of `index` links moves by the index-th root of the matrix's error.
  for (int i = size; i < dim; ++i) {
    const double links = std::max(1, r.index);
    r.error[static_cast<std::size_t>(i)] =
        std::pow(m.tolerance, 1.0 / links) * std::pow(std::fmax(matrix.norm(), m.tolerance), 1.0 - 1.0 / links);
  }
  return r;
}

// Of a matrix known to within `tolerance`, up to which a singular value is zero.
template <int N>
ConditionedMultipliers<N> conditioned_multipliers(const Mat<N, N>& matrix, int dim, double tolerance,
                                                  const Mat<N, N>& error) noexcept {
  return conditioned_multipliers<N>({matrix, matrix, tolerance, tolerance, error}, dim, rank_of<N>(matrix, tolerance));
}

// Largest distance from a non-zero multiplier of one map to its nearest partner in the other; infinite when they are
// not equally many, but for those not told from zero. Zero for any two sections of one cycle (Remark 4, and across
// charts).
template <int N>
double spectral_distance(const ConditionedMultipliers<N>& a, const ConditionedMultipliers<N>& b) noexcept {
  const int count = std::max(a.nonzero, b.nonzero);
  if (std::min(a.nonzero + a.untold, b.nonzero + b.untold) < count) return std::numeric_limits<double>::infinity();
  std::array<bool, static_cast<std::size_t>(N)> taken{};
  double worst = 0.0;
  for (int i = 0; i < count; ++i) {
    double nearest = std::numeric_limits<double>::infinity();
    std::size_t partner = 0;
    for (int j = 0; j < count; ++j) {
      const auto at = static_cast<std::size_t>(j);
      const double d = std::abs(a.value[static_cast<std::size_t>(i)] - b.value[at]);
      if (!taken[at] && d < nearest) {
        nearest = d;
        partner = at;
      }
    }
    taken[partner] = true;
    worst = std::fmax(worst, nearest);
  }
  return worst;
}

// The sum of the largest errors of two spectra, of what `spectral_distance` compares.
template <int N>
double allowed_distance(const ConditionedMultipliers<N>& a, const ConditionedMultipliers<N>& b) noexcept {
  double ea = 0.0;
  double eb = 0.0;
  for (int i = 0; i < std::max(a.nonzero, b.nonzero); ++i) {
    ea = std::fmax(ea, a.error[static_cast<std::size_t>(i)]);
    eb = std::fmax(eb, b.error[static_cast<std::size_t>(i)]);
  }
  return ea + eb;
}

}  // namespace saltus
