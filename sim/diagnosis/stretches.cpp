#include "stretches.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <numbers>

namespace saltus::diagnosis {
namespace {

constexpr double usual_length = 2.0;        // [s] of a machine that swings on
constexpr double usual_in_a_step = 0.2;     // [s] between impacts, at least
constexpr double usual_gap = 2.5;           // [-] of the usual spacing between samples, beyond which some are missing
constexpr double lost = 0.1;                // [s] without a sample that does not end a stretch: the input held on
constexpr double history = 0.25;            // [s] of input kept from before a stretch, for inputs that act late
constexpr std::size_t fewest_samples = 12;  // in a stretch

std::string lower_case(std::string s) {
  for (char& c : s) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return s;
}

// Rows in which the same chart is lived, without a gap in time.
struct Piece {
  std::size_t first = 0, rows = 0;
  std::size_t history = 0;  // rows before it of the same experiment, without a gap
  int chart = 0;
};

std::vector<Piece> pieces_of(const Record& record, const Machine& machine, const std::vector<int>& charts,
                             double spacing, const Cut& cut, std::size_t& ringing) {
  std::vector<Piece> r;
  const bool steps = machine.in_steps;
  const double gap = std::max(usual_gap * spacing, lost);  // [s]
  for (const Experiment& e : experiments(record)) {
    const std::size_t end = e.first_row + e.rows;
    std::size_t unbroken = e.first_row;
    for (std::size_t from = e.first_row; from < end;) {
      std::size_t to = from + 1;
      const auto key = [&](std::size_t i) { return record.chart.empty() ? 0 : record.chart[i]; };
      const auto skipped = [&](std::size_t i) { return !cut.skip.empty() && cut.skip[i]; };
      const auto same_step = [&](std::size_t i) {
        return key(i) == key(from) && (!steps || record.cycle.empty() || record.cycle[i] == record.cycle[from]);
      };
      while (to < end && same_step(to) && skipped(to) == skipped(from) && record.t[to] - record.t[to - 1] < gap) ++to;
      Piece p{from, to - from, 0, 0};
      const bool known = (record.chart.empty() || key(from) >= 0) && !skipped(from);
      if (known && !charts.empty()) p.chart = charts[static_cast<std::size_t>(std::max(0, key(from)))];
      if (steps) {
        // The first row and the last of an experiment are taken for impacts, too: who cuts walks into pieces cuts
        // there.
        std::size_t begin = from, stop = to;
        while (begin < stop && record.t[begin] < record.t[from] + cut.exclude - 0.5 * spacing) ++begin;
        while (stop > begin && record.t[stop - 1] > record.t[to - 1] - cut.exclude + 0.5 * spacing) --stop;
        ringing += p.rows - (stop - begin);
        p.first = begin;
        p.rows = stop - begin;
      }
      p.history = p.first - unbroken;
      if (known && p.rows >= fewest_samples) r.push_back(p);
      if (to < end && record.t[to] - record.t[to - 1] >= gap) unbroken = to;
      from = to;
    }
  }
  return r;
}

// [s] Four stretches to a step, where steps are long.
double within_a_step(const std::vector<Piece>& pieces, double spacing) {
  if (pieces.empty()) return usual_in_a_step;
  std::vector<std::size_t> rows;
  for (const Piece& p : pieces) rows.push_back(p.rows);
  const auto middle = rows.begin() + static_cast<std::ptrdiff_t>(rows.size() / 2);
  std::nth_element(rows.begin(), middle, rows.end());
  return std::max(usual_in_a_step, 0.25 * spacing * static_cast<double>(*middle));
}

// An angle that is recorded modulo a turn, as the angle that it is.
std::vector<double> unwrapped(const std::vector<double>& v, const std::vector<int>& experiment, bool& any) {
  std::vector<double> r = v;
  double turns = 0.0, last = std::nan("");
  constexpr double turn = 2.0 * std::numbers::pi;
  for (std::size_t i = 0; i < v.size(); ++i) {
    if (i > 0 && experiment[i] != experiment[i - 1]) {
      turns = 0.0;
      last = std::nan("");
    }
    if (std::isfinite(v[i]) && std::isfinite(last) && std::abs(std::abs(v[i] - last) - turn) < 0.1 * turn) {
      turns += v[i] < last ? 1.0 : -1.0;
      any = true;
    }
    if (std::isfinite(v[i])) last = v[i];
    r[i] = v[i] + turns * turn;
  }
  return r;
}

}  // namespace

std::vector<int> charts_of(const Record& record, const Machine& machine) {
  std::vector<int> r;
  if (machine.in_steps && machine.charts.size() == 1 && record.cycle.empty()) {
    throw RecordError(record.name,
                      "it has no column 'cycle', and nothing else says where a step of " + machine.name + " ends",
                      "count the steps, from impact to impact, in a column 'cycle'");
  }
  if (machine.charts.size() == 1) return std::vector<int>(record.chart_names.size(), 0);
  if (record.chart.empty()) {
    throw RecordError(record.name, "it has no column 'chart', and the model has several charts",
                      "say in every row which leg stands");
  }
  std::string known;
  for (const std::string& c : machine.charts) known += (known.empty() ? "" : ", ") + lower_case(c);
  for (const std::string& name : record.chart_names) {
    const auto it = std::find_if(machine.charts.begin(), machine.charts.end(),
                                 [&](const std::string& c) { return lower_case(c) == lower_case(name); });
    if (it == machine.charts.end()) {
      throw RecordError(record.name, "the model has no chart '" + name + "' (it has " + known + ")",
                        "name the charts as the model does");
    }
    r.push_back(static_cast<int>(it - machine.charts.begin()));
  }
  return r;
}

Stretches cut_into_stretches(const Record& record, const Machine& machine, const Cut& cut) {
  Stretches s;
  Data& data = s.data;
  const std::size_t ny = machine.outputs.size(), nu = machine.inputs.size();
  const auto out = columns_of(record, machine, true), in = columns_of(record, machine, false);
  if (record.rows() == 0) throw RecordError(record.name, "it has no data rows", "record some");
  const std::vector<int> charts = charts_of(record, machine);
  data.quality.rows = record.rows();
  std::vector<std::vector<double>> y(ny);
  for (std::size_t j = 0; j < ny; ++j) {
    y[j] = record.outputs[out[j]].values;
    data.quality.resolution.push_back(resolution_of(y[j]));
    bool wrapped = false;
    if (machine.outputs[j].unit == "rad") y[j] = unwrapped(y[j], record.experiment, wrapped);
    if (wrapped) data.notes.push_back(machine.outputs[j].name + " was recorded modulo a turn; the turns were counted.");
  }
  std::vector<double> steps;
  for (std::size_t i = 1; i < record.rows(); ++i) {
    if (record.experiment[i] == record.experiment[i - 1]) steps.push_back(record.t[i] - record.t[i - 1]);
  }
  if (steps.size() < fewest_samples) throw RecordError(record.name, "it has hardly any samples", "record for longer");
  std::nth_element(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2), steps.end());
  s.spacing = steps[steps.size() / 2];
  for (const double d : steps) {
    if (d < usual_gap * s.spacing) s.jitter = std::max(s.jitter, std::abs(d / s.spacing - 1.0));
  }
  const auto pieces = pieces_of(record, machine, charts, s.spacing, cut, s.ringing);
  s.length = cut.length > 0.0 ? cut.length : machine.in_steps ? within_a_step(pieces, s.spacing) : usual_length;
  const auto aim =
      std::max<std::size_t>(fewest_samples, static_cast<std::size_t>(std::lround(s.length / s.spacing)) + 1);
  for (const Piece& p : pieces) {
    const std::size_t whole = p.rows / aim, count = cut.exact ? whole : std::max<std::size_t>(1, whole);
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t from = p.first + (cut.exact ? k * aim : p.rows * k / count);
      const std::size_t rows = cut.exact ? aim : p.first + p.rows * (k + 1) / count - from;
      std::size_t before = std::min(p.history + (from - p.first), static_cast<std::size_t>(history / s.spacing));
      Segment g;
      g.experiment = record.experiment[from];
      g.first = before;
      g.guess.chart = p.chart;
      for (std::size_t i = from - before; i < from + rows; ++i) {
        g.t.push_back(record.t[i]);
        for (std::size_t j = 0; j < nu; ++j) {
          double u = record.inputs[in[j]].values[i];
          if (!std::isfinite(u)) {  // held until told otherwise
            ++data.quality.filled_inputs;
            u = g.u.size() >= nu ? g.u[g.u.size() - nu] : 0.0;
          }
          g.u.push_back(u);
        }
      }
      const auto n = static_cast<Eigen::Index>(rows * ny);
      g.y = g.count = Eigen::VectorXd::Zero(n);
      g.within = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(ny));
      for (std::size_t i = 0; i < rows; ++i) {
        for (std::size_t j = 0; j < ny; ++j) {
          const auto at = static_cast<Eigen::Index>(i * ny + j);
          const double v = y[j][from + i];
          if (!std::isfinite(v)) {
            ++data.quality.missing;
            continue;
          }
          g.y[at] = v;
          g.count[at] = 1.0;
        }
      }
      s.origin.push_back({g.experiment, record.cycle.empty() ? 0 : record.cycle[from], from, record.t[from],
                          record.t[from + rows - 1]});
      data.segments.push_back(std::move(g));
    }
  }
  if (data.segments.empty()) {
    throw RecordError(record.name, "nowhere in it does one chart last long enough to learn from",
                      "sample faster, or check the column chart");
  }
  data.noise = Eigen::VectorXd::Ones(static_cast<Eigen::Index>(ny));
  std::vector<Eigen::VectorXd> raw;
  for (const Segment& g : data.segments) raw.push_back(g.y);
  noise_from_residuals(data, raw);
  return s;
}

