#include "passages.hpp"

#include <Eigen/LU>

#include <cmath>

namespace saltus::rhythm {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using Index = Eigen::Index;

constexpr double gap = 2.5;       // [-] of the usual spacing: beyond it samples are missing
constexpr Index half_window = 6;  // [sample] of the parabola about a passage, on either side

void find_visits(Passages& w, double exclude) {
  const Record& record = *w.record;
  std::vector<double> steps;
  for (std::size_t i = 1; i < record.rows(); ++i) {
    if (record.experiment[i] == record.experiment[i - 1]) steps.push_back(record.t[i] - record.t[i - 1]);
  }
  w.spacing = median(steps);
  if (record.cycle.empty() && record.chart_names.size() < 2) {
    throw RecordError(record.name, "nothing in it marks the events of its rhythm",
                      "give it a column cycle, which counts steps, or a column chart, which changes with them");
  }
  std::vector<int> key(record.rows(), 0);  // changes at an event
  const auto charts = static_cast<int>(record.chart_names.size()) + 1;
  for (std::size_t i = 0; i < record.rows(); ++i) {
    key[i] = (record.cycle.empty() ? 0 : record.cycle[i]) * charts + (record.chart.empty() ? 0 : record.chart[i]);
  }
  const auto drop = static_cast<std::size_t>(std::lround(exclude / w.spacing));
  for (const Experiment& e : experiments(record)) {
    int last = -1;
    const std::size_t end = e.first_row + e.rows;
    for (std::size_t from = e.first_row; from < end;) {
      std::size_t to = from + 1;
      bool joined = false;
      while (to < end && key[to] == key[from]) {
        if (record.t[to] - record.t[to - 1] > gap * w.spacing) break;
        ++to;
      }
      if (to < end) joined = record.t[to] - record.t[to - 1] <= gap * w.spacing;
      Visit v;
      v.chart = record.chart.empty() ? 0 : record.chart[from];
      v.first = from + drop;
      v.rows = to - from > 2 * drop ? to - from - 2 * drop : 0;
      v.begin = record.t[from];
      v.end = to < end ? record.t[to] : record.t[to - 1];
      v.previous = last;
      const int index = static_cast<int>(w.visits.size());
      if (last >= 0) w.visits[static_cast<std::size_t>(last)].next = index;
      last = joined ? index : -1;
      w.visits.push_back(std::move(v));
      from = to;
    }
  }
  // A cycle is the charts until the first comes again.
  for (const Visit& v : w.visits) {
    if (std::find(w.order.begin(), w.order.end(), v.chart) != w.order.end()) break;
    w.order.push_back(v.chart);
  }
  const auto follows = [&](int a, int b) {
    const auto i = std::find(w.order.begin(), w.order.end(), a);
    const auto j = std::find(w.order.begin(), w.order.end(), b);
    if (i == w.order.end() || j == w.order.end()) return false;
    return (i - w.order.begin() + 1) % static_cast<std::ptrdiff_t>(w.order.size()) == j - w.order.begin();
  };
  for (Visit& v : w.visits) {
    if (v.next < 0) continue;
    Visit& n = w.visits[static_cast<std::size_t>(v.next)];
    if (follows(v.chart, n.chart)) continue;
    n.previous = -1;
    v.next = -1;
  }
}

// Which outputs are rates of others: by their units and by what they say.
void find_rates(Passages& w) {
  const auto& outputs = w.record->outputs;
  w.rate_of.assign(outputs.size(), -1);
  w.rate_measured.assign(outputs.size(), false);
  for (std::size_t a = 0; a < outputs.size(); ++a) {
    for (std::size_t b = 0; b < outputs.size(); ++b) {
      if (a == b || outputs[b].unit != outputs[a].unit + "/s" || w.rate_of[b] >= 0) continue;
      double product = 0.0, square = 0.0, own = 0.0;
      for (const Visit& v : w.visits) {
        for (std::size_t i = v.first + 2; i + 2 < v.first + v.rows; ++i) {
          const double slope = (w.y[a][i + 2] - w.y[a][i - 2]) / (w.record->t[i + 2] - w.record->t[i - 2]);
          const double rate = w.y[b][i];
          if (!std::isfinite(slope) || !std::isfinite(rate)) continue;
          product += slope * rate;
          square += rate * rate;
          own += slope * slope;
        }
      }
      if (product > 0.9 * std::sqrt(square * own) && std::abs(product / square - 1.0) < 0.15) {
        w.rate_of[b] = static_cast<int>(a);
        w.rate_measured[a] = true;
        break;
      }
    }
  }
}

// The output that runs through every chart in one direction, most nearly; and the levels it passes.
void choose_levels(Passages& w) {
  double best = 0.0;
  for (std::size_t o = 0; o < w.y.size(); ++o) {
    double worst = 1.0;
    for (const int chart : w.order) {
      std::vector<double> straight;
      for (const Visit& v : w.visits) {
        if (v.chart != chart || v.rows < 3 * at(half_window)) continue;
        double way = 0.0;
        const std::size_t stride = 4;
        for (std::size_t i = v.first + stride; i < v.first + v.rows; i += stride) {
          const double d = w.y[o][i] - w.y[o][i - stride];
          if (std::isfinite(d)) way += std::abs(d);
        }
        const double across = w.y[o][v.first + v.rows - 1] - w.y[o][v.first];
        if (way > 0.0 && std::isfinite(across)) straight.push_back(std::abs(across) / way);
      }
      worst = straight.size() < 3 ? 0.0 : std::min(worst, quantile(straight, 0.25));
    }
    if (worst > best + (w.rate_of[o] >= 0 ? 0.02 : 0.0)) {
      best = worst;
      w.phase = o;
    }
  }
  if (best < 0.9) {
    throw RecordError(w.record->name,
                      "no output runs through every chart in one direction, so that none can tell the phase",
                      "record one that does, such as the angle of the leg that stands");
  }
  const auto& y = w.y[w.phase];
  for (const int chart : w.order) {
    std::vector<double> from, to;
    for (const Visit& v : w.visits) {
      if (v.chart != chart || v.rows < 3 * at(half_window)) continue;
      const double a = y[v.first + at(half_window)], b = y[v.first + v.rows - 1 - at(half_window)];
      if (std::isfinite(a) && std::isfinite(b)) {
        from.push_back(a);
        to.push_back(b);
      }
    }
    const bool up = median(to) > median(from);
    const double a = quantile(from, up ? 0.9 : 0.1), b = quantile(to, up ? 0.1 : 0.9);
    if (from.size() < 3 || (b > a) != up) {
      throw RecordError(w.record->name, "its steps are too short or too unlike for sections that all of them pass",
                        "sample faster, or leave out of the record the steps that are not like the others");
    }
    for (int j = 0; j < w.per_chart; ++j)
      w.level.push_back(a + (b - a) * (w.per_chart == 1 ? 0.5 : static_cast<double>(j) / (w.per_chart - 1)));
  }
}

// A parabola through the samples about one: its coefficients about their middle time, and what it leaves.
struct Parabola {
  Eigen::Vector3d c = Eigen::Vector3d::Zero();
  Eigen::Matrix3d inverse = Eigen::Matrix3d::Zero();  // of the normal equations
  double squares = 0.0;
  Index n = 0;
};
Parabola parabola(const std::vector<double>& t, const std::vector<double>& y, std::size_t from, std::size_t to,
                  double middle, double scale) {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  Parabola p;
  for (std::size_t i = from; i < to; ++i) {
    if (!std::isfinite(y[i])) continue;
    const double s = (t[i] - middle) / scale;
    const Eigen::Vector3d row(1.0, s, s * s);
    A += row * row.transpose();
    b += row * y[i];
    ++p.n;
  }
  if (p.n < half_window) return p;
  p.inverse = A.inverse();
  p.c = p.inverse * b;
  for (std::size_t i = from; i < to; ++i) {
    if (!std::isfinite(y[i])) continue;
    const double s = (t[i] - middle) / scale;
    const double e = y[i] - p.c.dot(Eigen::Vector3d(1.0, s, s * s));
    p.squares += e * e;
  }
  return p;
}

// Locates the passages of one stay; adds what locating leaves to `noise` (sections x coordinates, sums) and `count`.
void pass(const Passages& w, Visit& v, MatrixXd& noise, VectorXd& count) {
  const Record& record = *w.record;
  const int first_section = w.place(v);
  v.x.assign(static_cast<std::size_t>(w.per_chart), {});
  v.when.assign(v.x.size(), std::nan(""));
  v.input.assign(v.x.size(), std::nan(""));
  const auto& phase = w.y[w.phase];
  const double scale = w.spacing * static_cast<double>(half_window);
  for (int j = 0; j < w.per_chart; ++j) {
    const double level = w.level[static_cast<std::size_t>(first_section + j)];
    // Noise may cross a level more than once: the middle one.
    std::vector<double> crossings;
    for (std::size_t i = v.first + 1; i < v.first + v.rows; ++i) {
      if ((phase[i] - level) * (phase[i - 1] - level) <= 0.0) crossings.push_back(static_cast<double>(i));
    }
    if (crossings.empty()) continue;
    auto centre = static_cast<std::size_t>(median(crossings));
    double when = record.t[centre];
    Parabola p;
    std::size_t from = 0, to = 0;
    bool there = false;
    for (int round = 0; round < 4; ++round) {
      if (centre < v.first + 2 || centre + 2 >= v.first + v.rows) break;
      from = std::max(v.first, centre - std::min(centre, at(half_window)));
      to = std::min(v.first + v.rows, centre + at(half_window) + 1);
      p = parabola(record.t, phase, from, to, record.t[centre], scale);
      if (p.n < half_window) break;
      double s = 0.0;
      for (int k = 0; k < 20; ++k) {
        const double slope = p.c[1] + 2.0 * p.c[2] * s;
        s -= (p.c[0] + s * (p.c[1] + s * p.c[2]) - level) / (std::abs(slope) > 1e-300 ? slope : 1e-300);
        s = std::clamp(s, -1.0, 1.0);
      }
      when = record.t[centre] + s * scale;
      there = std::abs(p.c[0] + s * (p.c[1] + s * p.c[2]) - level) < 1e-9 * (1.0 + std::abs(level));
      const auto nearer = static_cast<std::size_t>(
          std::lower_bound(record.t.begin() + static_cast<std::ptrdiff_t>(from),
                           record.t.begin() + static_cast<std::ptrdiff_t>(to), when - 0.5 * w.spacing) -
          record.t.begin());
      if (nearer == centre) break;
      centre = nearer;
    }
    if (!there) continue;
    VectorXd x(w.dim);
    VectorXd error(w.dim);
    Index k = 0;
    bool whole = true;
    for (std::size_t o = 0; o < w.y.size() && whole; ++o) {
      const Parabola q = parabola(record.t, w.y[o], from, to, when, scale);
      whole = q.n >= half_window;
      const double variance = q.squares / std::max(1.0, static_cast<double>(q.n - 3));
      if (o != w.phase) {
        x[k] = q.c[0];
        error[k++] = variance * q.inverse(0, 0);
      }
      if (w.rate_of[o] < 0 && !w.rate_measured[o]) {
        x[k] = q.c[1] / scale;
        error[k++] = variance * q.inverse(1, 1) / (scale * scale);
      }
    }
    if (!whole) continue;
    v.x[static_cast<std::size_t>(j)] = x;
    v.when[static_cast<std::size_t>(j)] = when;
    noise.row(first_section + j) += error.transpose();
    count[first_section + j] += 1.0;
  }
}

// The mean of a held signal between two times.
double mean_between(const Record& r, const std::vector<double>& u, std::size_t first, double from, double to) {
  double sum = 0.0;
  auto i = first;
  while (i + 1 < r.rows() && r.t[i + 1] <= from) ++i;
  for (; i < r.rows() && r.t[i] < to; ++i) {
    const double end = i + 1 < r.rows() && r.experiment[i + 1] == r.experiment[i] ? std::min(to, r.t[i + 1]) : to;
    sum += u[i] * (end - std::max(from, r.t[i]));
  }
  return sum / (to - from);
}

}  // namespace

