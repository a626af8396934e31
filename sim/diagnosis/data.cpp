#include "data.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "../format.hpp"
#include "../median.hpp"
#include "core/spectrum/twiddles.hpp"

namespace saltus::diagnosis {
namespace {

constexpr double outlier_sigmas = 6.0;

std::string listed(const std::vector<Channel>& channels) {
  std::string s;
  for (const Channel& c : channels) s += (s.empty() ? "" : ", ") + c.name;
  return s.empty() ? "none" : s;
}

// The record's channels in the machine's order, or a refusal.
std::vector<std::size_t> match(const Record& record, const std::vector<saltus::Channel>& have,
                               const std::vector<Channel>& want, const char* kind) {
  std::vector<std::size_t> order;
  for (const Channel& w : want) {
    const auto it = std::find_if(have.begin(), have.end(), [&](const auto& c) { return c.name == w.name; });
    if (it == have.end()) {
      std::vector<Channel> names;
      for (const auto& c : have) names.push_back({c.name, c.unit});
      throw RecordError(record.name,
                        "it has no " + std::string(kind) + " '" + w.name + "' (it has " + listed(names) + ")",
                        "record it, or choose the model the record was made with");
    }
    if (!it->unit.empty() && !w.unit.empty() && it->unit != w.unit) {
      throw RecordError(record.name,
                        std::string(kind) + " " + w.name + " is in " + it->unit + ", the model's in " + w.unit,
                        "convert the column and its header to SI units");
    }
    order.push_back(static_cast<std::size_t>(it - have.begin()));
  }
  return order;
}

// Mean over the repeats of a stimulus, without what no noise makes.
void average(Data& data, Segment& s, const std::vector<std::vector<double>>& repeat, const Eigen::VectorXd& scale) {
  const auto rows = static_cast<Eigen::Index>(repeat.front().size());
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  s.y = s.count = Eigen::VectorXd::Zero(rows);
  s.within = Eigen::VectorXd::Zero(ny);
  s.deviation.assign(repeat.size(), Eigen::VectorXd::Zero(rows));
  std::vector<double> here;
  for (Eigen::Index i = 0; i < rows; ++i) {
    const double sigma = scale[i % ny];
    here.clear();
    for (const auto& r : repeat) {
      if (std::isfinite(r[static_cast<std::size_t>(i)])) here.push_back(r[static_cast<std::size_t>(i)]);
    }
    const double middle = median(here);
    const double limit = outlier_sigmas * sigma * (here.size() == 2 ? 1.0 / std::sqrt(2.0) : 1.0);
    double sum = 0.0, n = 0.0;
    std::vector<bool> good(repeat.size(), false);
    for (std::size_t r = 0; r < repeat.size(); ++r) {
      const double v = repeat[r][static_cast<std::size_t>(i)];
      if (!std::isfinite(v)) {
        ++data.quality.missing;
      } else if (here.size() > 1 && std::abs(v - middle) > limit) {
        ++data.quality.outliers;
      } else {
        good[r] = true;
        sum += v;
        n += 1.0;
      }
    }
    if (n == 0.0) continue;
    s.y[i] = sum / n;
    s.count[i] = n;
    for (std::size_t r = 0; r < repeat.size(); ++r) {
      if (!good[r]) continue;
      const double d = repeat[r][static_cast<std::size_t>(i)] - s.y[i];
      s.deviation[r][i] = d;
      s.within[i % ny] += d * d;
    }
  }
}

// Standard deviation of each output from half the spread between repeats, by the median: outliers do not reach it.
Eigen::VectorXd robust_scale(const std::vector<std::vector<std::vector<double>>>& all, Eigen::Index ny) {
  Eigen::VectorXd scale(ny);
  for (Eigen::Index j = 0; j < ny; ++j) {
    std::vector<double> d;
    for (const auto& repeat : all) {
      for (std::size_t r = 1; r < repeat.size(); ++r) {
        for (std::size_t i = static_cast<std::size_t>(j); i < repeat[r].size(); i += static_cast<std::size_t>(ny)) {
          const double x = std::abs(repeat[r][i] - repeat[r - 1][i]);
          if (std::isfinite(x)) d.push_back(x);
        }
      }
    }
    scale[j] = d.empty() ? 0.0 : median(d) / (0.6744897501960817 * std::sqrt(2.0));
  }
  return scale;
}

// Correlation of the deviations along time: white noise has none.
void test_colour(Data& data) {
  constexpr int lags = 32;
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  std::vector<double> product(lags + 1, 0.0);
  double n = 0.0;
  for (const Segment& s : data.segments) {
    for (const auto& d : s.deviation) {
      for (int k = 0; k <= lags; ++k) {
        const Eigen::Index m = d.size() - k * ny;
        for (Eigen::Index j = 0; j < ny && m > 0; ++j) {
          double sum = 0.0;
          for (Eigen::Index i = j; i < m; i += ny) sum += d[i] * d[i + k * ny];
          product[static_cast<std::size_t>(k)] += sum / (data.noise[j] * data.noise[j]);
        }
      }
      n += static_cast<double>(d.size());
    }
  }
  if (!(product[0] > 0.0)) return;
  double widened = 1.0;
  for (int k = 1; k <= lags; ++k) {
    const double rho = product[static_cast<std::size_t>(k)] / product[0];
    const double excess = rho * rho - 1.0 / n;
    if (std::abs(rho) > 5.0 / std::sqrt(n)) data.coloured = true;
    if (excess > 0.0) widened += 2.0 * excess;
  }
  if (data.coloured) {
    data.colour = widened;
    data.notes.push_back("The noise is correlated in time; claims are widened by what the repeats show of it.");
    if (const double rho = product[1] / product[0]; rho > 0.75) {
      data.wandering = true;
      data.notes.push_back("Repeats of one stimulus differ by " + text(1.0 / std::sqrt(1.0 - rho), "%.2g") +
                           " times what neighbouring samples of the difference scatter by: a sensor's noise is that "
                           "slow, a disturbance that the record does not hold moves the machine, or its gait does not "
                           "repeat.");
    }
  }
}

void refine_noise(Data& data) {
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  for (Eigen::Index j = 0; j < ny; ++j) {
    double squares = 0.0, freedom = 0.0;
    for (const Segment& s : data.segments) {
      squares += s.within[j];
      for (Eigen::Index i = j; i < s.count.size(); i += ny) freedom += std::max(0.0, s.count[i] - 1.0);
    }
    if (freedom > 0.0) data.noise[j] = std::sqrt(squares / freedom);
  }
}

// Variance of a measurement's rounding to steps q that is the same in each of many where what is rounded spreads by the
// standard deviation sigma: that of the sawtooth of rounding, smoothed. q^2/12 where nothing spreads.
double common_rounding(double q, double sigma) {
  constexpr double pi = 3.14159265358979323846;
  double sum = 0.0;
  for (int k = 1; k <= 32; ++k) sum += std::exp(-std::pow(2.0 * pi * k * sigma / q, 2)) / (k * k);
  // What 32 terms leave of the series matters only where there is next to no spread.
  return std::min(sum * q * q / (2.0 * pi * pi), q * q / 12.0);
}

// The standard deviation before rounding, from the variance after it: sigma^2 + q^2/12 less what all of them have in
// common.
double noise_before_rounding(double q, double shown) {
  double low = 0.0, high = std::sqrt(shown) + q;
  for (int i = 0; i < 60; ++i) {
    const double sigma = 0.5 * (low + high);
    (sigma * sigma + q * q / 12.0 - common_rounding(q, sigma) < shown ? low : high) = sigma;
  }
  return low;
}

// Variance of what an output does from cycle to cycle at the same section, over a segment.
double cycle_variance(const Segment& s, Eigen::Index output, Eigen::Index outputs, int sections) {
  const auto width = static_cast<std::size_t>(sections);
  std::vector<double> n(width), sum(width);
  double squares = 0.0, freedom = 0.0;
  const auto each = [&](auto&& f) {
    for (Eigen::Index i = output; i < s.y.size(); i += outputs) {
      if (s.count[i] > 0.0) f(static_cast<std::size_t>(i / outputs) % width, s.y[i]);
    }
  };
  each([&](std::size_t at, double y) {
    n[at] += 1.0;
    sum[at] += y;
  });
  each([&](std::size_t at, double y) {
    squares += std::pow(y - sum[at] / n[at], 2);
    freedom += 1.0 - 1.0 / n[at];
  });
  return freedom > 0.0 ? squares / freedom : 0.0;
}

// Coarse steps are errors that repeats have in common, and cycles too where they are alike: counted as so many fewer
// measurements, each with all of its error.
void admit_steps(Data& data) {
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  for (Eigen::Index j = 0; j < ny; ++j) {
    const double q = data.quality.resolution[static_cast<std::size_t>(j)];
    if (!(q > 0.0)) continue;
    const double shown = data.noise[j] * data.noise[j], sigma = noise_before_rounding(q, shown);
    const double hidden = common_rounding(q, sigma), whole = shown + hidden;
    if (!(hidden > 1e-3 * whole)) continue;
    data.noise[j] = std::sqrt(whole);
    for (Segment& s : data.segments) {
      const double spread = noise_before_rounding(q, cycle_variance(s, j, ny, data.sections));
      const double alike = data.period_cycles * common_rounding(q, spread);  // what cycles have in common adds up
      s.within[j] = 0.0;
      for (Eigen::Index i = j; i < s.count.size(); i += ny) {
        const double n = s.count[i];
        if (!(n > 0.0)) continue;
        s.count[i] = whole / (shown / n + hidden + alike);
        // What repeats deviate by, in proportion to what they still say of the noise.
        const double told = n > 1.0 && shown > 0.0 ? std::max(0.0, s.count[i] - 1.0) / (n - 1.0) * whole / shown : 0.0;
        for (Eigen::VectorXd& d : s.deviation) {
          s.within[j] += d[i] * d[i] * s.count[i] / n;
          d[i] *= std::sqrt(told);
        }
      }
    }
  }
}

// The lines a periodic input has power on; empty where there are none, or too many for it to be a sum of cosines.
std::vector<int> excited_lines(const Segment& s, std::size_t inputs, int period) {
  const std::size_t L = s.samples();
  const std::size_t last = std::min(L / 2, static_cast<std::size_t>(10 * period));
  std::vector<Complex> turn(L);
  for (std::size_t n = 0; n < L; ++n)
    turn[n] = root_of_unity(static_cast<std::int64_t>(n), static_cast<std::int64_t>(L));
  std::vector<double> power(last + 1, 0.0);
  double largest = 0.0;
  for (std::size_t c = 0; c < inputs; ++c) {
    for (std::size_t k = 1; k <= last; ++k) {
      Complex sum{};
      for (std::size_t n = 0; n < L; ++n) sum += s.u[(s.first + n) * inputs + c] * turn[k * n % L];
      power[k] += std::norm(sum);
      largest = std::max(largest, power[k]);
    }
  }
  std::vector<int> lines;
  for (std::size_t k = 1; k <= last && largest > 0.0; ++k) {
    if (power[k] > 1e-2 * largest) lines.push_back(static_cast<int>(k));
  }
  return lines.size() > 64 ? std::vector<int>{} : lines;
}

}  // namespace

std::vector<std::size_t> columns_of(const Record& record, const Machine& machine, bool outputs) {
  return outputs ? match(record, record.outputs, machine.outputs, "output")
                 : match(record, record.inputs, machine.inputs, "input");
}

double resolution_of(std::vector<double> v) {
  v.erase(std::remove_if(v.begin(), v.end(), [](double x) { return !std::isfinite(x); }), v.end());
  if (v.size() < 64) return 0.0;
  std::sort(v.begin(), v.end());
  const double same = 1e-6 * (v.back() - v.front());  // as written with a few digits
  v.erase(std::unique(v.begin(), v.end(), [&](double a, double b) { return b - a <= same; }), v.end());
  if (v.size() < 3) return 0.0;
  std::vector<double> steps;
  for (std::size_t i = 1; i < v.size(); ++i) steps.push_back(v[i] - v[i - 1]);
  const auto few =
      steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 10);  // values that are rare lie steps apart
  std::nth_element(steps.begin(), few, steps.end());
  const double step = *few;
  std::size_t whole = 0;
  for (const double s : steps) {
    const double n = s / step;
    whole += std::abs(n - std::round(n)) < 0.05 && n > 0.5;
  }
  return whole > steps.size() * 9 / 10 ? step : 0.0;
}

