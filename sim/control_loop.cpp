#include "control_loop.hpp"

#include <cmath>
#include <limits>

namespace saltus {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

// One section of the loop: the states of machine and controller, one below the other, from n to n + 1; and what an
// input that the controller does not know of adds.
struct LoopStep {
  MatrixXd map;
  VectorXd unknown;
};

LoopStep loop_step(const PeriodicModel& machine, const PeriodicModel& model, const ControlGains& gains, int n) {
  const auto i = at(n);
  const Eigen::Index own = machine.A[i].cols(), held = model.A[i].cols();
  const MatrixXd &k = gains.regulator[i], &l = gains.filter[i];
  MatrixXd corrected(held, own + held);  // the controller's estimate, from both states
  corrected << l * machine.C[i], MatrixXd::Identity(held, held) - l * model.C[i];
  const MatrixXd u = -k * corrected;
  LoopStep s;
  s.map.resize(machine.A[i].rows() + model.A[i].rows(), own + held);
  s.map.topRows(machine.A[i].rows()) = machine.B[i] * u;
  s.map.topLeftCorner(machine.A[i].rows(), own) += machine.A[i];
  s.map.bottomRows(model.A[i].rows()) = model.A[i] * corrected + model.B[i] * u;
  s.unknown = VectorXd::Zero(s.map.rows());
  s.unknown.head(machine.A[i].rows()) = machine.B[i];
  return s;
}

}  // namespace

std::vector<Complex> loop_multipliers(const PeriodicModel& machine, const PeriodicModel& model,
                                      const ControlGains& gains) {
  const int first = machine.smallest_section();
  MatrixXd cycle;
  for (int j = 0; j < machine.sections; ++j) {
    const MatrixXd map = loop_step(machine, model, gains, (first + j) % machine.sections).map;
    cycle = j == 0 ? map : MatrixXd(map * cycle);
  }
  return nonzero_multipliers(cycle);
}

std::vector<VectorXd> loop_response(const PeriodicModel& machine, const PeriodicModel& model, const ControlGains& gains,
                                    double kick, int cycles) {
  std::vector<VectorXd> y;
  const bool closed = !gains.regulator.empty();
  VectorXd x = VectorXd::Zero(machine.dim(0) + (closed ? model.dim(0) : 0));
  for (int n = 0; n < cycles * machine.sections; ++n) {
    const int section = n % machine.sections;
    y.emplace_back(machine.C[at(section)] * x.head(machine.dim(section)));
    const double unknown = n == 0 ? kick : 0.0;
    if (closed) {
      const LoopStep s = loop_step(machine, model, gains, section);
      x = (s.map * x + unknown * s.unknown).eval();
    } else {
      x = (machine.A[at(section)] * x + unknown * machine.B[at(section)]).eval();
    }
  }
  return y;
}

std::vector<double> deviation_of_cycles(const std::vector<VectorXd>& y, int sections,
                                        const std::vector<double>& scale) {
  std::vector<double> r;
  for (std::size_t from = 0; from + at(sections) <= y.size(); from += at(sections)) {
    double square = 0.0;
    for (std::size_t n = from; n < from + at(sections); ++n) {
      for (std::size_t c = 0; c < scale.size(); ++c) {
        const double z = y[n][static_cast<Eigen::Index>(c)] / scale[c];
        square += z * z / sections;
      }
    }
    r.push_back(std::sqrt(square));
  }
  return r;
}

double decay_of(const std::vector<double>& deviation, const std::vector<double>& reference) {
  constexpr double floor = 1e-3;
  std::size_t last = 1;
  while (last + 1 < std::min(deviation.size(), reference.size()) && reference[last + 1] > floor * reference[1]) ++last;
  if (last < 2 || !(deviation[1] > 0.0)) return std::numeric_limits<double>::quiet_NaN();
  return std::pow(deviation[last] / deviation[1], 1.0 / static_cast<double>(last - 1));
}

}  // namespace saltus
