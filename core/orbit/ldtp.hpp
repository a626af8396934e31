// The linear discrete-time periodic system: x[n+1] = A[n] x[n] + B[n] u[n], y[n] = C[n] x[n] + D[n] u[n], period N
// (Ankarali & Cowan 2014, eq. 6), its monodromy (eq. 7) and nothing model-specific.
#pragma once

#include <array>

#include "../linalg.hpp"

namespace saltus {

// NX is the largest dimension of a section; where a section is smaller the rows and columns beyond it are zero.
template <int NX, int NU, int NY, int N>
struct Ldtp {
  static constexpr int states = NX, inputs = NU, outputs = NY, sections = N;
  std::array<int, N> dim{};  // of x[n]
  std::array<Mat<NX, NX>, N> A{};
  std::array<Mat<NX, NU>, N> B{};
  std::array<Mat<NY, NX>, N> C{};
  std::array<Mat<NY, NU>, N> D{};

  // Linearised return map at section n: A[n+N-1] ... A[n+1] A[n], (dim[n] x dim[n]) in its upper left corner.
  Mat<NX, NX> monodromy(int n) const noexcept {
    Mat<NX, NX> r = Mat<NX, NX>::Identity();
    for (int k = 0; k < N; ++k) r = (A[static_cast<std::size_t>((n + k) % N)] * r).eval();
    for (int i = dim[static_cast<std::size_t>(n)]; i < NX; ++i) {
      r.row(i).setZero();
      r.col(i).setZero();
    }
    return r;
  }
};

}  // namespace saltus