void noise_from_residuals(Data& data, const std::vector<Eigen::VectorXd>& residual) {
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  for (Eigen::Index j = 0; j < ny; ++j) {
    std::vector<double> d;
    for (std::size_t s = 0; s < data.segments.size(); ++s) {
      const auto& r = residual[s];
      const auto& c = data.segments[s].count;
      const auto& t = data.segments[s].t;
      for (Eigen::Index i = j + ny; i + ny < r.size(); i += ny) {
        if (!(c[i] > 0.0 && c[i - ny] > 0.0 && c[i + ny] > 0.0)) continue;
        // Off the straight line between its neighbours, wherever between them it was measured.
        const std::size_t k = data.segments[s].first + static_cast<std::size_t>(i / ny);
        const double a = (t[k + 1] - t[k]) / (t[k + 1] - t[k - 1]), b = 1.0 - a;
        d.push_back(std::abs(r[i] - a * r[i - ny] - b * r[i + ny]) / std::sqrt(1.0 + a * a + b * b));
      }
    }
    double sigma = d.empty() ? data.noise[j] : median(d) / 0.6744897501960817;
    const double step = data.quality.resolution[static_cast<std::size_t>(j)];
    sigma = std::max(sigma, step / std::sqrt(12.0));
    if (sigma > 0.0) data.noise[j] = sigma;
  }
}

