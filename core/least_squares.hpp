// Streaming linear least squares: rows come one at a time, memory and work per row are constant.
#pragma once

#include "status.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

namespace saltus {

// Minimises the sum over rows of weight (rhs - row . x)^2 over x in R^N. Each row is folded by Givens rotations into
// the triangular factor R of the weighted rows (Golub & Van Loan, Matrix Computations, 5.1 and 6.5), so that errors
// grow with the condition of the rows, not with its square as in the normal equations.
template <int N, class T = double>
class LeastSquares {
  static_assert(N >= 1);

 public:
  static constexpr std::size_t columns = static_cast<std::size_t>(N);

  void reset() noexcept { *this = LeastSquares{}; }

  // Folds in one equation. One that holds a number that is not finite, or whose weight is not positive, is left out
  // whole and answered by Status::missing.
  Status add(std::span<const T, columns> row, T rhs, T weight = T(1)) noexcept {
    const T scale = weight > T(0) ? std::sqrt(weight) : std::numeric_limits<T>::quiet_NaN();
    std::array<T, columns> a;
    bool finite = std::isfinite(scale * rhs);
    for (std::size_t j = 0; j < columns; ++j) {
      a[j] = scale * row[j];
      finite = finite && std::isfinite(a[j]);
    }
    if (!finite) return Status::missing;
    fold(a, scale * rhs, 0);
    ++rows_;
    return Status::ok;
  }

  // The minimiser. A column that depends on those before it to within `tolerance` of its own norm gets 0, and all that
  // was measured about the others is kept; see rank(). The factor forgets what it held beyond that tolerance of such
  // columns, which is why this is not const. Status::failed if the result is not finite.
  Status solve(std::array<T, columns>& x, T tolerance = T(32 * N) * std::numeric_limits<T>::epsilon()) noexcept {
    for (std::size_t j = 0; j < columns; ++j) {
      T norm = T(0);
      for (std::size_t i = 0; i <= j; ++i) norm = std::hypot(norm, r_[at(i, j)]);
      if (std::abs(r_[at(j, j)]) <= tolerance * norm) drop(j);
    }
    for (std::size_t j = columns; j-- > 0;) {
      const T pivot = r_[at(j, j)];
      T sum = d_[j];
      for (std::size_t k = j + 1; k < columns; ++k) sum -= r_[at(j, k)] * x[k];
      x[j] = pivot == T(0) ? T(0) : sum / pivot;
      if (!std::isfinite(x[j])) return Status::failed;
    }
    return Status::ok;
  }

  // Weighted sum of squared residuals at the minimiser (after solve(): at the x it gave).
  T rss() const noexcept { return rss_; }

  // Equations folded in.
  std::int64_t rows() const noexcept { return rows_; }

  // Columns that carry information; after solve(): those that did not get a plain 0.
  int rank() const noexcept {
    int count = 0;
    for (std::size_t j = 0; j < columns; ++j) count += r_[at(j, j)] != T(0);
    return count;
  }

  // Element (i, j) of (R^T R)^-1: the covariance of x_i and x_j for weights that are inverse variances, otherwise to be
  // multiplied by rss() / (rows() - rank()). Infinite for a dropped column with itself, 0 with others.
  T covariance(int i, int j) const noexcept {
    const auto p = static_cast<std::size_t>(i);
    const auto q = static_cast<std::size_t>(j);
    if (r_[at(p, p)] == T(0) || r_[at(q, q)] == T(0)) return p == q ? std::numeric_limits<T>::infinity() : T(0);
    const std::array<T, columns> v = forward(p);
    const std::array<T, columns> w = forward(q);
    T sum = T(0);
    for (std::size_t k = p < q ? q : p; k < columns; ++k) sum += v[k] * w[k];
    return sum;
  }

 private:
  // Place of element (i, j), j >= i, in the packed rows.
  static constexpr std::size_t at(std::size_t i, std::size_t j) noexcept { return i * (2 * columns - i - 1) / 2 + j; }

  // Rotates the equation a . x = rhs, whose first `from` entries are zero, into the factor.
  void fold(std::array<T, columns>& a, T rhs, std::size_t from) noexcept {
    for (std::size_t j = from; j < columns; ++j) {
      if (a[j] == T(0)) continue;
      T* const r = &r_[at(j, j)];
      const T norm = std::hypot(*r, a[j]);
      const T c = *r / norm;
      const T s = a[j] / norm;
      *r = norm;
      for (std::size_t k = j + 1; k < columns; ++k) {
        const T upper = r[k - j];
        r[k - j] = c * upper + s * a[k];
        a[k] = c * a[k] - s * upper;
      }
      const T upper = d_[j];
      d_[j] = c * upper + s * rhs;
      rhs = c * rhs - s * upper;
    }
    rss_ += rhs * rhs;
  }

  // Takes row j of the factor, but for its negligible pivot, as an equation for the columns after j.
  void drop(std::size_t j) noexcept {
    std::array<T, columns> a{};
    for (std::size_t k = j + 1; k < columns; ++k) a[k] = r_[at(j, k)];
    const T rhs = d_[j];
    for (std::size_t k = j; k < columns; ++k) r_[at(j, k)] = T(0);
    d_[j] = T(0);
    fold(a, rhs, j + 1);
  }

  // R^-T e_p over the columns kept.
  std::array<T, columns> forward(std::size_t p) const noexcept {
    std::array<T, columns> w{};
    for (std::size_t k = p; k < columns; ++k) {
      if (r_[at(k, k)] == T(0)) continue;
      T sum = k == p ? T(1) : T(0);
      for (std::size_t i = p; i < k; ++i) sum -= r_[at(i, k)] * w[i];
      w[k] = sum / r_[at(k, k)];
    }
    return w;
  }

  std::array<T, columns*(columns + 1) / 2> r_{};  // upper triangle, row by row
  std::array<T, columns> d_{};                    // right-hand side, rotated alike
  T rss_ = T(0);
  std::int64_t rows_ = 0;
};

}  // namespace saltus
