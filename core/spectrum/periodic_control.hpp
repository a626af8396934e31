// A controller for a linear periodic system, from the model that identification realised: periodic linear-quadratic
// regulator and Kalman filter, together the loop  measure - correct - act - predict  of constant cost.
#pragma once

#include <Eigen/LU>

#include <array>
#include <cmath>

#include "../linalg.hpp"
#include "../orbit/ldtp.hpp"
#include "../status.hpp"

namespace saltus {

// What the designer chooses. Weights of the outputs' and inputs' squares; variances of the outputs' noise, and of a
// white disturbance that enters as the input does.
template <int NU, int NY>
struct ControlWeights {
  Mat<NY, NY> output = Mat<NY, NY>::Identity();       // [1 / output unit^2]
  Mat<NU, NU> input = Mat<NU, NU>::Identity();        // [1 / input unit^2]
  Mat<NY, NY> noise = Mat<NY, NY>::Identity();        // [output unit^2]
  Mat<NU, NU> disturbance = Mat<NU, NU>::Identity();  // [input unit^2]
};

// Minimises the mean of y' Q y + u' R u. Section n is the one whose measurement was taken last; deviations from the
// cycle, not the outputs themselves, go in.
template <int NX, int NU, int NY, int N>
class PeriodicController {
 public:
  // Both periodic Riccati equations, by iteration over cycles until the gains repeat (Bittanti & Colaneri 2009, ch. 6
  // and 13). failed: they do not settle within `cycles`, or a weight is not positive definite where it must be.
  [[nodiscard]] Status design(const Ldtp<NX, NU, NY, N>& system, const ControlWeights<NU, NY>& w,
                              int cycles = 500) noexcept {
    system_ = system;
    reset();
    const Status regulator = solve_regulator(w, cycles), filter = solve_filter(w, cycles);
    return worse(regulator, filter);
  }

  // Forgets what was measured: the machine is on its cycle.
  void reset() noexcept { x_.setZero(); }

  // The deviation of the outputs at section n in, the input to hold until the next section out [input unit].
  Vec<NU> step(int n, const Vec<NY>& y) noexcept {
    const auto i = static_cast<std::size_t>(n);
    const Vec<NX> corrected = x_ + filter_[i] * (y - system_.C[i] * x_);
    const Vec<NU> u = -regulator_[i] * corrected;
    x_ = system_.A[i] * corrected + system_.B[i] * u;
    return u;
  }

  // The same where the measurement of section n is missing.
  Vec<NU> step_blind(int n) noexcept { return step(n, system_.C[static_cast<std::size_t>(n)] * x_); }

  const Vec<NX>& state() const noexcept { return x_; }  // predicted for the next section
  const Mat<NU, NX>& gain(int n) const noexcept { return regulator_[static_cast<std::size_t>(n)]; }
  const Mat<NX, NY>& filter(int n) const noexcept { return filter_[static_cast<std::size_t>(n)]; }

  // x[n] after a cycle under state feedback, error of the estimate after a cycle: their eigenvalues say how fast.
  Mat<NX, NX> closed_loop() const noexcept {
    Mat<NX, NX> r = Mat<NX, NX>::Identity();
    for (std::size_t n = 0; n < N; ++n) r = ((system_.A[n] - system_.B[n] * regulator_[n]) * r).eval();
    return r;
  }

 private:
  static constexpr double tolerance = 1e-10;  // relative change of a cycle's Riccati solution

  Status solve_regulator(const ControlWeights<NU, NY>& w, int cycles) noexcept {
    Mat<NX, NX> p = Mat<NX, NX>::Zero(), before = p;
    for (int c = 0; c < cycles; ++c) {
      for (std::size_t n = N; n-- > 0;) {
        const Mat<NX, NX>& a = system_.A[n];
        const Mat<NX, NU>& b = system_.B[n];
        const Mat<NU, NX> cross = b.transpose() * p * a;
        const Mat<NU, NU> inner = w.input + b.transpose() * p * b;
        regulator_[n] = inner.inverse() * cross;
        p = (system_.C[n].transpose() * w.output * system_.C[n] + a.transpose() * p * a -
             cross.transpose() * regulator_[n])
                .eval();
        p = (0.5 * (p + p.transpose())).eval();
      }
      if (!p.allFinite()) return Status::failed;
      if ((p - before).cwiseAbs().maxCoeff() <= tolerance * p.cwiseAbs().maxCoeff()) return Status::ok;
      before = p;
    }
    return Status::failed;
  }

  Status solve_filter(const ControlWeights<NU, NY>& w, int cycles) noexcept {
    Mat<NX, NX> s = Mat<NX, NX>::Zero(), before = s;
    for (int k = 0; k < cycles; ++k) {
      for (std::size_t n = 0; n < N; ++n) {
        const Mat<NY, NX>& c = system_.C[n];
        const Mat<NY, NY> inner = c * s * c.transpose() + w.noise;
        filter_[n] = s * c.transpose() * inner.inverse();
        const Mat<NX, NX> corrected = s - filter_[n] * c * s;
        s = system_.A[n] * corrected * system_.A[n].transpose() +
            system_.B[n] * w.disturbance * system_.B[n].transpose();
        s = (0.5 * (s + s.transpose())).eval();
      }
      if (!s.allFinite()) return Status::failed;
      if ((s - before).cwiseAbs().maxCoeff() <= tolerance * s.cwiseAbs().maxCoeff()) return Status::ok;
      before = s;
    }
    return Status::failed;
  }

  Ldtp<NX, NU, NY, N> system_{};
  std::array<Mat<NU, NX>, N> regulator_{};
  std::array<Mat<NX, NY>, N> filter_{};
  Vec<NX> x_ = Vec<NX>::Zero();
};

}  // namespace saltus