Segment part_of(const Segment& s, std::size_t from, std::size_t to, std::size_t history) {
  Segment r;
  r.experiment = s.experiment;
  r.guess.chart = s.guess.chart;
  r.first = std::min(s.first + from, history);
  const auto begin = static_cast<std::ptrdiff_t>(s.first + from - r.first);
  const auto end = static_cast<std::ptrdiff_t>(s.first + to);
  const auto inputs = static_cast<std::ptrdiff_t>(s.u.size() / s.t.size());
  r.t.assign(s.t.begin() + begin, s.t.begin() + end);
  r.u.assign(s.u.begin() + begin * inputs, s.u.begin() + end * inputs);
  const auto ny = s.y.size() / static_cast<Eigen::Index>(s.samples());
  const auto rows = Eigen::seqN(static_cast<Eigen::Index>(from) * ny, static_cast<Eigen::Index>(to - from) * ny);
  r.y = s.y(rows);
  r.count = s.count(rows);
  r.within = s.within;
  return r;
}

Data prepare(const Record& record, const Machine& machine, Repeats taken) {
  Data data;
  const std::size_t ny = machine.outputs.size(), nu = machine.inputs.size();
  const auto out = match(record, record.outputs, machine.outputs, "output");
  const auto in = match(record, record.inputs, machine.inputs, "input");
  data.noise = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(ny));
  data.quality.rows = record.rows();
  data.quality.resolution.assign(ny, 0.0);
  for (std::size_t j = 0; j < ny; ++j) data.quality.resolution[j] = resolution_of(record.outputs[out[j]].values);
  const auto list = experiments(record);
  if (list.empty()) throw RecordError(record.name, "it has no data rows", "record some");

  if (machine.has_clock && !record.clock_paced()) {
    throw RecordError(
        record.name, "the model is paced by a clock, but the record does not say how",
        "add `# sections: clock`, `# sections-per-cycle: N`, `# cycle-period-s: T` and the columns cycle, section");
  }
  if (machine.has_clock && record.cycle_period && std::abs(*record.cycle_period / machine.cycle_period - 1.0) > 1e-6) {
    throw RecordError(record.name,
                      "its clock turns in " + std::to_string(*record.cycle_period) + " s, the model's in " +
                          std::to_string(machine.cycle_period) + " s",
                      "set the model's clock rate, for example --set omega=" +
                          std::to_string(6.283185307179586 / *record.cycle_period));
  }
  if (machine.has_clock) {
    const int sections = *record.sections_per_cycle;
    data.sections = sections;
    const double cycle_period = machine.cycle_period;
    const int settle = record.settle_cycles.value_or(0);
    const auto n_section = static_cast<std::size_t>(sections);
    std::vector<std::vector<std::vector<double>>> all;
    for (const Experiment& e : list) {
      const Grid grid = on_grid(record, e);
      data.quality.filled_inputs += grid.filled_inputs;
      const int skip = std::max(0, settle - grid.first_cycle);
      int usable = grid.cycles - skip;
      // The time column must be the clock's.
      for (std::size_t row = e.first_row; row < e.first_row + e.rows; row += 97) {
        const double expected =
            (record.cycle[row] + static_cast<double>(record.section[row]) / sections) * cycle_period;
        if (std::abs(record.t[row] - expected) > 0.02 * cycle_period / sections) {
          throw RecordError(record.name,
                            "experiment " + std::to_string(e.id) + ": t = " + std::to_string(record.t[row]) +
                                " where cycle and section say " + std::to_string(expected),
                            "t must be 0 at phase 0 of the clock; shift the column, or correct cycle-period-s");
        }
      }
      int period = record.stimulus_period_cycles.value_or(0);
      int repeats = period > 0 ? usable / period : 0;
      if (repeats < 2) {
        repeats = 1;
        period = usable;
      }
      if (usable < 2) {
        throw RecordError(record.name,
                          "experiment " + std::to_string(e.id) + " has " + std::to_string(std::max(0, usable)) +
                              " whole cycles after settling",
                          "record more cycles, or lower settle-cycles");
      }
      Segment s;
      s.experiment = e.id;
      const auto skipped = static_cast<std::size_t>(skip) * n_section;
      const auto length = static_cast<std::size_t>(period) * n_section;
      // History: what was applied before; where the stimulus repeats it ran before the settling, too.
      const std::size_t lead =
          repeats > 1 ? n_section * static_cast<std::size_t>(std::min(24, std::max(1, skip + grid.first_cycle)))
                      : skipped;
      for (std::size_t i = 0; i < lead + length; ++i) {
        const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(skipped + i) - static_cast<std::ptrdiff_t>(lead);
        s.t.push_back((grid.first_cycle + static_cast<double>(at) / sections) * cycle_period);
        for (std::size_t j = 0; j < nu; ++j) {
          const auto wrapped = at < 0 ? static_cast<std::size_t>(at + static_cast<std::ptrdiff_t>(length))
                                      : static_cast<std::size_t>(at);
          double v = grid.inputs[in[j]][wrapped];
          if (!std::isfinite(v)) {
            if (grid.missing_inputs > 0 && repeats < 2 && !s.u.empty()) v = s.u[s.u.size() - nu];
            if (!std::isfinite(v)) {
              throw RecordError(record.name,
                                "experiment " + std::to_string(e.id) + ": the input " + machine.inputs[j].name +
                                    " is not known at some samples",
                                "give the input in every row");
            }
          }
          s.u.push_back(v);
        }
      }
      s.first = lead;
      if (taken == Repeats::first_alone) repeats = 1;
      std::vector<std::vector<double>> repeat(static_cast<std::size_t>(repeats), std::vector<double>(length * ny));
      for (std::size_t r = 0; r < repeat.size(); ++r) {
        for (std::size_t i = 0; i < length; ++i) {
          for (std::size_t j = 0; j < ny; ++j) repeat[r][i * ny + j] = grid.outputs[out[j]][skipped + r * length + i];
        }
      }
      all.push_back(std::move(repeat));
      data.repeats = std::max(data.repeats, repeats);
      data.period_cycles = period;
      if (repeats > 1) s.lines = excited_lines(s, nu, period);
      data.segments.push_back(std::move(s));
    }
    Eigen::VectorXd scale = robust_scale(all, static_cast<Eigen::Index>(ny));
    for (std::size_t j = 0; j < ny; ++j) {  // coarse steps can make repeats agree exactly
      scale[static_cast<Eigen::Index>(j)] =
          std::max(scale[static_cast<Eigen::Index>(j)], data.quality.resolution[j] / std::sqrt(12.0));
    }
    data.noise_measured = data.repeats > 1 && scale.minCoeff() > 0.0;
    if (!data.noise_measured) scale.setConstant(std::numeric_limits<double>::infinity());
    for (std::size_t k = 0; k < all.size(); ++k) average(data, data.segments[k], all[k], scale);
    if (data.noise_measured) {
      data.noise = scale;
      refine_noise(data);
      test_colour(data);
      admit_steps(data);
    } else {
      data.noise.setOnes();
      data.notes.push_back(taken == Repeats::first_alone
                               ? "Repeats of one stimulus differ by what moves the machine: the first of each is taken "
                                 "by itself, its noise from the residual, so claims are weaker."
                               : "No stimulus repeats: the noise is taken from the residual itself, so claims are "
                                 "weaker.");
    }
  } else {
    throw RecordError(record.name, "the model " + machine.name + " has no clock to lay it out by",
                      "cut it into stretches");
  }
  if (list.size() == 1) data.notes.push_back("One experiment only: what is held out is the end of it.");
  return data;
}

}  // namespace saltus::diagnosis
