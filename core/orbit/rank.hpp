// Ranks of the derivatives of return maps, and what bounds them (Wendel & Ames 2010, sec. 4). Numerical rank with a
// tolerance that the caller derives from the error of the matrix: by Weyl's inequality an error E moves no singular
// value by more than its norm. So one well above the tolerance is not zero; one below it is zero only where rounding
// explains it, or where it shrinks with the step as an error does. What is neither leaves the rank undecided, unless a
// theorem decides it: a status, not a number.
#pragma once

#include <Eigen/SVD>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>

#include "../linalg.hpp"
#include "../status.hpp"

namespace saltus {

struct Bounds {
  int lower = 0, upper = 0;
  bool contains(int rank) const noexcept { return lower <= rank && rank <= upper; }
  friend bool operator==(const Bounds&, const Bounds&) = default;
};

// A matrix computed twice, with steps h and h/2.
template <int N>
struct Measured {
  Mat<N, N> value, coarse;  // with h/2, and with h
  double tolerance;         // bounds the error of `value` in the 2-norm
  double rounding;          // the part of it that smaller steps do not lessen
  Mat<N, N> error;          // likely, entry by entry
};

template <int N>
struct Rank {
  Status status = Status::failed;  // ok, or failed: undecided, not finite, or above its bounds
  int value = -1;                  // -1 where failed
  int counted = 0;                 // singular values clear of the tolerance: numerically the rank is at least this
  double tolerance = 0.0;          // bounds the error of a singular value
  double margin = 0.0;             // smallest singular value counted, over the tolerance; infinite where none is
  std::array<double, static_cast<std::size_t>(N)> sigma{};  // falling

  bool known() const noexcept { return status == Status::ok; }
};

// Falling.
template <int N>
std::array<double, static_cast<std::size_t>(N)> singular_values(const Mat<N, N>& matrix) noexcept {
  const Eigen::JacobiSVD<Mat<N, N>> svd(matrix);
  std::array<double, static_cast<std::size_t>(N)> r{};
  for (int i = 0; i < N; ++i) r[static_cast<std::size_t>(i)] = svd.singularValues()[i];
  return r;
}

namespace orbit {
inline constexpr double clear = 10.0;  // a singular value counts when it is this much above the tolerance

inline constexpr double shrinks = 4.0;  // an error of fourth order does so by 16 when the step is halved

// `coarse`: the singular values with the larger step. Where the bounds leave one rank it is that, whatever is counted.
template <std::size_t N>
Rank<static_cast<int>(N)> decide(const std::array<double, N>& sigma, const std::array<double, N>& coarse,
                                 double tolerance, double rounding, Bounds bounds) noexcept {
  Rank<static_cast<int>(N)> r;
  r.tolerance = tolerance;
  r.margin = std::numeric_limits<double>::infinity();
  r.sigma = sigma;
  bool told = true;
  for (std::size_t k = 0; k < N; ++k) {
    const double s = sigma[k];
    if (s > tolerance && s >= clear * tolerance) {
      ++r.counted;
      r.margin = s / tolerance;
    } else if (!(s <= rounding) && !(shrinks * s <= coarse[k])) {
      told = told && static_cast<int>(k) >= bounds.upper;
    }
  }
  if (r.counted > bounds.upper) return r;
  if (bounds.lower == bounds.upper || (told && r.counted >= bounds.lower)) {
    r.status = Status::ok;
    r.value = std::max(r.counted, bounds.lower);
  }
  return r;
}
}  // namespace orbit

// With both bases, U and V, for what needs them.
template <int N>
struct Decomposition {
  std::array<double, static_cast<std::size_t>(N)> sigma;
  Mat<N, N> u, v;
};
template <int N>
Decomposition<N> decompose(const Mat<N, N>& matrix) noexcept {
  const Eigen::JacobiSVD<Mat<N, N>> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Decomposition<N> r{{}, svd.matrixU(), svd.matrixV()};
  for (int i = 0; i < N; ++i) r.sigma[static_cast<std::size_t>(i)] = svd.singularValues()[i];
  return r;
}

// Rank of a measured matrix, which a theorem bounds.
template <int N>
Rank<N> rank_of(const Measured<N>& m, Bounds bounds) noexcept {
  if (!m.value.allFinite() || !m.coarse.allFinite() || !(m.tolerance >= 0.0)) return {};
  return orbit::decide(singular_values<N>(m.value), singular_values<N>(m.coarse), m.tolerance, m.rounding, bounds);
}

// Rank of a matrix known to within `tolerance` in the 2-norm; 0 where it is exact.
template <int N>
Rank<N> rank_of(const Mat<N, N>& matrix, double tolerance) noexcept {
  return rank_of<N>({matrix, matrix, tolerance, tolerance, Mat<N, N>::Zero()}, {0, N});
}

// Rank of a product of matrices from their ranks, eqs. 6 and 7. `interior`: the dimensions between neighbours, one
// fewer than there are factors (eq. 7 as printed sums the outer ones too).
inline Bounds sylvester(std::span<const int> ranks, std::span<const int> interior) noexcept {
  Bounds b{0, std::numeric_limits<int>::max()};
  for (const int r : ranks) {
    b.upper = std::min(b.upper, r);
    b.lower += r;
  }
  for (const int n : interior) b.lower -= n;
  b.lower = std::max(b.lower, 0);
  return b;
}

// What the bounds need of an edge. Dimensions are those of charts; a section has one less.
struct EdgeRank {
  int from = 0, to = 0;
  int reset = 0;           // rank of D R_e on the tangent space of the guard
  bool transverse = true;  // R_e(G_e) to the flow of the next chart

