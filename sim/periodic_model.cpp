// How a periodic model answers its inputs: its return map, its HTFs, and back from HTFs to the inputs they ask for.
#include "periodic_model.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>

namespace saltus {
namespace {

using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Index = Eigen::Index;

constexpr double turn = 2.0 * std::numbers::pi;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

}  // namespace

int PeriodicModel::smallest_section() const {
  int best = 0;
  for (int n = 1; n < sections; ++n) {
    if (dim(n) < dim(best)) best = n;
  }
  return best;
}

MatrixXd PeriodicModel::monodromy(int n) const {
  MatrixXd r = MatrixXd::Identity(dim(n), dim(n));
  for (int k = 0; k < sections; ++k) r = (A[at((n + k) % sections)] * r).eval();
  return r;
}

MatrixXcd PeriodicModel::htf(double omega) const {
  const Complex back = phasor(-omega);
  Eigen::VectorXcd particular = Eigen::VectorXcd::Zero(dim(0));
  for (std::size_t n = 0; n < A.size(); ++n) particular = ((A[n] * particular + B[n]) * back).eval();
  const MatrixXcd closure = MatrixXcd::Identity(dim(0), dim(0)) - monodromy(0) * phasor(-omega * sections);
  Eigen::VectorXcd x = closure.partialPivLu().solve(particular);
  MatrixXcd h = MatrixXcd::Zero(sections, outputs);
  for (Index n = 0; n < sections; ++n) {
    const Eigen::VectorXcd y = C[at(n)] * x;
    for (Index m = 0; m < sections; ++m) {
      h.row(m) += (y * root_of_unity(-m * n, sections)).transpose() / static_cast<double>(sections);
    }
    x = ((A[at(n)] * x + B[at(n)]) * back).eval();
  }
  return h;
}

// The response of G_n to B[k] depends on the line only through z = exp(i omega N) and a phase, so lines of equal z
// share their work.
void fit_inputs(const HtfTable& t, const std::vector<MatrixXcd>& g, const Eigen::VectorXd& scale, PeriodicModel& m) {
  const Index sections = t.sections;
  std::vector<Index> start(at(sections) + 1, 0);  // of B[k] among the unknowns
  for (Index k = 0; k < sections; ++k) start[at(k) + 1] = start[at(k)] + m.A[at(k)].rows();
  const Index unknowns = start.back();
  std::map<std::int64_t, std::vector<std::size_t>> classes;
  for (std::size_t q = 0; q < t.omega.size(); ++q) {
    const double cycles = t.omega[q] * static_cast<double>(sections) / turn;
    classes[std::llround((cycles - std::floor(cycles)) * 1e9)].push_back(q);
  }
  MatrixXd normal = MatrixXd::Zero(unknowns, unknowns);
  Eigen::VectorXd rhs = Eigen::VectorXd::Zero(unknowns);
  for (const auto& [key, members] : classes) {
    const Complex back = phasor(-t.omega[members[0]] * static_cast<double>(sections));
    MatrixXcd response(sections * t.outputs, unknowns);  // of y at section n in time, from B[k] u at section k of one
    for (Index k = 0; k < sections; ++k) {               // cycle, summed over all cycles before
      const Index next = (k + 1) % sections, size = start[at(k) + 1] - start[at(k)];
      const MatrixXd mono = m.monodromy(static_cast<int>(next));
      MatrixXcd x = (MatrixXcd::Identity(size, size) - back * mono).partialPivLu().inverse();
      for (Index j = 1; j <= sections; ++j) {
        const Index n = (k + j) % sections;
        // Sections before k + 1 of the same cycle hear of it one cycle later.
        const Complex delay = k + j >= sections ? back : Complex{1.0};
        for (Index c = 0; c < t.outputs; ++c) {
          response.block(n * t.outputs + c, start[at(k)], 1, size) = m.C[at(n)].row(c) / scale[c] * (x * delay);
        }
        x = (m.A[at(n)] * x).eval();
      }
    }
    const MatrixXcd gram = response.adjoint() * response;
    for (Index k = 0; k < sections; ++k) {
      for (Index l = 0; l < sections; ++l) {
        Complex weight{};
        for (const std::size_t q : members) weight += phasor(t.omega[q] * static_cast<double>(l - k));
        normal.block(start[at(k)], start[at(l)], start[at(k) + 1] - start[at(k)], start[at(l) + 1] - start[at(l)]) +=
            (weight *
             gram.block(start[at(k)], start[at(l)], start[at(k) + 1] - start[at(k)], start[at(l) + 1] - start[at(l)]))
                .real();
      }
    }
    for (const std::size_t q : members) {
      Eigen::VectorXcd y(sections * t.outputs);
      for (Index n = 0; n < sections; ++n) {
        for (Index c = 0; c < t.outputs; ++c) {
          y[n * t.outputs + c] = g[q](n, c) / scale[c] * phasor(t.omega[q] * static_cast<double>(n));
        }
      }
      const Eigen::VectorXcd v = response.adjoint() * y;
      for (Index k = 0; k < sections; ++k) {
        const Index size = start[at(k) + 1] - start[at(k)];
        rhs.segment(start[at(k)], size) +=
            (phasor(-t.omega[q] * static_cast<double>(k)) * v.segment(start[at(k)], size)).real();
      }
    }
  }
  // Inputs that the band does not hold have no say: the least-norm answer.
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(normal);
  const Eigen::VectorXd& lambda = solver.eigenvalues();
  Eigen::VectorXd x = solver.eigenvectors().transpose() * rhs;
  for (Index i = 0; i < unknowns; ++i) x[i] = lambda[i] > 1e-13 * lambda[unknowns - 1] ? x[i] / lambda[i] : 0.0;
  x = (solver.eigenvectors() * x).eval();
  m.B.clear();
  for (Index k = 0; k < sections; ++k) m.B.push_back(x.segment(start[at(k)], start[at(k) + 1] - start[at(k)]));
}

}  // namespace saltus
