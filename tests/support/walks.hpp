// Records of walkers let go near their gaits, whose multipliers are known.
#pragma once

#include <complex>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/flow/advance.hpp"
#include "core/random.hpp"
#include "hal/record.hpp"
#include "sim/models/compass_gait.hpp"

namespace saltus::test {

struct Walks {
  int experiments = 24, steps = 8;
  double scatter = 3e-4;  // [-] of the state a walk begins with: its basin is small
  double sigma = 1e-6;    // [rad] noise of the angles; of the rates ten times that
  double dt = 0.005;      // [s]
  bool two_legs = false;  // as a robot records itself: the angle of one leg against the other
  std::uint64_t seed = 5;
};

// Of a step at declared parameters, from its limit cycle (`saltus orbit compass_gait`).
inline const std::vector<std::complex<double>> compass_gait_multipliers = {
    {-0.199726126830, 0.544476062095}, {-0.199726126830, -0.544476062095}, {0.131572624077, 0.0}};

// The compass gait: one chart with its own outputs; or, as two legs, charts "outer" and "inner" by the leg that stands,
// hip (inner against outer) and stance with their rates.
inline Record walks_of(const CompassGait<>& m, const Walks& w) {
  Random random(w.seed);
  Record r;
  r.name = "walks";
  if (w.two_legs) {
    r.chart_names = {"outer", "inner"};
    r.outputs = {{"hip", "rad", {}}, {"stance", "rad", {}}, {"rate_hip", "rad/s", {}}, {"rate_stance", "rad/s", {}}};
  } else {
    r.model = "compass_gait";
    r.chart_names = {"Swing"};
    for (const Quantity& q : CompassGait<>::outputs)
      r.outputs.push_back({std::string(q.name), std::string(q.unit), {}});
  }
  const Timebase base{2.0, static_cast<std::int64_t>(2.0 / w.dt + 0.5)};
  Run<CompassGait<>> settled;
  settled.at = start_of(m);
  for (int n = 0; n < 3200; ++n) step(m, settled, Vec<0>{}, base);
  while (step(m, settled, Vec<0>{}, base).events == 0) continue;
  for (int e = 0; e < w.experiments; ++e) {
    Run<CompassGait<>> run;
    run.at = settled.at;
    for (int i = 0; i < 4; ++i) run.at.x[i] *= 1.0 + w.scatter * random.normal();
    int steps = 1;
    for (int n = 0; steps <= w.steps; ++n) {
      const Vec<4> x(run.at.x.head<4>());
      const double leg = steps % 2 == 1 ? 1.0 : -1.0;
      const double outer[4] = {leg * (x[0] - x[1]), x[1], leg * (x[2] - x[3]), x[3]};
      r.experiment.push_back(e);
      r.cycle.push_back(steps);
      r.chart.push_back(w.two_legs ? (steps + 1) % 2 : 0);
      r.t.push_back(n * w.dt);
      for (int o = 0; o < 4; ++o) {
        r.outputs[static_cast<std::size_t>(o)].values.push_back((w.two_legs ? outer[o] : x[o]) +
                                                                (o < 2 ? 1.0 : 10.0) * w.sigma * random.normal());
      }
      const auto s = step(m, run, Vec<0>{}, base);
      if (!usable(s.status) || n > 10000) throw std::runtime_error("the walker fell");
      steps += static_cast<int>(s.events);
    }
  }
  return r;
}

}  // namespace saltus::test