  bool decreasing() const noexcept { return from > to; }  // counted by m, def. 7
};

inline int decreasing_edges(std::span<const EdgeRank> edges) noexcept {
  int m = 0;
  for (const EdgeRank& e : edges) m += e.decreasing() ? 1 : 0;
  return m;
}

// Rank of an edge map, Lemma 3. Where the premise fails, no more can be lost than one direction, the flow's.
inline Bounds lemma3(const EdgeRank& e) noexcept {
  const int upper = std::min(e.reset, e.to - 1);
  if (!e.decreasing() && e.transverse) return {upper, upper};
  return {std::max(0, e.reset - 1), upper};
}

// Rank of D P_q for the guard that edge q leaves through, Theorem 4; of one chart with one edge, Theorem 3. An edge
// that does not decrease but whose image is not transverse costs one, as a decreasing one does.
inline Bounds theorem4(std::span<const EdgeRank> edges, std::size_t q) noexcept {
  Bounds b{0, std::numeric_limits<int>::max()};
  for (std::size_t j = 0; j < edges.size(); ++j) {
    const EdgeRank& e = edges[j];
    b.upper = std::min({b.upper, e.reset, e.from - 1});
    b.lower += lemma3(e).lower;
    if (j != q) b.lower -= e.from - 1;
  }
  b.lower = std::max(b.lower, 0);
  return b;
}

// Why multipliers of D P_q are zero. The first three are trivial: no perturbation of the dynamics changes them. The
// next two say that the cycle forgets more than its charts and resets explain.
struct ZeroMultipliers {
  int section = 0;    // the direction out of the section (1)
  int dimension = 0;  // a chart of lower dimension on the way
  int reset = 0;      // a reset of lower rank than its charts allow
  int chain = 0;      // rank lost by composition, below Theorem 4's upper bound
  int nilpotent = 0;  // rank that is there, but is lost within some more passages
  int untold = 0;     // zero within their errors: nothing else is known

  int total() const noexcept { return section + dimension + reset + chain + nilpotent + untold; }
};

inline ZeroMultipliers classify(std::span<const EdgeRank> edges, std::size_t q, int rank, int nonzero,
                                int untold = 0) noexcept {
  int smallest = std::numeric_limits<int>::max();
  for (const EdgeRank& e : edges) smallest = std::min(smallest, e.from - 1);
  const int upper = theorem4(edges, q).upper;
  return {1, edges[q].from - 1 - smallest, smallest - upper, upper - rank, rank - nonzero - untold, untold};
}

}  // namespace saltus
