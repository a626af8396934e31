#include "rhythm.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "core/random.hpp"
#include "eigenvalues.hpp"
#include "format.hpp"

namespace saltus {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using Index = Eigen::Index;

constexpr double gap = 2.5;              // [-] of the usual spacing: beyond it samples are missing
constexpr Index half_window = 6;         // [sample] of the parabola about a passage, on either side
constexpr double mostly_told = 0.8;      // [-] of the input's deviations by the state: it excites nothing of its own
constexpr int finest = 16;               // [-] lines a cycle of the harmonic transfer functions
constexpr double weakest = 0.3;          // [-] correlation of a direction with what the section before sees of it
constexpr std::size_t fewest_rows = 12;  // of a map

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

double median(std::vector<double> v) {
  if (v.empty()) return 0.0;
  std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
  return v[v.size() / 2];
}
double quantile(std::vector<double> v, double q) {
  std::sort(v.begin(), v.end());
  return v[static_cast<std::size_t>(q * static_cast<double>(v.size() - 1))];
}

// A stay in one chart, from one event to the next.
struct Visit {
  int chart = 0;
  std::size_t first = 0, rows = 0;  // without what rings
  double begin = 0.0, end = 0.0;    // [s] of the events
  int next = -1, previous = -1;     // the stays it is joined to by events
  std::vector<VectorXd> x;          // (sections) coordinates; empty where not located
  std::vector<double> when, input;  // (sections) [s]; the input's mean from there to the next section
};

// What the search for sections works on.
struct Work {
  const Record* record = nullptr;
  double spacing = 0.0;  // [s]
  std::vector<Visit> visits;
  std::vector<int> order;  // charts of a cycle
  std::vector<std::vector<double>> y;
  std::vector<int> rate_of;         // (outputs) the output that it is the rate of, -1 for none
  std::vector<bool> rate_measured;  // (outputs) another one is its rate
  std::size_t phase = 0;            // the output that passes
  int per_chart = 0;
  std::vector<double> level;  // (sections)
  Index dim = 0;              // coordinates

