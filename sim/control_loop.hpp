// A controller from a realised model on a machine that it was not derived from: what the linear models promise, and
// what the nonlinear machine then does.
#pragma once

#include <memory>
#include <vector>

#include "campaign.hpp"
#include "core/spectrum/periodic_control.hpp"
#include "realisation.hpp"

namespace saltus {

inline constexpr int controller_states = 8;  // room in the loop's fixed sizes
template <int NY>
using Controller = PeriodicController<controller_states, 1, NY, campaign_sections>;

// The weights of the regulator by Bryson's rule, inverse squares of deviations that are as bad as one another; and what
// the filter is to expect.
struct ControlOptions {
  std::vector<double> deviation;  // [output unit] of each output
  double input = 1.0;             // [input unit]
  std::vector<double> noise;      // [output unit] standard deviation of each output's noise
  double disturbance = 1.0;       // [input unit] standard deviation of a random force where the input acts
  double kick = 1.0;              // [input unit] held over the first section, unknown to the controller
  int cycles = 12;
  bool noisy = false;  // the machine's outputs have that noise
  std::uint64_t seed = 1;
};

// The gains of a controller, for linear models: u = -regulator (z + filter (y - C z)).
struct ControlGains {
  std::vector<Eigen::MatrixXd> regulator, filter;  // (1 x dim(n)), (dim(n) x ny)
};

// Multipliers of a linear machine under a controller that holds `model`: those of machine and controller together, by
// falling modulus. With the model itself for machine they are those of regulator and filter.
std::vector<Complex> loop_multipliers(const PeriodicModel& machine, const PeriodicModel& model,
                                      const ControlGains& gains);

// Outputs of that loop at every section, from rest, where `kick` adds to the first input. No gains: without control.
std::vector<Eigen::VectorXd> loop_response(const PeriodicModel& machine, const PeriodicModel& model,
                                           const ControlGains& gains, double kick, int cycles);

// Root of the mean over the sections of each cycle of sum_c (y_c / scale_c)^2.
std::vector<double> deviation_of_cycles(const std::vector<Eigen::VectorXd>& y, int sections,
                                        const std::vector<double>& scale);

// What a cycle leaves of a deviation: its geometric mean from the second cycle to the last, or to the last before
// `reference` fell to a thousandth of its second, for below the machine's own curvature and rounding take over. NaN
// where there are no two such cycles.
double decay_of(const std::vector<double>& deviation, const std::vector<double>& reference);

// A known system with its own dimensions.
template <int NX, int NY, int N>
PeriodicModel model_of(const Ldtp<NX, 1, NY, N>& system) {
  PeriodicModel r;
  r.sections = N;
  r.outputs = NY;
  for (std::size_t n = 0; n < N; ++n) {
    const int here = system.dim[n], next = system.dim[(n + 1) % N];
    r.A.emplace_back(system.A[n].topLeftCorner(next, here));
    r.B.emplace_back(system.B[n].topRows(next));
    r.C.emplace_back(system.C[n].leftCols(here));
  }
  return r;
}

template <int NY>
ControlGains gains_of(const Controller<NY>& controller, const PeriodicModel& model) {
  ControlGains g;
  for (int n = 0; n < model.sections; ++n) {
    g.regulator.emplace_back(controller.gain(n).leftCols(model.dim(n)));
    g.filter.emplace_back(controller.filter(n).topRows(model.dim(n)));
  }
  return g;
}

// failed: the model does not fit into the loop's sizes, or the Riccati equations do not settle.
template <int NY>
Status design(Controller<NY>& controller, const PeriodicModel& model, const ControlOptions& o) {
  const auto system = std::make_unique<Ldtp<controller_states, 1, NY, campaign_sections>>();
  if (!copy_to(model, *system)) return Status::failed;
  ControlWeights<1, NY> w;
  for (int c = 0; c < NY; ++c) {
    const auto i = static_cast<std::size_t>(c);
    w.output(c, c) = 1.0 / (o.deviation[i] * o.deviation[i]);
    w.noise(c, c) = o.noise[i] * o.noise[i];
  }
  w.input(0, 0) = 1.0 / (o.input * o.input);
  w.disturbance(0, 0) = o.disturbance * o.disturbance;
  return controller.design(*system, w);
}

struct ControlRun {
  Status status = Status::failed;          // the worst that the machine reported
  std::vector<double> input;               // [input unit] of the controller, a section
  std::vector<Eigen::VectorXd> deviation;  // [output unit] of the outputs from the cycle, before noise
};

// The machine from its cycle on, kicked over the first section; under the controller, or `none`.
template <class M, class Family>
ControlRun run_under(Controller<output_count<M>>* controller, const M& m, const Family& family, std::int64_t ticks,
                     const Orbit<M, campaign_sections>& orbit, const ControlOptions& o) {
  constexpr int ny = output_count<M>;
  Timebase base = timebase_of(m, ticks);
  if constexpr (!Family::on_grid) base.sets_clock = false;
  Random random(o.seed);
  Run<M> run;
  run.at = orbit.point[0];
  if (controller != nullptr) controller->reset();
  ControlRun r;
  r.status = Status::ok;
  for (int n = 0; n < o.cycles * campaign_sections; ++n) {
    const int section = n % campaign_sections;
    const Output<M> off =
        output_at(m, run.at, Input<M>(Input<M>::Zero())) - orbit.output[static_cast<std::size_t>(section)];
    Output<M> measured = off;
    for (int c = 0; o.noisy && c < ny; ++c) measured[c] += o.noise[static_cast<std::size_t>(c)] * random.normal();
    const double u = controller != nullptr ? controller->step(section, measured)[0] : 0.0;
    r.deviation.emplace_back(off);
    r.input.push_back(u);
    r.status = worse(r.status, to_next_section(m, run, section, Input<M>(Input<M>::Constant(n == 0 ? u + o.kick : u)),
                                               base, family, [](const Point<M>&, const Passage&) {}));
    if (!usable(r.status)) return r;
  }
  return r;
}

}  // namespace saltus
