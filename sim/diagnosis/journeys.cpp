#include "journeys.hpp"

#include <algorithm>
#include <cmath>

#include "stretches.hpp"

namespace saltus::diagnosis {
namespace {

using namespace rhythm;
using Eigen::VectorXd;
using Index = Eigen::Index;

constexpr double history = 0.25;  // [s] of input kept from before a run, for inputs that act late
constexpr double longer = 0.25;   // [-] of the time that the machine took: how much later the model may be

class Runner {
 public:
  Runner(const Layout& layout, const Machine& machine, std::span<const double> values)
      : w_(layout.passages), record_(*w_.record), machine_(machine), values_(values.begin(), values.end()) {
    if (machine.has_clock) {
      throw RecordError(record_.name, "a clock paces " + machine.name, "name the model that the record is of");
    }
    charts_ = charts_of(record_, machine);
    in_ = columns_of(record_, machine, false);
    data_.noise = VectorXd::Ones(static_cast<Index>(machine.outputs.size()));
    for (const saltus::Channel& c : record_.outputs) {
      const auto same = std::find_if(machine.outputs.begin(), machine.outputs.end(),
                                     [&](const Channel& own) { return own.name == c.name; });
      if (same == machine.outputs.end()) {
        throw RecordError(record_.name, machine.name + " has no output '" + c.name + "'",
                          "leave it out of `# outputs`");
      }
      output_.push_back(static_cast<int>(same - machine.outputs.begin()));
      data_.noise[output_.back()] = noise_of(c.values);
    }
    problem_.machine = &machine;
    problem_.data = &data_;
    problem_.h_max = 1.2 * w_.spacing;  // a step a sample, as in a diagnosis
  }

  Journey from(const Visit& v, int j) const {
    const double begin = v.when[at(j)];
    const Place next = from_here(w_, v, j, 1), step = from_here(w_, v, j, w_.per_chart);
    if (next.x() == nullptr && step.x() == nullptr) return {};
    const double soon = next.x() != nullptr ? next.visit->when[at(next.j)] : begin;
    const double late = step.x() != nullptr ? step.visit->when[at(step.j)] : soon;
    const double window = static_cast<double>(half_window + 1) * w_.spacing;
    // As long as it may take; where the model does not last so long, for as long as it has to.
    const double margin = window + static_cast<double>(w_.ringing) * w_.spacing + longer * (late - begin);
    Journey r;
    for (const double until : {late + margin, late + window, soon + window}) {
      if (run(v, j, begin, until, soon, late, r)) return r;
    }
    return r;
  }

 private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  bool joined(std::size_t i) const {  // to the row before
    return record_.experiment[i] == record_.experiment[i - 1] && record_.t[i] - record_.t[i - 1] <= gap * w_.spacing;
  }

  // Of one measurement, by how far it lies off the straight line between its neighbours.
  double noise_of(const std::vector<double>& y) const {
    std::vector<double> off;
    for (std::size_t i = 1; i + 1 < y.size(); ++i) {
      if (w_.stay[i] < 0 || w_.stay[i - 1] != w_.stay[i] || w_.stay[i + 1] != w_.stay[i]) continue;
      const double d = y[i] - 0.5 * (y[i - 1] + y[i + 1]);
      if (std::isfinite(d)) off.push_back(std::abs(d) / std::sqrt(1.5));
    }
    return std::max({median(off) / 0.6744897501960817, resolution_of(y) / std::sqrt(12.0), 1e-12});
  }