  int sections() const { return per_chart * static_cast<int>(order.size()); }
  int place(const Visit& v) const {
    return static_cast<int>(std::find(order.begin(), order.end(), v.chart) - order.begin()) * per_chart;
  }
};

void find_visits(Work& w, double exclude, Rhythm& r) {
  const Record& record = *w.record;
  std::vector<double> steps;
  for (std::size_t i = 1; i < record.rows(); ++i) {
    if (record.experiment[i] == record.experiment[i - 1]) steps.push_back(record.t[i] - record.t[i - 1]);
  }
  w.spacing = median(steps);
  const bool marked = !record.cycle.empty() || record.chart_names.size() > 1;
  std::vector<int> key(record.rows(), 0);  // changes at an event
  if (marked) {
    for (std::size_t i = 0; i < record.rows(); ++i) {
      key[i] = 2 * (record.cycle.empty() ? 0 : record.cycle[i]) * static_cast<int>(record.chart_names.size() + 1) +
               (record.chart.empty() ? 0 : record.chart[i]);
    }
  } else {
    r.notes.push_back("Neither a column cycle nor changes of chart mark the events: a cycle begins where " +
                      record.outputs[0].name + " rises through its middle.");
    const double middle = quantile(record.outputs[0].values, 0.5);
    const double band = 0.1 * (quantile(record.outputs[0].values, 0.95) - middle);
    bool low = false;
    for (std::size_t i = 1; i < record.rows(); ++i) {
      const double v = record.outputs[0].values[i];
      key[i] = key[i - 1];
      if (v < middle - band) low = true;
      if (low && v > middle) {
        low = false;
        ++key[i];
      }
    }
  }
  const auto drop = marked ? static_cast<std::size_t>(std::lround(exclude / w.spacing)) : std::size_t{0};
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
void find_rates(Work& w) {
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
void choose_levels(Work& w) {
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
                      "record one that does, such as the angle of the leg that stands; or mark the events in a column "
                      "cycle or chart");
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
                        "sample faster, or leave less out with --exclude");
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
void pass(const Work& w, Visit& v, MatrixXd& noise, VectorXd& count) {
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

// The stay and the section that come `ahead` sections after (before, where negative); null where the record is cut.
struct Place {
  const Visit* visit = nullptr;
  int j = 0;
  const VectorXd* x() const {
    return visit != nullptr && visit->x[static_cast<std::size_t>(j)].size() > 0 ? &visit->x[static_cast<std::size_t>(j)]
                                                                                : nullptr;
  }
};
Place from_here(const Work& w, const Visit& v, int j, int ahead) {
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

// Passages of one section, of the one `ahead` and of the one before, which sees the same deviations through noise of
// its own (an instrument): row by row.
struct Pairs {
  MatrixXd x, y, z;
  VectorXd u;              // the input from the section to the next
  std::vector<int> visit;  // whose the row is
};
Pairs pairs_of(const Work& w, int section, int ahead) {
  std::vector<const VectorXd*> x, y, z;
  std::vector<double> u;
  Pairs p;
  const int j = section % w.per_chart;
  for (std::size_t i = 0; i < w.visits.size(); ++i) {
    const Visit& v = w.visits[i];
    if (w.place(v) != section - j || v.x.empty()) continue;
    const auto a = Place{&v, j}.x(), b = from_here(w, v, j, ahead).x(), c = from_here(w, v, j, -1).x();
    if (a == nullptr || b == nullptr || c == nullptr) continue;
    x.push_back(a);
    y.push_back(b);
    z.push_back(c);
    u.push_back(v.input[static_cast<std::size_t>(j)]);
    p.visit.push_back(static_cast<int>(i));
  }
  const auto n = static_cast<Index>(x.size());
  p.x.resize(n, w.dim);
  p.y.resize(n, w.dim);
  p.z.resize(n, w.dim);
  p.u = Eigen::Map<const VectorXd>(u.data(), n);
  for (Index i = 0; i < n; ++i) {
    p.x.row(i) = x[at(i)]->transpose();
    p.y.row(i) = y[at(i)]->transpose();
    p.z.row(i) = z[at(i)]->transpose();
  }
  return p;
}

MatrixXd centred(const MatrixXd& m, const VectorXd& weight) {
  return m.rowwise() - (weight.transpose() * m / weight.sum()).eval().row(0);
}

// Directions of the scatter at every section, most lively first: what the section before sees of it as well, in units
// of what locating adds.
struct Frame {
  MatrixXd in, out;  // (directions x coordinates), (coordinates x directions): out * in projects
  MatrixXd seen;     // (directions x coordinates) of the section before, which tells them
  int directions = 0;
};
Frame frame_of(const Pairs& p, const VectorXd& noise_x, const VectorXd& noise_z) {
  const auto n = p.x.rows();
  const VectorXd one = VectorXd::Ones(n);
  const MatrixXd x = centred(p.x, one) * noise_x.cwiseInverse().asDiagonal();
  const MatrixXd z = centred(p.z, one) * noise_z.cwiseInverse().asDiagonal();
  const Eigen::JacobiSVD<MatrixXd> svd(x.transpose() * z / static_cast<double>(n),
                                       Eigen::ComputeFullU | Eigen::ComputeFullV);
  Frame f;
  // Of noise alone the largest singular value is about 2 sqrt(coordinates / rows) times that of a direction's scatter.
  const double none = 4.0 * std::sqrt(static_cast<double>(p.x.cols()) / static_cast<double>(n));
  const auto tells = [&](Index k) {
    const double own = (x * svd.matrixU().col(k)).squaredNorm() * (z * svd.matrixV().col(k)).squaredNorm();
    return svd.singularValues()[k] * static_cast<double>(n) > weakest * std::sqrt(own);
  };
  while (f.directions < p.x.cols() && svd.singularValues()[f.directions] > none && tells(f.directions)) ++f.directions;
  f.in = svd.matrixU().transpose() * noise_x.cwiseInverse().asDiagonal();
  f.out = noise_x.asDiagonal() * svd.matrixU();
  f.seen = svd.matrixV().transpose() * noise_z.cwiseInverse().asDiagonal();
  return f;
}

// y = T x in the frames' first directions, by the instrument: T = (y' z)(x' z)^-1, which noise in x does not bias.
MatrixXd map_of(const Pairs& p, const Frame& here, const Frame& there, Index n, const VectorXd& weight) {
  const MatrixXd x = centred(p.x, weight) * here.in.topRows(n).transpose();
  const MatrixXd y = centred(p.y, weight) * there.in.topRows(n).transpose();
  const MatrixXd z = weight.asDiagonal() * (centred(p.z, weight) * here.seen.topRows(n).transpose());
  const MatrixXd xz = x.transpose() * z;
  return (y.transpose() * z) * xz.fullPivLu().inverse();
}

// The values nearest to those of `like`, in its order.
std::vector<Complex> in_order(std::vector<Complex> values, const std::vector<Complex>& like) {
  std::vector<Complex> r;
  for (const Complex& z : like) {
    const auto nearest = std::min_element(values.begin(), values.end(), [&](const Complex& a, const Complex& b) {
      return std::abs(a - z) < std::abs(b - z);
    });
    r.push_back(*nearest);
    values.erase(nearest);
  }
  return r;
}

struct Maps {
  std::vector<std::vector<Pairs>> pairs;  // [section within a chart][chart]: one stay on
  std::vector<Frame> frames;              // (sections)
  int directions = 0;
};

// Multipliers at each section within a chart: [section][multiplier].
std::vector<std::vector<Complex>> multipliers_at(const Work& w, const Maps& maps, const VectorXd& weight,
                                                 const std::vector<Complex>* like) {
  std::vector<std::vector<Complex>> r;
  for (std::size_t j = 0; j < maps.pairs.size(); ++j) {
    MatrixXd cycle = MatrixXd::Identity(maps.directions, maps.directions);
    for (std::size_t c = 0; c < w.order.size(); ++c) {
      const Pairs& p = maps.pairs[j][c];
      VectorXd own(p.x.rows());
      for (Index i = 0; i < own.size(); ++i) own[i] = weight[p.visit[at(i)]];
      const std::size_t here = c * static_cast<std::size_t>(w.per_chart) + j;
      const std::size_t there = (here + static_cast<std::size_t>(w.per_chart)) % maps.frames.size();
      cycle = map_of(p, maps.frames[here], maps.frames[there], maps.directions, own) * cycle;
    }
    if (!cycle.allFinite()) return {};
    auto values = eigenvalues(cycle);
    if (like == nullptr && !r.empty()) values = in_order(values, r.front());
    r.push_back(like == nullptr ? values : in_order(values, *like));
  }
  return r;
}

std::vector<Complex> mean_of(const std::vector<std::vector<Complex>>& v) {
  std::vector<Complex> m(v.front().size());
  for (const auto& one : v) {
    for (std::size_t i = 0; i < m.size(); ++i) m[i] += one[i] / static_cast<double>(v.size());
  }
  return m;
}

// How often each stay is drawn when as many are drawn with replacement.
VectorXd drawn(std::size_t n, Random& random) {
  VectorXd w = VectorXd::Zero(static_cast<Index>(n));
  for (std::size_t i = 0; i < n; ++i)
    w[std::min(static_cast<Index>(n) - 1, static_cast<Index>(random.uniform() * static_cast<double>(n)))] += 1.0;
  return w;
}

// x of the next section = A x + B u, section by section.
struct Chain {
  std::vector<MatrixXd> A;
  std::vector<VectorXd> B;
};
Chain chain_of(const std::vector<Pairs>& pairs, const std::vector<Frame>& frames, int directions,
               const VectorXd& weight) {
  Chain chain;
  for (std::size_t s = 0; s < pairs.size(); ++s) {
    const Pairs& p = pairs[s];
    VectorXd own(p.x.rows());
    for (Index i = 0; i < own.size(); ++i) own[i] = weight[p.visit[at(i)]];
    const Frame& there = frames[(s + 1) % frames.size()];
    MatrixXd x(p.x.rows(), directions + 1), z(p.x.rows(), directions + 1);
    const MatrixXd u = centred(p.u, own);
    x << centred(p.x, own) * frames[s].in.topRows(directions).transpose(), u;
    z << centred(p.z, own) * frames[s].seen.topRows(directions).transpose(), u;
    z = own.asDiagonal() * z;
    const MatrixXd y = centred(p.y, own) * there.in.topRows(directions).transpose();
    const MatrixXd both = (y.transpose() * z) * (x.transpose() * z).eval().fullPivLu().inverse();
    chain.A.push_back(both.leftCols(directions));
    chain.B.push_back(both.col(directions));
  }
  return chain;
}

// H_m of every coordinate at f: the answer to e^{i w k} is e^{i w k} times what repeats with the cycle.
Eigen::MatrixXcd htf_at(const Chain& chain, const std::vector<Frame>& frames, double f, int harmonics) {
  const auto N = static_cast<Index>(chain.A.size());
  const Index n = chain.A.front().rows();
  const double w = 2.0 * std::numbers::pi * f / static_cast<double>(N);
  const auto input = [&](Index k) { return std::polar(1.0, w * static_cast<double>(k)); };
  Eigen::MatrixXcd phi = Eigen::MatrixXcd::Identity(n, n);
  Eigen::VectorXcd forced = Eigen::VectorXcd::Zero(n);
  for (Index k = 0; k < N; ++k) {
    forced = chain.A[at(k)] * forced + chain.B[at(k)] * input(k);
    phi = (chain.A[at(k)] * phi).eval();
  }
  Eigen::VectorXcd x =
      (std::polar(1.0, w * static_cast<double>(N)) * Eigen::MatrixXcd::Identity(n, n) - phi).fullPivLu().solve(forced);
  const Index outputs = frames.front().out.rows();
  Eigen::MatrixXcd h = Eigen::MatrixXcd::Zero(2 * harmonics + 1, outputs);
  for (Index k = 0; k < N; ++k) {
    const Eigen::VectorXcd y = frames[at(k)].out.leftCols(n) * x;
    for (int m = -harmonics; m <= harmonics; ++m) {
      const double turn =
          2.0 * std::numbers::pi * static_cast<double>(m) * static_cast<double>(k) / static_cast<double>(N);
      h.row(m + harmonics) += y.transpose() * std::conj(input(k)) * std::polar(1.0 / static_cast<double>(N), -turn);
    }
    x = (chain.A[at(k)] * x + chain.B[at(k)] * input(k)).eval();
  }
  return h;
}

// Harmonic transfer functions, or why there are none.
void add_htf(const Work& w, const Maps& maps, const RhythmOptions& o, Rhythm& r) {
  if (w.record->inputs.empty()) {
    r.refusal = "the record has no input";
    return;
  }
  if (w.record->inputs.size() > 1) {
    r.refusal = "they are identified for one input at a time; keep one column in `# inputs`";
    return;
  }
  const std::string unit = w.record->inputs[0].unit;
  std::vector<Pairs> pairs;
  double all = 0.0, left = 0.0, size = 0.0, n_all = 0.0;
  for (int s = 0; s < w.sections(); ++s) {
    pairs.push_back(pairs_of(w, s, 1));
    Pairs& p = pairs.back();
    if (p.x.rows() < 3 * (maps.directions + 2) || !p.u.allFinite()) {
      r.refusal = "too few passages of section " + std::to_string(s) + " have their neighbours; record more cycles";
      return;
    }
    const VectorXd one = VectorXd::Ones(p.x.rows());
    MatrixXd known(p.x.rows(), 2 * w.dim);
    known << centred(p.x, one), centred(p.z, one);
    for (Index i = 0; i < known.cols(); ++i) known.col(i) /= std::max(1e-300, known.col(i).norm());
    const VectorXd u = centred(p.u, one);
    const VectorXd rest = u - known * known.colPivHouseholderQr().solve(u);
    const auto n = static_cast<double>(p.x.rows());
    all += u.squaredNorm() / (n - 1.0);
    left += rest.squaredNorm() / std::max(1.0, n - 1.0 - static_cast<double>(known.cols()));
    size += p.u.squaredNorm();
    n_all += n;
  }
  const double deviation = std::sqrt(all / static_cast<double>(pairs.size()));
  if (deviation < 1e-6 * std::sqrt(size / n_all) || !(all > 0.0)) {
    r.refusal = "the input repeats from cycle to cycle and excites nothing; add a stimulus of its own";
    return;
  }
  r.told = std::clamp(1.0 - left / all, 0.0, 1.0);
  if (r.told > mostly_told) {
    r.refusal = format(
        "the input deviates from its mean cycle by %.3g %s, but the state before tells %.0f %% of that: it is "
        "fed back, and what it does cannot be told from what the state does; add a stimulus of its own",
        deviation, unit.c_str(), 100.0 * r.told);
    return;
  }
  const auto n = w.visits.size();
  const Chain chain = chain_of(pairs, maps.frames, maps.directions, VectorXd::Ones(static_cast<Index>(n)));
  const int lines = std::min(4 * finest, finest * w.sections() / 2);
  std::vector<Eigen::MatrixXcd> h;
  for (int q = 1; q < lines; ++q) h.push_back(htf_at(chain, maps.frames, static_cast<double>(q) / finest, o.harmonics));
  // By the median, as for the multipliers: a replicate whose maps are nearly singular lies anywhere.
  Random random(o.seed + 1);
  const int replicates = std::min(o.replicates, 100);
  std::vector<std::vector<std::vector<double>>> squares(h.size(), std::vector<std::vector<double>>(at(h[0].size())));
  for (int k = 0; k < replicates; ++k) {
    const Chain again = chain_of(pairs, maps.frames, maps.directions, drawn(n, random));
    for (std::size_t q = 0; q < h.size(); ++q) {
      const Eigen::MatrixXcd off = htf_at(again, maps.frames, static_cast<double>(q + 1) / finest, o.harmonics) - h[q];
      for (Index i = 0; i < off.size(); ++i) squares[q][at(i)].push_back(std::norm(off(i)));
    }
  }
  std::vector<double> strength(at(h[0].cols()), 0.0);  // (coordinates) of H_0 over its standard errors, mean square
  std::vector<RhythmHtf> list;
  for (std::size_t q = 0; q < h.size(); ++q) {
    for (Index m = 0; m < h[q].rows(); ++m) {
      for (Index c = 0; c < h[q].cols(); ++c) {
        const double sigma = std::sqrt(median(squares[q][at(c * h[q].rows() + m)]) / std::numbers::ln2);
        list.push_back(
            {static_cast<int>(m) - o.harmonics, static_cast<double>(q + 1) / finest, at(c), h[q](m, c), sigma});
        if (m != o.harmonics || !(sigma > 0.0)) continue;
        strength[at(c)] += std::norm(h[q](m, c)) / (sigma * sigma) / static_cast<double>(h.size());
      }
    }
  }
  const double best = *std::max_element(strength.begin(), strength.end());
  if (!(best > 4.0)) {
    r.refusal = format(
        "the %.3g %s by which the input deviates on its own (%.0f %% of its deviations) are answered by nothing "
        "that stands out of the scatter: H_0 is %.1f standard errors; add a larger stimulus, or record more cycles",
        deviation * std::sqrt(1.0 - r.told), unit.c_str(), 100.0 * (1.0 - r.told), std::sqrt(best));
    return;
  }
  r.htf = std::move(list);
}

}  // namespace

Rhythm identify_rhythm(const Record& record, const RhythmOptions& o) {
  Rhythm r;
  Work w;
  w.record = &record;
  w.per_chart = std::max(2, o.sections);
  if (record.rows() < 100 || record.outputs.empty())
    throw RecordError(record.name, "it has hardly any data", "record for longer");
  for (const Channel& c : record.outputs) w.y.push_back(c.values);
  find_visits(w, o.exclude, r);
  find_rates(w);
  choose_levels(w);
  for (std::size_t k = 0; k < w.y.size(); ++k) {
    const Channel& c = record.outputs[k];
    if (k != w.phase) r.coordinates.emplace_back(c.name, c.unit);
    if (w.rate_of[k] < 0 && !w.rate_measured[k]) r.coordinates.emplace_back(c.name + "'", c.unit + "/s");
  }
  w.dim = static_cast<Index>(r.coordinates.size());
  const int N = w.sections();
  MatrixXd noise = MatrixXd::Zero(N, w.dim);
  VectorXd count = VectorXd::Zero(N);
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

  // The cycle.
  r.experiments = static_cast<int>(experiments(record).size());
  for (const int c : w.order)
    r.charts.push_back(c >= 0 && !record.chart_names.empty() ? record.chart_names[at(c)] : "");
  std::vector<double> periods;
  std::vector<std::vector<double>> phase(static_cast<std::size_t>(N));
  for (const Visit& v : w.visits) {
    if (v.chart != w.order.front() || v.previous < 0) continue;
    const Visit* last = &v;
    for (std::size_t c = 1; c < w.order.size() && last != nullptr; ++c)
      last = last->next < 0 ? nullptr : &w.visits[static_cast<std::size_t>(last->next)];
    if (last == nullptr || last->next < 0) continue;
    periods.push_back(last->end - v.begin);
    const Visit* now = &v;
    for (std::size_t c = 0; c < w.order.size(); ++c) {
      for (std::size_t j = 0; j < now->when.size(); ++j) {
        if (std::isfinite(now->when[j]))
          phase[at(w.place(*now)) + j].push_back((now->when[j] - v.begin) / periods.back());
      }
      now = now->next < 0 ? now : &w.visits[static_cast<std::size_t>(now->next)];
    }
  }
  r.cycles = static_cast<int>(periods.size());
  for (const double x : periods) r.period += x / static_cast<double>(periods.size());
  for (const double x : periods) r.period_scatter += (x - r.period) * (x - r.period) / std::max(1.0, r.cycles - 1.0);
  r.period_scatter = std::sqrt(r.period_scatter);

  std::vector<VectorXd> noises;
  for (int s = 0; s < N; ++s) {
    RhythmSection section;
    section.chart = r.charts[static_cast<std::size_t>(s / w.per_chart)];
    section.output = record.outputs[w.phase].name;
    section.level = w.level[static_cast<std::size_t>(s)];
    section.passages = static_cast<int>(count[s]);
    section.phase = phase[at(s)].empty() ? std::nan("") : median(phase[at(s)]);
    VectorXd mean = VectorXd::Zero(w.dim), square = mean;
    for (const Visit& v : w.visits) {
      if (w.place(v) != s - s % w.per_chart || v.x.empty() || v.x[at(s % w.per_chart)].size() == 0) continue;
      mean += v.x[at(s % w.per_chart)] / count[s];
    }
    for (const Visit& v : w.visits) {
      if (w.place(v) != s - s % w.per_chart || v.x.empty() || v.x[at(s % w.per_chart)].size() == 0) continue;
      square += (v.x[at(s % w.per_chart)] - mean).cwiseAbs2() / std::max(1.0, count[s] - 1.0);
    }
    const VectorXd scatter = square.cwiseSqrt();
    // Never smaller than rounding.
    const VectorXd own = (noise.row(s).transpose() / std::max(1.0, count[s]))
                             .cwiseSqrt()
                             .cwiseMax(1e-9 * (mean.cwiseAbs() + scatter))
                             .cwiseMax(1e-300);
    noises.push_back(own);
    section.mean.assign(mean.data(), mean.data() + w.dim);
    section.scatter.assign(scatter.data(), scatter.data() + w.dim);
    section.noise.assign(own.data(), own.data() + w.dim);
    r.sections.push_back(std::move(section));
  }

  // Maps: from each section but a chart's first, whose instrument lies beyond an event, to the same of the next chart.
  Maps maps;
  maps.directions = static_cast<int>(w.dim);
  for (int s = 0; s < N; ++s) {
    const Pairs p = pairs_of(w, s, 1);
    if (p.x.rows() < static_cast<Index>(fewest_rows)) {
      throw RecordError(record.name,
                        "only " + std::to_string(p.x.rows()) + " passages of a section are followed by another",
                        "record more cycles; it takes a dozen of each step");
    }
    maps.frames.push_back(frame_of(p, noises[at(s)], noises[at((s + N - 1) % N)]));
    if (s % w.per_chart > 0) maps.directions = std::min(maps.directions, maps.frames.back().directions);
  }
  r.directions = maps.directions;
  if (maps.directions == 0) {
    r.refusal = "the passages scatter by no more than locating them does";
    r.notes.push_back("Every cycle is the same within the sensors' noise: nothing tells how deviations decay.");
    return r;
  }
  for (int j = 1; j < w.per_chart; ++j) {
    maps.pairs.emplace_back();
    for (std::size_t c = 0; c < w.order.size(); ++c)
      maps.pairs.back().push_back(pairs_of(w, static_cast<int>(c) * w.per_chart + j, w.per_chart));
    for (const Pairs& p : maps.pairs.back()) {
      if (p.x.rows() < std::max<Index>(static_cast<Index>(fewest_rows), 3 * maps.directions)) {
        throw RecordError(
            record.name, "only " + std::to_string(p.x.rows()) + " steps are followed by another of the same experiment",
            "record more cycles; it takes a dozen of each step");
      }
    }
  }
  // The frames' pairs begin at the second section of a chart.
  std::vector<Frame> all_frames = maps.frames;
  const auto n = w.visits.size();
  const auto shifted = [&](const VectorXd& weight, const std::vector<Complex>* like) {
    std::vector<std::vector<Complex>> v;
    Maps one;
    one.directions = maps.directions;
    for (std::size_t j = 0; j < maps.pairs.size(); ++j) {
      one.pairs = {maps.pairs[j]};
      one.frames.clear();
      for (std::size_t c = 0; c < w.order.size(); ++c) one.frames.push_back(all_frames[c * at(w.per_chart) + j + 1]);
      Work step;
      step.order = w.order;
      step.per_chart = 1;
      auto m = multipliers_at(step, one, weight, like != nullptr ? like : v.empty() ? nullptr : &v.front());
      if (m.empty()) return std::vector<std::vector<Complex>>{};
      v.push_back(m.front());
    }
    return v;
  };
  const auto each = shifted(VectorXd::Ones(static_cast<Index>(n)), nullptr);
  if (each.empty()) throw RecordError(record.name, "its section maps cannot be told", "record more cycles");
  const std::vector<Complex> mean = mean_of(each);
  std::vector<std::vector<Complex>> replicates;
  Random random(o.seed);
  for (int k = 0; k < o.replicates; ++k) {
    const auto again = shifted(drawn(n, random), &mean);
    if (!again.empty()) replicates.push_back(mean_of(again));
  }
  for (std::size_t i = 0; i < mean.size(); ++i) {
    RhythmMultiplier m;
    m.value = mean[i];
    std::vector<double> off, modulus;
    for (const auto& v : replicates) {
      off.push_back(std::norm(v[i] - mean[i]));
      modulus.push_back(std::abs(v[i]));
    }
    // The median, for a replicate whose map is nearly singular lies anywhere: of two Gaussian numbers the square's is
    // 2 ln 2 / 2 of its mean, of one 0.455.
    m.sigma = std::sqrt(median(off) / (std::abs(m.value.imag()) > 0.0 ? std::numbers::ln2 : 0.455));
    m.low = modulus.empty() ? 0.0 : quantile(modulus, 0.025);
    m.high = modulus.empty() ? 0.0 : quantile(modulus, 0.975);
    r.multipliers.push_back(m);
  }
  for (const auto& v : each) r.disagreement += std::norm(v[0] - mean[0]) / static_cast<double>(each.size());
  r.disagreement = std::sqrt(r.disagreement);
  if (maps.directions < static_cast<int>(w.dim)) {
    r.notes.push_back(
        format("In %d of %d directions the section before sees the passages scatter as well; multipliers of the "
               "others, the most strongly contracted, are not told.",
               maps.directions, static_cast<int>(w.dim)));
  }
  add_htf(w, maps, o, r);
  return r;
}

}  // namespace saltus