bool start_from(const Problem& p, const Segment& s, std::span<const double> values, std::size_t samples, Start& start) {
  const Machine& m = *p.machine;
  const Data& data = *p.data;
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  const Eigen::Index n = m.starts();
  const std::size_t n_used = std::min(samples, s.samples());
  const Course course{std::span(s.t).first(s.first + n_used),
                      std::span(s.u).first((s.first + n_used) * m.inputs.size()), s.first, p.h_max};
  const auto rows = static_cast<Eigen::Index>(n_used) * ny;
  const auto coordinates = m.free_coordinates(start.chart);
  for (int round = 0; round < 6; ++round) {
    const Response y = m.run(values, course, start, {}, true);
    if (!usable(y.status)) return false;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const Eigen::Map<const RowMajor> all(y.gradient.data(), rows, m.width());
    Eigen::MatrixXd J = all.leftCols(n);
    Eigen::VectorXd r = s.y.head(rows) - Eigen::Map<const Eigen::VectorXd>(y.y.data(), rows);
    for (Eigen::Index i = 0; i < rows; ++i) {
      const double w = s.count[i] > 0.0 ? 1.0 / data.noise[i % ny] : 0.0;
      J.row(i) *= w;
      r[i] *= w;
    }
    Eigen::MatrixXd a = J.transpose() * J;
    a.diagonal().array() += 1e-9 * (1e-9 + a.diagonal().maxCoeff());
    const Eigen::VectorXd step = Eigen::LDLT<Eigen::MatrixXd>(a).solve(J.transpose() * r);
    if (!step.allFinite()) return false;
    for (std::size_t k = 0; k < coordinates.size(); ++k)
      start.x[static_cast<std::size_t>(coordinates[k])] += step[static_cast<Eigen::Index>(k)];
    if (step.cwiseAbs().maxCoeff() < 1e-9) break;
  }
  return true;
}

