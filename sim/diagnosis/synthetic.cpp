#include "synthetic.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/random.hpp"
#include "core/spectrum/lines.hpp"

namespace saltus::diagnosis {
namespace {

std::vector<double> stimulus(const Campaign& c, Random& random, bool quiet) {
  const int L = c.period * c.sections;
  std::vector<double> u(static_cast<std::size_t>(L), 0.0);
  if (quiet) return u;
  std::vector<bool> taken(static_cast<std::size_t>(c.period), false);
  const int most = std::min(c.tones, (c.period - 1) / 2);
  const auto last = static_cast<std::uint64_t>(std::min(10 * c.period, L / 2) - 1);
  for (int k = 0; k < most;) {
    const int q = 1 + static_cast<int>(random.uniform_int(last));
    if (!identifiable(q, c.period) || taken[static_cast<std::size_t>(residue_class(q, c.period))]) continue;
    taken[static_cast<std::size_t>(residue_class(q, c.period))] = true;
    const double a = c.amplitude * (0.67 + 0.66 * random.uniform()), phase = 2.0 * std::numbers::pi * random.uniform();
    for (int n = 0; n < L; ++n) {
      u[static_cast<std::size_t>(n)] +=
          a * std::cos(2.0 * std::numbers::pi * static_cast<double>(static_cast<long>(q) * n % L) / L + phase);
    }
    ++k;
  }
  return u;
}

}  // namespace

bool values_with(const Machine& m, const std::vector<std::pair<std::string, double>>& changes,
                 std::vector<double>& values) {
  std::vector<double> v;
  for (const Coefficient& c : m.coefficients) v.push_back(c.nominal);
  for (const auto& change : changes) {
    const auto it = std::find_if(m.coefficients.begin(), m.coefficients.end(),
                                 [&](const Coefficient& c) { return c.name == change.first; });
    if (it == m.coefficients.end()) return false;
    v[static_cast<std::size_t>(it - m.coefficients.begin())] = change.second;
  }
  values = std::move(v);
  return true;
}

Record synthesise(const Machine& m, const std::vector<double>& values, const Campaign& c, std::uint64_t seed) {
  Record r;
  r.name = "synthetic";
  r.model = m.name;
  r.sections = "clock";
  r.sections_per_cycle = c.sections;
  r.cycle_period = m.cycle_period;
  r.stimulus_period_cycles = c.period;
  r.settle_cycles = c.settle;
  for (const auto& q : m.inputs) r.inputs.push_back({q.name, q.unit, {}});
  for (const auto& q : m.outputs) r.outputs.push_back({q.name, q.unit, {}});
  const auto orbit = m.cycle(values, 60, c.sections);
  if (orbit.empty()) return r;
  const std::size_t nu = m.inputs.size(), ny = m.outputs.size();
  const int L = c.period * c.sections, head = c.settle * c.sections, total = head + c.repeats * L;
  for (int e = 0; e < c.experiments; ++e) {
    Random random(c.stimuli.value_or(seed), static_cast<std::uint64_t>(e) * 2 + 1),
        noise(seed, static_cast<std::uint64_t>(e) * 2 + 2);
    const std::vector<double> wave = stimulus(c, random, e == 0);
    std::vector<double> t, u;
    const int lead = c.sections;  // what acted before the record began
    for (int i = -lead; i < total; ++i) {
      const int n = ((i - head) % L + L) % L;
      t.push_back(static_cast<double>(i) / c.sections * m.cycle_period);
      for (std::size_t j = 0; j < nu; ++j) u.push_back(j == 0 ? wave[static_cast<std::size_t>(n)] : 0.0);
    }
    std::vector<double> acts = u;  // what the record does not hold is in it
    if (c.process > 0.0) {
      for (std::size_t k = 0; k < acts.size(); k += nu) acts[k] += c.process * noise.normal();
    }
    const Course course{t, acts, static_cast<std::size_t>(lead), m.cycle_period / c.sections / 8.0};
    const Response y = m.values_only(values, course, orbit.front());
    if (!usable(y.status)) {
      r.t.clear();
      return r;
    }
    std::vector<double> drift(ny, 0.0);
    for (int i = 0; i < total; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const bool dropped = noise.uniform() < c.drop;
      if (!dropped) {
        r.experiment.push_back(e);
        r.t.push_back(t[k + static_cast<std::size_t>(lead)]);
        r.cycle.push_back(i / c.sections);
        r.section.push_back(i % c.sections);
        for (std::size_t j = 0; j < nu; ++j)
          r.inputs[j].values.push_back(u[(k + static_cast<std::size_t>(lead)) * nu + j]);
      }
      for (std::size_t j = 0; j < ny; ++j) {
        const double sigma = j < c.noise.size() ? c.noise[j] : 0.0;
        drift[j] = c.colour * drift[j] + std::sqrt(1.0 - c.colour * c.colour) * sigma * noise.normal();
        double v = y.y[k * ny + j] + drift[j];
        if (noise.uniform() < c.outliers) v += (noise.uniform() < 0.5 ? -30.0 : 30.0) * sigma;
        if (j < c.quantum.size() && c.quantum[j] > 0.0) v = std::round(v / c.quantum[j]) * c.quantum[j];
        if (!dropped) r.outputs[j].values.push_back(v);
      }
    }
  }
  return r;
}

}  // namespace saltus::diagnosis
