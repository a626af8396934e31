// Harmonic transfer functions of a linear discrete-time periodic system, exactly. For u[n] = e^{i w n} the steady
// response is y[n] = sum_m H_m(w) e^{i (w + 2 pi m / N) n}: H_m pairs the input at w with the output at w + 2 pi m / N
// (Ankarali & Cowan 2014, eqs. 8-14, in the convention of eq. 14).
#pragma once

#include <Eigen/LU>

#include <array>
#include <cmath>
#include <numbers>

#include "../orbit/ldtp.hpp"

namespace saltus {

// H_m at one frequency, m = -N/2 ... (N-1)/2, each (NY x NU), output unit per input unit.
template <int NY, int NU, int N>
struct Harmonics {
  std::array<Mat<NY, NU, Complex>, N> h{};

  Mat<NY, NU, Complex>& operator()(int m) noexcept { return h[static_cast<std::size_t>((m % N + N) % N)]; }
  const Mat<NY, NU, Complex>& operator()(int m) const noexcept { return h[static_cast<std::size_t>((m % N + N) % N)]; }
};

// e^{i angle}
inline Complex phasor(double angle) noexcept { return {std::cos(angle), std::sin(angle)}; }

// By the periodic solution in the frequency domain: x[n] = X[n] e^{i w n} with X of period N, so that
// (e^{i w N} - A[N-1]...A[0]) X[0] = sum of the inputs carried to the end of the cycle. omega in rad per section.
// A frequency at which e^{i w N} is a multiplier gives non-finite numbers.
template <int NX, int NU, int NY, int N>
Harmonics<NY, NU, N> htf(const Ldtp<NX, NU, NY, N>& system, double omega) noexcept {
  using CX = Mat<NX, NU, Complex>;
  const Complex back = phasor(-omega);
  CX particular = CX::Zero();  // X[n] started from X[0] = 0
  Mat<NX, NX> transition = Mat<NX, NX>::Identity();
  for (std::size_t n = 0; n < N; ++n) {
    particular =
        ((system.A[n].template cast<Complex>() * particular + system.B[n].template cast<Complex>()) * back).eval();
    transition = (system.A[n] * transition).eval();
  }
  const Mat<NX, NX, Complex> closure =
      Mat<NX, NX, Complex>::Identity() - transition.template cast<Complex>() * phasor(-omega * N);
  CX x = Eigen::PartialPivLU<Mat<NX, NX, Complex>>(closure).solve(particular);

  Harmonics<NY, NU, N> r;
  for (auto& h : r.h) h.setZero();
  for (std::size_t n = 0; n < N; ++n) {
    const Mat<NY, NU, Complex> y = system.C[n].template cast<Complex>() * x + system.D[n].template cast<Complex>();
    for (std::size_t m = 0; m < N; ++m) {
      const double turn = static_cast<double>((m * n) % static_cast<std::size_t>(N)) / N;
      r.h[m] += y * (phasor(-2.0 * std::numbers::pi * turn) / static_cast<double>(N));
    }
    x = ((system.A[n].template cast<Complex>() * x + system.B[n].template cast<Complex>()) * back).eval();
  }
  return r;
}

// The paper's route: H[n, n-r] of eq. 8, its Fourier series over n, eqs. 9-10, its transform over r, eq. 13, cut at
// `cycles` cycles. Slower and truncated: the cross-check of `htf`.
template <int NX, int NU, int NY, int N>
Harmonics<NY, NU, N> htf_by_impulses(const Ldtp<NX, NU, NY, N>& system, double omega, int cycles) noexcept {
  Harmonics<NY, NU, N> r;
  for (auto& h : r.h) h.setZero();
  const auto gather = [&](int n, int lag, const Mat<NY, NU>& h) {
    for (int m = 0; m < N; ++m) {
      const double turn = static_cast<double>((m * n) % N) / N;
      const Complex weight = phasor(-2.0 * std::numbers::pi * turn - omega * lag) / static_cast<double>(N);
      r.h[static_cast<std::size_t>(m)] += h.template cast<Complex>() * weight;
    }
  };
  for (int k = 0; k < N; ++k) {  // an impulse at section k
    Mat<NX, NU> x = system.B[static_cast<std::size_t>(k)];
    gather(k, 0, system.D[static_cast<std::size_t>(k)]);
    for (int lag = 1; lag <= cycles * N; ++lag) {
      const auto n = static_cast<std::size_t>((k + lag) % N);
      gather((k + lag) % N, lag, system.C[n] * x);
      x = (system.A[n] * x).eval();
    }
  }
  return r;
}

}  // namespace saltus