double growth(const Problem& p, const Segment& s, std::span<const double> values, const Start& start) {
  const Machine& m = *p.machine;
  const Response y = m.run(values, s.course(p.h_max), start, {}, true);
  if (!usable(y.status)) return 1e300;
  const auto ny = p.data->outputs(), width = static_cast<std::size_t>(m.width());
  double most = 1.0;
  for (std::size_t k = 0; k < start.x.size(); ++k) {
    for (std::size_t j = 0; j < ny; ++j) {
      const double first = std::abs(y.gradient[j * width + k]);
      if (first < 0.5) continue;
      for (std::size_t row = j; row < y.rows; row += ny)
        most = std::max(most, std::abs(y.gradient[row * width + k]) / first);
    }
  }
  return most;
}

void halve_unstable(const Problem& p, Stretches& s, const std::string& record) {
  constexpr double most = 10.0;
  std::vector<double> values;
  for (const Coefficient& c : p.machine->coefficients) values.push_back(c.nominal);
  for (int round = 0; round < 4; ++round) {
    std::vector<Segment> segments;
    std::vector<Origin> origin;
    for (std::size_t k = 0; k < s.data.segments.size(); ++k) {
      const Segment& g = s.data.segments[k];
      const std::size_t n = g.samples();
      if (n < 4 * fewest_samples || growth(p, g, values, g.guess) < most) {
        segments.push_back(g);
        origin.push_back(s.origin[k]);
        continue;
      }
      for (const auto& [from, to] : {std::pair<std::size_t, std::size_t>{0, n / 2}, {n / 2, n}}) {
        segments.push_back(part_of(g, from, to, static_cast<std::size_t>(history / s.spacing)));
        const Segment& h = segments.back();
        origin.push_back({s.origin[k].experiment, s.origin[k].cycle, s.origin[k].row + from, h.t[h.first], h.t.back()});
      }
    }
    const bool done = segments.size() == s.data.segments.size();
    if (done) return;
    s.data.segments = std::move(segments);
    s.origin = std::move(origin);
    guess_starts_from_data(p, s.data, record);
  }
}

std::optional<Start> start_from_data(const Problem& p, const Segment& s, std::span<const double> values) {
  Start start = s.guess;
  start.x.assign(p.machine->free_coordinates(s.guess.chart).size(), 0.0);
  if (!start_from(p, s, values, fewest_samples, start)) return std::nullopt;
  const std::size_t n = s.samples();
  for (std::size_t samples = fewest_samples; samples < n;) {
    samples = std::min(2 * samples, n);
    Start longer = start;
    if (!start_from(p, s, values, samples, longer)) break;
    start = longer;
  }
  return start;
}

void guess_starts_from_data(const Problem& p, Data& data, const std::string& record) {
  const Machine& m = *p.machine;
  std::vector<double> values;
  for (const Coefficient& c : m.coefficients) values.push_back(c.nominal);
  for (Segment& s : data.segments) {
    const auto start = start_from_data(p, s, values);
    if (!start) {
      throw RecordError(record,
                        "the declared model cannot follow the first samples at t = " + std::to_string(s.t[s.first]),
                        "check --set, the units and the model");
    }
    s.guess = *start;
  }
  for (Segment& s : data.segments) {
    s.spread.clear();
    for (std::size_t k = 0; k < s.guess.x.size(); ++k) {
      double largest = 1e-3;
      for (const Segment& o : data.segments) {
        if (k < o.guess.x.size()) largest = std::max(largest, std::abs(o.guess.x[k]));
      }
      s.spread.push_back(largest);
    }
  }
}

}  // namespace saltus::diagnosis
