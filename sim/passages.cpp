#include "passages.hpp"

namespace saltus::rhythm {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using Index = Eigen::Index;

void find_visits(Passages& w, double exclude, bool marked) {
  const Record& record = *w.record;
  std::vector<double> steps;
  for (std::size_t i = 1; i < record.rows(); ++i) {
    if (record.experiment[i] == record.experiment[i - 1]) steps.push_back(record.t[i] - record.t[i - 1]);
  }
  w.spacing = median(steps);
  if (marked && record.cycle.empty() && record.chart_names.size() < 2) {
    throw RecordError(record.name, "nothing in it marks the events of its rhythm",
                      "give it a column cycle, which counts steps, or a column chart, which changes with them; or "
                      "choose --sections kinematic");
  }
  std::vector<int> key(record.rows(), 0);  // changes at an event
  const auto charts = static_cast<int>(record.chart_names.size()) + 1;
  for (std::size_t i = 0; i < record.rows(); ++i) {
    key[i] = (record.cycle.empty() ? 0 : record.cycle[i]) * charts + (record.chart.empty() ? 0 : record.chart[i]);
  }
  const auto drop = static_cast<std::size_t>(std::lround(exclude / w.spacing));
  w.ringing = drop;
  w.stay.assign(record.rows(), -1);
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
      if (v.rows == 0) v.first = from;
      v.begin = record.t[from];
      v.end = to < end ? record.t[to] : record.t[to - 1];
      v.previous = last;
      const int index = static_cast<int>(w.visits.size());
      std::fill_n(w.stay.begin() + static_cast<std::ptrdiff_t>(v.first), v.rows, index);
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

namespace {

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

void pass(const Passages& w, const Samples& s, const std::vector<double>& phase, Visit& v, MatrixXd& noise,
          VectorXd& count) {
  const int first_section = w.place(v);
  v.x.assign(static_cast<std::size_t>(w.per_chart), {});
  v.when.assign(v.x.size(), std::nan(""));
  v.input.assign(v.x.size(), std::nan(""));
  for (int j = 0; j < w.per_chart; ++j) {
    const auto here = locate(w, s, phase, v.first, v.rows, first_section + j);
    if (!here) continue;
    v.x[static_cast<std::size_t>(j)] = here->x;
    v.when[static_cast<std::size_t>(j)] = here->when;
    noise.row(first_section + j) += here->variance.transpose();
    count[first_section + j] += 1.0;
  }
}

void add_inputs(Passages& w) {
  const Record& record = *w.record;
  if (record.inputs.empty()) return;
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

void name_coordinates(Passages& w, Rhythm& r) {
  for (std::size_t k = 0; k < w.y.size(); ++k) {
    const Channel& c = w.record->outputs[k];
    if (w.plane && k == w.plane->output) {
      r.coordinates.emplace_back(c.name + " radius", "-");
      continue;
    }
    if (w.plane && static_cast<int>(k) == w.plane->rate) continue;
    if (w.plane || k != w.phase) r.coordinates.emplace_back(c.name, c.unit);
    if (w.rate_of[k] < 0 && !w.rate_measured[k]) r.coordinates.emplace_back(c.name + "'", c.unit + "/s");
  }
  w.dim = static_cast<Index>(r.coordinates.size());
}

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
  find_visits(w, o.exclude, true);
  find_rates(w);
  choose_levels(w);
  name_coordinates(w, r);
  const int N = w.sections();
  noise = MatrixXd::Zero(N, w.dim);
  count = VectorXd::Zero(N);
  const Samples samples{record.t, w.y, w.stay};
  const std::vector<double> phase = phase_of(w, samples);
  for (Visit& v : w.visits) {
    if (std::find(w.order.begin(), w.order.end(), v.chart) != w.order.end() && v.chart >= 0)
      pass(w, samples, phase, v, noise, count);
  }
  add_inputs(w);
  return w;
}

}  // namespace saltus::rhythm
