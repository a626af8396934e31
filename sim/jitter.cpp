#include "jitter.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/spectrum/twiddles.hpp"

namespace saltus {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// The scatter of one section of one output between repeats.
struct Scatter {
  double sum = 0.0, freedom = 0.0;  // of squares; degrees of freedom
  double variance() const { return sum / freedom; }
};

struct OutputScatter {
  std::vector<Scatter> section;
  std::vector<double> mean, count;  // of the cycle
};

// Adds the whole stimulus periods of one experiment after the cycles that are skipped.
void gather(const Grid& grid, int period, int skipped, std::vector<OutputScatter>& out) {
  const int repeats = (grid.cycles - skipped) / period;
  for (std::size_t o = 0; o < out.size(); ++o) {
    for (int c = 0; c < period; ++c) {
      for (int n = 0; n < grid.sections; ++n) {
        double mean = 0.0, sum = 0.0, count = 0.0;
        for (int r = 0; r < repeats; ++r) {
          const double y = grid.outputs[o][static_cast<std::size_t>((skipped + r * period + c) * grid.sections + n)];
          if (!std::isfinite(y)) continue;
          const double before = y - mean;
          mean += before / ++count;
          sum += before * (y - mean);
        }
        const auto at = static_cast<std::size_t>(n);
        if (count < 2.0) continue;
        out[o].section[at].sum += sum;
        out[o].section[at].freedom += count - 1.0;
        out[o].mean[at] += (mean - out[o].mean[at]) / ++out[o].count[at];
      }
    }
  }
}

// Rates of a cycle [a second] at its sections; not a number beside a kink.
std::vector<double> rates(const std::vector<double>& y, double cycle_period) {
  const int n = static_cast<int>(y.size());
  const auto at = [&](int i) { return y[static_cast<std::size_t>((i % n + n) % n)]; };
  std::vector<double> fourier(y.size()), all(y.size());
  for (int k = 1; 2 * k < n; ++k) {
    Complex sum{};
    for (int i = 0; i < n; ++i) sum += at(i) * root_of_unity(-std::int64_t{k} * i, n);
    for (int i = 0; i < n; ++i) {
      const Complex turn = sum * root_of_unity(std::int64_t{k} * i, n);
      fourier[static_cast<std::size_t>(i)] -= 2.0 / n * (2.0 * std::numbers::pi * k / cycle_period) * turn.imag();
    }
  }
  double square = 0.0;
  for (const double f : fourier) square += f * f / n;
  for (int i = 0; i < n; ++i) {
    const double difference = (8.0 * (at(i + 1) - at(i - 1)) - (at(i + 2) - at(i - 2))) * n / (12.0 * cycle_period);
    const double f = fourier[static_cast<std::size_t>(i)];
    all[static_cast<std::size_t>(i)] = std::abs(f - difference) < 0.05 * std::sqrt(square) ? f : std::nan("");
  }
  return all;
}

}  // namespace

TimingJitter estimate_jitter(const Record& record) {
  TimingJitter r;
  if (!record.clock_paced() || !record.cycle_period || !record.stimulus_period_cycles) return r;
  const auto sections = static_cast<std::size_t>(*record.sections_per_cycle);
  if (sections < 8) return r;
  std::vector<OutputScatter> outputs(record.outputs.size());
  for (OutputScatter& o : outputs) {
    o.section.resize(sections);
    o.mean.resize(sections);
    o.count.resize(sections);
  }
  for (const Experiment& e : experiments(record)) {
    const Grid grid = on_grid(record, e);
    gather(grid, *record.stimulus_period_cycles, settling_cycles(record, grid), outputs);
  }
  // Rows: sections of the outputs, each output in units of its own scatter; unknowns: the sensors' variances, and the
  // variance of the instants in units of 1 / (largest rate)^2.
  struct Row {
    std::size_t output;
    double variance, rate_square, freedom;
  };
  std::vector<Row> rows;
  double largest = 0.0;
  for (std::size_t o = 0; o < outputs.size(); ++o) {
    double mean = 0.0;
    for (const Scatter& s : outputs[o].section) {
      if (!(s.freedom > 0.0)) return r;
      mean += s.variance() / static_cast<double>(sections);
    }
    if (!(mean > 0.0)) continue;  // exact
    const std::vector<double> rate = rates(outputs[o].mean, *record.cycle_period);
    for (std::size_t n = 0; n < sections; ++n) {
      const Scatter& s = outputs[o].section[n];
      if (!std::isfinite(rate[n])) continue;
      rows.push_back({o, s.variance() / mean, rate[n] * rate[n] / mean, s.freedom});
      largest = std::max(largest, rows.back().rate_square);
    }
  }
  const auto unknowns = static_cast<Eigen::Index>(outputs.size()) + 1;
  const auto freedom = static_cast<double>(rows.size()) - static_cast<double>(unknowns);
  if (!(largest > 0.0) || freedom < 8.0) return r;
  VectorXd x = VectorXd::Ones(unknowns);
  x[unknowns - 1] = 0.0;
  MatrixXd normal;
  double chi = 0.0;
  for (int i = 0; i < 30; ++i) {
    normal = 1e-9 * MatrixXd::Identity(unknowns, unknowns);  // an output without scatter has no rows
    VectorXd rhs = VectorXd::Zero(unknowns);
    chi = 0.0;
    for (const Row& row : rows) {
      VectorXd a = VectorXd::Zero(unknowns);
      a[static_cast<Eigen::Index>(row.output)] = 1.0;
      a[unknowns - 1] = row.rate_square / largest;
      const double expected = std::max(a.dot(x), 0.02);
      const double weight = row.freedom / (2.0 * expected * expected);
      normal += weight * a * a.transpose();
      rhs += weight * row.variance * a;
      chi += weight * (row.variance - a.dot(x)) * (row.variance - a.dot(x));
    }
    const VectorXd next = normal.ldlt().solve(rhs);
    if (!next.allFinite()) return r;
    const bool settled = (next - x).norm() < 1e-10 * next.norm();
    x = next;
    if (settled) break;
  }
  const double square = x[unknowns - 1] / largest;
  const double spread =
      std::sqrt(normal.inverse()(unknowns - 1, unknowns - 1) * std::max(1.0, chi / freedom)) / largest;
  r.seconds = std::sqrt(std::max(0.0, square));
  r.sigma = r.seconds > 0.0 ? std::min(0.5 * spread / r.seconds, std::sqrt(spread)) : std::sqrt(spread);
  r.found = square > 3.0 * spread;
  return r;
}

void correct_jitter(Identification& id, double seconds, double cycle_period) {
  for (HtfEstimate& h : id.htf) {
    const double n = id.sections, f = std::abs(std::remainder(static_cast<double>(h.line) / id.period + h.m, n));
    const double angle = 2.0 * std::numbers::pi * f * seconds / cycle_period;
    const double shrunk = std::exp(-0.5 * angle * angle);
    h.value /= shrunk;
    h.sigma /= shrunk;
  }
}

}  // namespace saltus
