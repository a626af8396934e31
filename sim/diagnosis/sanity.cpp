// What is plainly not a record of the declared machine is refused with the mend, before any fit makes sense of it.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "../format.hpp"
#include "diagnosis.hpp"
#include "past_events.hpp"

namespace saltus::diagnosis {
namespace {

struct Moments {
  double mean = 0.0, deviation = 0.0;
};
Moments moments(const std::vector<double>& x) {
  Moments m;
  for (const double v : x) m.mean += v;
  m.mean /= static_cast<double>(std::max<std::size_t>(1, x.size()));
  for (const double v : x) m.deviation += (v - m.mean) * (v - m.mean);
  m.deviation = std::sqrt(m.deviation / static_cast<double>(std::max<std::size_t>(1, x.size())));
  return m;
}
double correlation(const std::vector<double>& a, const std::vector<double>& b, std::size_t shift = 0) {
  const Moments ma = moments(a), mb = moments(b);
  if (!(ma.deviation > 0.0) || !(mb.deviation > 0.0)) return 0.0;
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - ma.mean) * (b[(i + shift) % b.size()] - mb.mean);
  return sum / (static_cast<double>(a.size()) * ma.deviation * mb.deviation);
}
// How much of the response to its input a record holds: measured over modelled, by least squares over all segments, the
// mean cycle taken out of both, so that what the input does not drive says nothing. `scale` of the input is played.
struct Gain {
  double value = 0.0, error = 0.0;
  bool known = false;
};
Gain input_gain(const Problem& p, const Data& data, const std::vector<double>& values, double scale) {
  const Machine& m = *p.machine;
  const std::size_t ny = m.outputs.size(), rows = static_cast<std::size_t>(data.sections) * ny;
  const auto orbit = m.cycle(values, 60, data.sections);
  if (orbit.empty()) return {};
  double both = 0.0, square = 0.0;
  bool ran = false;
  for (const Segment& s : data.segments) {
    Segment driven = s, still = s;
    for (double& u : driven.u) u *= scale;
    std::fill(still.u.begin(), still.u.end(), 0.0);
    if (still.u == s.u) continue;
    const Response with = m.values_only(values, driven.course(p.h_max), orbit.front());
    const Response without = m.values_only(values, still.course(p.h_max), orbit.front());
    if (!usable(with.status) || !usable(without.status)) return {};
    ran = true;
    const auto n = static_cast<std::size_t>(s.y.size());
    std::vector<double> mean_y(rows, 0.0), mean_d(rows, 0.0), count(rows, 0.0);
    for (std::size_t i = n / 4; i < n; ++i) {  // later than what is left of the start, the model's cycle
      if (!(s.count[static_cast<Eigen::Index>(i)] > 0.0)) continue;
      mean_y[i % rows] += s.y[static_cast<Eigen::Index>(i)] - without.y[i];
      mean_d[i % rows] += with.y[i] - without.y[i];
      count[i % rows] += 1.0;
    }
    for (std::size_t i = n / 4; i < n; ++i) {
      const double c = s.count[static_cast<Eigen::Index>(i)];
      if (!(c > 0.0)) continue;
      const double w =
          c / (data.noise[static_cast<Eigen::Index>(i % ny)] * data.noise[static_cast<Eigen::Index>(i % ny)]);
      const double y = s.y[static_cast<Eigen::Index>(i)] - without.y[i] - mean_y[i % rows] / count[i % rows];
      const double d = with.y[i] - without.y[i] - mean_d[i % rows] / count[i % rows];
      both += w * y * d;
      square += w * d * d;
    }
  }
  Gain g;
  g.known = ran && square > 0.0;
  if (g.known) {
    g.value = both / square;
    g.error = 1.0 / std::sqrt(square);
  }
  return g;
}

// What speaks against a record being one of this machine, and how it could be mended.
struct Doubt {
  std::string what, mend;
};

// Does the machine answer its input as the model does, or another sign or unit of it?
std::optional<Doubt> foreign_input(const Problem& p, const Data& data, const std::vector<double>& values) {
  if (!data.noise_measured || p.machine->inputs.size() != 1) return std::nullopt;
  const std::string name = p.machine->inputs.front().name, unit = p.machine->inputs.front().unit;
  for (const double scale : {1.0, 1e-3}) {
    const Gain g = input_gain(p, data, values, scale);
    if (!g.known || (scale == 1.0 && std::abs(g.value) < 0.1))
      continue;  // too much for the model: perhaps a thousandth
    if (std::abs(g.value) < 10.0 * g.error) return std::nullopt;
    if (g.value < -0.3) {
      return Doubt{"the machine answers " + name + " the other way round (gain " + text(g.value, "%.3g") + ")",
                   "reverse the sign of the column"};
    }
    const double ratio = scale * g.value, power = std::pow(10.0, std::round(std::log10(std::abs(ratio))));
    if (power != 1.0 && std::abs(std::log10(ratio / power)) < 0.15) {
      return Doubt{
          "the machine answers " + name + " " + text(ratio, "%.3g") + " times as the declared model does",
          "it looks like another unit: multiply the column by " + text(power, "%.3g") + " to have it in " + unit};
    }
    return std::nullopt;
  }
  return std::nullopt;
}

using Cycle = std::vector<std::vector<double>>;  // (outputs)(sections)

Cycle measured_cycle(const Machine& m, const Data& data, const std::string& record) {
  const std::size_t ny = m.outputs.size();
  const auto N = static_cast<std::size_t>(data.sections);
  Cycle mean(ny, std::vector<double>(N, 0.0)), weight = mean;
  for (const Segment& s : data.segments) {
    for (Eigen::Index i = 0; i < s.y.size(); ++i) {
      const std::size_t j = static_cast<std::size_t>(i) % ny, n = static_cast<std::size_t>(i) / ny % N;
      if (!(s.count[i] > 0.0)) continue;
      mean[j][n] += s.y[i];
      weight[j][n] += 1.0;
    }
  }
  for (std::size_t j = 0; j < ny; ++j) {
    for (std::size_t n = 0; n < N; ++n) {
      if (weight[j][n] == 0.0) {
        throw RecordError(record, m.outputs[j].name + " was never measured at section " + std::to_string(n),
                          "record all sections of the cycle");
      }
      mean[j][n] /= weight[j][n];
    }
  }
  return mean;
}

// Of the model, driven as recorded; empty where it follows nowhere.
Cycle model_cycle(const Problem& p, const Data& data, const Fit& f) {
  const std::size_t ny = p.machine->outputs.size();
  const auto N = static_cast<std::size_t>(data.sections);
  Cycle mean(ny, std::vector<double>(N, 0.0)), runs = mean;
  for (std::size_t k = 0; k < data.segments.size(); ++k) {
    const Response r = p.machine->values_only(f.values, data.segments[k].course(p.h_max), f.start[k]);
    for (std::size_t i = 0; i < r.rows && usable(r.status); ++i) {
      mean[i % ny][i / ny % N] += r.y[i];
      runs[i % ny][i / ny % N] += 1.0;
    }
  }
  if (runs[0][0] == 0.0) return {};
  for (std::size_t j = 0; j < ny; ++j) {
    for (std::size_t n = 0; n < N; ++n) mean[j][n] /= std::max(1.0, runs[j][n]);
  }
  return mean;
}

std::optional<Doubt> swapped_columns(const Machine& m, const Cycle& measured, const Cycle& model) {
  for (std::size_t j = 0; j < model.size(); ++j) {
    for (std::size_t k = 0; k < model.size(); ++k) {
      if (k == j) continue;
      const double own = correlation(measured[j], model[j]), other = correlation(measured[j], model[k]);
      if (own < 0.7 && other > 0.95 && correlation(measured[k], model[j]) > 0.95) {
        return Doubt{
            "column " + m.outputs[j].name + " moves like the model's " + m.outputs[k].name + " and the other way round",
            "swap the two columns, or their names in the header"};
      }
    }
  }
  return std::nullopt;
}

std::optional<Doubt> foreign_unit(const Machine& m, const Cycle& measured, const Cycle& model) {
  for (std::size_t j = 0; j < model.size(); ++j) {
    const Moments a = moments(measured[j]), b = moments(model[j]);
    const double ratio = a.deviation / std::max(1e-300, b.deviation);
    if (!(ratio > 20.0 || ratio < 0.05)) continue;
    const double power = std::pow(10.0, std::round(std::log10(ratio)));
    return Doubt{m.outputs[j].name + " swings " + text(ratio, "%.3g") + " times as far as the declared model says",
                 std::abs(std::log10(ratio / power)) < 0.15
                     ? "it looks like another unit: multiply the column by " + text(1.0 / power, "%.3g") +
                           " to have it in " + m.outputs[j].unit
                     : "check its unit, and that this is the right model"};
  }
  return std::nullopt;
}

std::optional<Doubt> shifted_clock(const Cycle& measured, const Cycle& model) {
  const std::size_t ny = model.size(), N = model[0].size();
  double here = 0.0, best = 0.0;
  std::size_t at = 0;
  for (std::size_t shift = 0; shift < N; ++shift) {
    double sum = 0.0;
    for (std::size_t j = 0; j < ny; ++j) sum += correlation(measured[j], model[j], shift) / static_cast<double>(ny);
    if (shift == 0) here = sum;
    if (shift == 0 || sum > best) {
      best = sum;
      at = shift;
    }
  }
  // By one section a lag or a delay may be it as well, which the search tells better.
  const bool beside = at == 1 || at + 1 == N;
  if (at != 0 && !(beside && here > 0.9) && best > 0.98 && best - here > 0.01) {
    const long sections = at > N / 2 ? static_cast<long>(at) - static_cast<long>(N) : static_cast<long>(at);
    return Doubt{"its clock is shifted: the motion fits the model's when moved by " + std::to_string(sections) +
                     " of " + std::to_string(N) + " sections",
                 "record section 0 at phase 0 of the clock, or renumber the sections"};
  }
  if (here < 0.6) {
    return Doubt{"its motion has little in common with the declared model's (correlation " + text(here, "%.3g") + ")",
                 "check --model and the columns"};
  }
  return std::nullopt;
}

std::optional<Doubt> doubt_at(const Problem& p, const Data& data, const Cycle& measured, const Fit& f) {
  if (const auto d = foreign_input(p, data, f.values)) return d;
  const Cycle model = model_cycle(p, data, f);
  if (model.empty()) {
    return Doubt{"the declared model, driven as recorded, leaves its charts: the stimulus is too large for it",
                 "record with a smaller amplitude, or correct the model"};
  }
  if (const auto d = swapped_columns(*p.machine, measured, model)) return d;
  if (const auto d = foreign_unit(*p.machine, measured, model)) return d;
  return shifted_clock(measured, model);
}

}  // namespace

// An impact a little earlier or later may fall on the other side of a section, where the declared model then answers
// wrongly by far. So what speaks against a record must do so at refitted parameters, away from impacts, too.
void refuse_nonsense(const Problem& p, const Data& data, const std::string& record) {
  if (data.sections == 0) return;
  const Cycle measured = measured_cycle(*p.machine, data, record);
  const Fit declared = declared_fit(p);
  const auto doubt = doubt_at(p, data, measured, declared);
  if (!doubt) return;
  const Data away = without_jumps(data).value_or(data);
  Problem there = p;
  there.data = &away;
  std::vector<int> all(data.segments.size());
  std::iota(all.begin(), all.end(), 0);
  // Effects that parameters imitate carry them over their tolerances; from here it would be another machine.
  constexpr double foreign = 15.0;  // [-] tolerances
  const Fit refitted = fit(there, all, declared, {});
  if (std::isfinite(refitted.chi2) && !(farthest_off(p, refitted) > foreign) &&
      !doubt_at(there, away, measured, refitted))
    return;
  throw RecordError(record, doubt->what, doubt->mend);
}

}  // namespace saltus::diagnosis
