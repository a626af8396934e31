// Point masses on straight links that turn about one pivot, in a plane: mass i stands at sum_j c_ij (sin q_j, cos q_j),
// q_j the angle of link j from the vertical. Its dynamics needs two sums only, A = sum m c c^T and B = sum m c:
//   sum_k A_jk (cos(q_j - q_k) q_k'' + sin(q_j - q_k) q_k'^2) = g B_j sin(q_j + slope) + torque_j
// Mirror-symmetric: the same with all angles counted the other way round.
#pragma once

#include <Eigen/LU>

#include "core/scalar.hpp"

namespace saltus {

template <int N, class S>
struct Linkage {
  static_assert(N <= 4, "the inverse of a mass matrix is by cofactors");
  Mat<N, N, S> A = Mat<N, N, S>::Constant(S(0.0));  // [kg m^2]
  Vec<N, S> B = Vec<N, S>::Constant(S(0.0));        // [kg m]

  // A mass [kg] at distances c [m] along the links.
  void add(const S& mass, const Vec<N, S>& c) noexcept {
    const Vec<N, S> moment = mass * c;
    B += moment;
    A += moment.lazyProduct(c.transpose());
  }

  // Mass matrix at angles q [rad]: the kinetic energy is v^T M v / 2.
  Mat<N, N, S> mass(const Vec<N, S>& q) const noexcept { return mass(pairs_of(q)); }
  Mat<N, N, S> mass_inverse(const Vec<N, S>& q) const noexcept { return mass(q).inverse(); }

  // [N m] of weight and of the links' motion, joint by joint.
  Vec<N, S> torques(const Vec<N, S>& q, const Vec<N, S>& v, const S& g, const S& slope) const noexcept {
    return torques(pairs_of(q), q, v, g, slope);
  }
  // q'' [rad/s^2] without other torques.
  Vec<N, S> acceleration(const Vec<N, S>& q, const Vec<N, S>& v, const S& g, const S& slope) const noexcept {
    const Pairs pairs = pairs_of(q);
    return mass(pairs).inverse() * torques(pairs, q, v, g, slope);
  }

  // Rates after a plastic impact that stops the pivot, which came along at (px, py) [m/s] with the links turning at w:
  // the moment of momentum of every link about its joint is kept.
  Vec<N, S> stopped(const Vec<N, S>& q, const Vec<N, S>& w, const S& px, const S& py) const noexcept {
    Vec<N, S> moment;
    for (int j = 0; j < N; ++j) moment[j] = B[j] * (cos(q[j]) * px - sin(q[j]) * py);
    return w + mass_inverse(q) * moment;
  }

  // [J], the potential counted from the pivot.
  S energy(const Vec<N, S>& q, const Vec<N, S>& v, const S& g, const S& slope) const noexcept {
    S e = 0.5 * v.dot(mass(q) * v);
    for (int j = 0; j < N; ++j) e += g * B[j] * cos(q[j] + slope);
    return e;
  }

 private:
  // Of q_j - q_k at (j, k), k < j: one reduction of an angle for both, and none for its negative.
  struct Pairs {
    Mat<N, N, S> cos, sin;
  };
  static Pairs pairs_of(const Vec<N, S>& q) noexcept {
    Pairs r;
    for (int j = 0; j < N; ++j) {
      for (int k = 0; k < j; ++k) {
        const auto p = on_circle(q[j] - q[k]);
        r.cos(j, k) = p.cos;
        r.sin(j, k) = p.sin;
      }
    }
    return r;
  }
  Mat<N, N, S> mass(const Pairs& pairs) const noexcept {
    Mat<N, N, S> r;
    for (int j = 0; j < N; ++j) {
      r(j, j) = A(j, j);
      for (int k = 0; k < j; ++k) r(j, k) = r(k, j) = A(j, k) * pairs.cos(j, k);
    }
    return r;
  }
  Vec<N, S> torques(const Pairs& pairs, const Vec<N, S>& q, const Vec<N, S>& v, const S& g,
                    const S& slope) const noexcept {
    Vec<N, S> torque;
    for (int j = 0; j < N; ++j) {
      torque[j] = g * B[j] * sin(q[j] + slope);
      for (int k = 0; k < j; ++k) torque[j] -= A(j, k) * pairs.sin(j, k) * v[k] * v[k];
      for (int k = j + 1; k < N; ++k) torque[j] += A(j, k) * pairs.sin(k, j) * v[k] * v[k];
    }
    return torque;
  }
};

}  // namespace saltus
