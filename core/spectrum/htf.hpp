// Harmonic transfer functions of a linear discrete-time periodic system, exactly. For u[n] = e^{i w n} the steady
// response is y[n] = sum_m H_m(w) e^{i (w + 2 pi m / N) n}: H_m pairs the input at w with the output at w + 2 pi m / N
// (Ankarali & Cowan 2014, eqs. 8-14, in the convention of eq. 14).
#pragma once

#include <Eigen/LU>

#include <array>
#include <cmath>
#include <numbers>

#include "../orbit/ldtp.hpp"
#include "twiddles.hpp"

namespace saltus {

// H_m at one frequency, m = -N/2 ... (N-1)/2, each (NY x NU), output unit per input unit.
template <int NY, int NU, int N>
struct Harmonics {
  std::array<Mat<NY, NU, Complex>, N> h{};

  Mat<NY, NU, Complex>& operator()(int m) noexcept { return h[static_cast<std::size_t>((m % N + N) % N)]; }
  const Mat<NY, NU, Complex>& operator()(int m) const noexcept { return h[static_cast<std::size_t>((m % N + N) % N)]; }
};

// By the periodic solution in the frequency domain: x[n] = X[n] e^{i w n} with X of period N, so that
// (e^{i w N} - A[N-1]...A[0]) X[0] = sum of the inputs carried to the end of the cycle. omega in rad per section.
// A frequency at which e^{i w N} is a multiplier gives non-finite numbers. Real and imaginary parts are kept apart, as
// the system is real: half the work, and no complex product for a compiler to round in its own way.
template <int NX, int NU, int NY, int N>
Harmonics<NY, NU, N> htf(const Ldtp<NX, NU, NY, N>& system, double omega) noexcept {
  struct Parts {
    Mat<NX, NU> re = Mat<NX, NU>::Zero(), im = Mat<NX, NU>::Zero();
  };
  const auto back = on_circle(-omega);
  const auto carry = [&](Parts& x, std::size_t n) {  // (A x + B) e^{-i w}
    const Mat<NX, NU> re = system.A[n] * x.re + system.B[n], im = system.A[n] * x.im;
    x.re = re * back.cos - im * back.sin;
    x.im = re * back.sin + im * back.cos;
  };
  Parts particular;  // X[n] started from X[0] = 0
  Mat<NX, NX> transition = Mat<NX, NX>::Identity();
  for (std::size_t n = 0; n < N; ++n) {
    carry(particular, n);
    transition = (system.A[n] * transition).eval();
  }
  const auto whole = on_circle(-omega * N);
  Mat<2 * NX, 2 * NX> closure;
  closure.template topLeftCorner<NX, NX>() = Mat<NX, NX>::Identity() - transition * whole.cos;
  closure.template topRightCorner<NX, NX>() = transition * whole.sin;
  closure.template bottomLeftCorner<NX, NX>() = -transition * whole.sin;
  closure.template bottomRightCorner<NX, NX>() = closure.template topLeftCorner<NX, NX>();
  Mat<2 * NX, NU> inputs;
  inputs.template topRows<NX>() = particular.re;
  inputs.template bottomRows<NX>() = particular.im;
  const Mat<2 * NX, NU> start = Eigen::PartialPivLU<Mat<2 * NX, 2 * NX>>(closure).solve(inputs);
  Parts x{start.template topRows<NX>(), start.template bottomRows<NX>()};

  std::array<OnCircle<>, N> turn;  // e^{-2 pi i j / N} / N
  for (std::size_t j = 0; j < N; ++j) {
    const Complex w = root_of_unity(-static_cast<std::int64_t>(j), N);
    turn[j] = {w.real() / N, w.imag() / N};
  }
  Harmonics<NY, NU, N> r;
  for (auto& h : r.h) h.setZero();
  for (std::size_t n = 0; n < N; ++n) {
    const Mat<NY, NU> re = system.C[n] * x.re + system.D[n], im = system.C[n] * x.im;
    for (std::size_t m = 0; m < N; ++m) {
      const OnCircle<>& w = turn[m * n % N];
      r.h[m].real() += re * w.cos - im * w.sin;
      r.h[m].imag() += re * w.sin + im * w.cos;
    }
    carry(x, n);
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