double quantile(std::vector<double> v, double q) {
  std::sort(v.begin(), v.end());
  return v[static_cast<std::size_t>(q * static_cast<double>(v.size() - 1))];
}

Place from_here(const Passages& w, const Visit& v, int j, int ahead) {
  Place p{&v, j + ahead};
  while (p.visit != nullptr && p.j >= w.per_chart) {
    p.visit = p.visit->next < 0 ? nullptr : &w.visits[static_cast<std::size_t>(p.visit->next)];
    p.j -= w.per_chart;
  }
  while (p.visit != nullptr && p.j < 0) {
    p.visit = p.visit->previous < 0 ? nullptr : &w.visits[static_cast<std::size_t>(p.visit->previous)];
    p.j += w.per_chart;
  }
  return p;
}

Passages find_passages(const Record& record, const RhythmOptions& o, MatrixXd& noise, VectorXd& count, Rhythm& r) {
  Passages w;
  w.record = &record;
  w.per_chart = std::max(2, o.sections);
  if (record.rows() < 100 || record.outputs.empty())
    throw RecordError(record.name, "it has hardly any data", "record for longer");
  for (const Channel& c : record.outputs) w.y.push_back(c.values);
  find_visits(w, o.exclude);
  find_rates(w);
  choose_levels(w);
  for (std::size_t k = 0; k < w.y.size(); ++k) {
    const Channel& c = record.outputs[k];
    if (k != w.phase) r.coordinates.emplace_back(c.name, c.unit);
    if (w.rate_of[k] < 0 && !w.rate_measured[k]) r.coordinates.emplace_back(c.name + "'", c.unit + "/s");
  }
  w.dim = static_cast<Index>(r.coordinates.size());
  const int N = w.sections();
  noise = MatrixXd::Zero(N, w.dim);
  count = VectorXd::Zero(N);
  for (Visit& v : w.visits) {
    if (std::find(w.order.begin(), w.order.end(), v.chart) != w.order.end() && v.chart >= 0) pass(w, v, noise, count);
  }
  if (!record.inputs.empty()) {
    for (Visit& v : w.visits) {
      for (int j = 0; j < w.per_chart && !v.x.empty(); ++j) {
        const Place next = from_here(w, v, j, 1);
        if (next.x() == nullptr) continue;
        const double from = v.when[static_cast<std::size_t>(j)];
        const double to = next.visit->when[static_cast<std::size_t>(next.j)];
        if (to > from)
          v.input[static_cast<std::size_t>(j)] = mean_between(record, record.inputs[0].values, v.first, from, to);
      }
    }
  }
  return w;
}

}  // namespace saltus::rhythm