  // False where the model does not last until then.
  bool run(const Visit& v, int j, double begin, double until, double soon, double late, Journey& r) const {
    const auto first = record_.t.begin() + static_cast<std::ptrdiff_t>(v.first);
    auto centre = static_cast<std::size_t>(
        std::lower_bound(first, first + static_cast<std::ptrdiff_t>(v.rows) - 1, begin - 0.5 * w_.spacing) -
        record_.t.begin());
    while (w_.stay[centre] < 0 && centre + 1 < v.first + v.rows) ++centre;
    std::size_t from = centre, to = centre + 1, back = 0, end = 0;
    const auto window = static_cast<std::size_t>(half_window);
    while (from > 0 && centre - from < window && w_.stay[from - 1] == w_.stay[centre]) --from;
    while (to < record_.rows() && to - centre <= window && w_.stay[to] == w_.stay[centre]) ++to;
    for (back = from; back > 0 && joined(back) && record_.t[from] - record_.t[back - 1] <= history;) --back;
    for (end = to; end < record_.rows() && joined(end) && record_.t[end] <= until;) ++end;

    const std::size_t ny = machine_.outputs.size();
    Segment s;
    s.first = from - back;
    s.guess.chart = record_.chart.empty() ? 0 : charts_[at(std::max(0, record_.chart[centre]))];
    for (std::size_t i = back; i < end; ++i) {
      s.t.push_back(record_.t[i]);
      for (const std::size_t c : in_) {
        const double u = record_.inputs[c].values[i];
        s.u.push_back(std::isfinite(u) ? u : s.u.size() >= in_.size() ? s.u[s.u.size() - in_.size()] : 0.0);
      }
    }
    s.y = s.count = VectorXd::Zero(static_cast<Index>((to - from) * ny));
    for (std::size_t i = from; i < to; ++i) {
      for (std::size_t o = 0; o < output_.size(); ++o) {
        const double y = record_.outputs[o].values[i];
        if (!std::isfinite(y)) continue;
        const auto row = static_cast<Index>((i - from) * ny + at(output_[o]));
        s.y[row] = y;
        s.count[row] = 1.0;
      }
    }
    Start start = s.guess;
    start.x.assign(machine_.free_coordinates(start.chart).size(), 0.0);
    if (!start_from(problem_, s, values_, to - from, start)) return false;
    const Response y = machine_.values_only(values_, s.course(problem_.h_max), start);
    if (!usable(y.status)) return false;

    const std::size_t n = s.samples();
    const std::vector<double> t(s.t.begin() + static_cast<std::ptrdiff_t>(s.first), s.t.end());
    std::vector<std::vector<double>> outputs(output_.size());
    for (std::size_t o = 0; o < output_.size(); ++o) {
      for (std::size_t i = 0; i < n; ++i) outputs[o].push_back(y.y[i * ny + at(output_[o])]);
    }
    const auto event = events(s, start, y.events);
    std::vector<int> stay(n, 0);
    for (std::size_t k = 0; k < event.size(); ++k) {
      for (std::size_t i = event[k]; i < n; ++i) stay[i] = static_cast<int>(k) + 1;
    }
    for (const std::size_t e : event) {
      for (std::size_t i = e - std::min(e, w_.ringing); i < std::min(n, e + w_.ringing); ++i) stay[i] = -1;
    }
    const Samples samples{t, outputs, stay};
    const std::vector<double> phase = phase_of(w_, samples);
    const auto passes = [&](int section, int events_before, double after, double before) {
      std::size_t a = 0, b = n;
      if (!w_.plane) {
        const auto k = at(events_before);
        if (k > event.size()) return std::optional<Located>{};
        a = k == 0 ? 0 : event[k - 1];
        b = k < event.size() ? event[k] : n;
      } else {
        while (a < n && t[a] < after) ++a;
        while (b > a && t[b - 1] > before) --b;
      }
      if (b < a + 2) return std::optional<Located>{};
      return locate(w_, samples, phase, a, b - a, section);
    };
    const int chart = w_.place(v);
    const auto here = passes(chart + j, 0, t.front(), begin + 0.4 * std::max(soon - begin, 0.2 * (late - begin)));
    if (!here) return false;
    r.x = here->x;
    const bool over = j + 1 == w_.per_chart;
    const int following = (chart + w_.per_chart) % w_.sections();
    const double turn = std::max(late - begin, 2.0 * (soon - begin));
    const auto next =
        passes(over ? following : chart + j + 1, over ? 1 : 0, begin + 0.5 * (soon - begin), soon + 0.4 * turn);
    if (next) {
      r.next = next->x;
      r.lasted = next->when - here->when;
    }
    const auto step = passes(following + j, 1, begin + 0.5 * turn, late + 0.4 * turn);
    if (step && late > soon) r.step = step->x;
    return true;
  }

  // The first samples after the events of a run, of two at most.
  std::vector<std::size_t> events(const Segment& s, const Start& start, std::int64_t count) const {
    std::vector<std::size_t> r;
    for (std::int64_t k = 1; k <= std::min<std::int64_t>(count, 2); ++k) {
      std::size_t before = 0, after = s.samples() - 1;  // at sample `after` it has happened
      while (after - before > 1) {
        const std::size_t middle = (before + after) / 2, n = s.first + middle + 1;
        const Course part{std::span(s.t).first(n), std::span(s.u).first(n * in_.size()), s.first, problem_.h_max};
        (machine_.values_only(values_, part, start).events >= k ? after : before) = middle;
      }
      r.push_back(after);
    }
    return r;
  }

  const Passages& w_;
  const Record& record_;
  const Machine& machine_;
  std::vector<double> values_;
  Data data_;  // no more of it than the noise: how outputs weigh against each other in a start
  Problem problem_;
  std::vector<int> charts_, output_;  // of the machine, for each of the record
  std::vector<std::size_t> in_;
};

}  // namespace

std::vector<std::vector<Journey>> journeys_of(const Layout& layout, const Machine& machine,
                                              std::span<const double> values) {
  const Passages& w = layout.passages;
  const Runner runner(layout, machine, values);
  std::vector<std::vector<Journey>> r(w.visits.size());
  for (std::size_t i = 0; i < w.visits.size(); ++i) {
    const Visit& v = w.visits[i];
    r[i].resize(static_cast<std::size_t>(w.per_chart));
    for (int j = 0; j < w.per_chart && !v.x.empty(); ++j) {
      if (v.x[static_cast<std::size_t>(j)].size() > 0) r[i][static_cast<std::size_t>(j)] = runner.from(v, j);
    }
  }
  return r;
}

}  // namespace saltus::diagnosis
