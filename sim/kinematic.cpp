#include "kinematic.hpp"

#include <map>

#include "format.hpp"

namespace saltus::rhythm {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using Index = Eigen::Index;

constexpr double back = 0.04;    // [turn] by which noise may turn a phase back
constexpr double jump = 0.15;    // [turn] across what rings about an event, beyond what the time makes of it
constexpr double mostly = 0.75;  // [-] of the turns must go round, and must pass a section
constexpr int fewest = 12;       // turns

// The turns of one phase.
struct Turns {
  std::vector<Visit> visits;
  std::vector<bool> good;                 // (visits) goes round in one direction
  int whole = 0, fallen = 0, jumped = 0;  // turns; of those the phase falls back in, or jumps in
  int sound() const { return whole - fallen - jumped; }
  std::vector<double> phase;   // (rows) [turn]
  std::vector<double> lasted;  // (whole turns) [s]
};

// One experiment without a gap: the phase unwrapped, cut where it passes whole turns.
void add_run(const Passages& w, std::size_t begin, std::size_t end, double pace, Turns& r) {
  const Record& record = *w.record;
  double turns = 0.0, top = -1e300;
  std::size_t last = end, reached = end;  // the row before, and that of the highest phase
  std::map<int, int> fallen, jumped;
  const auto first_visit = r.visits.size();
  const auto place = [](double x) { return static_cast<int>(std::floor(x)); };
  for (std::size_t i = begin; i < end; ++i) {
    if (!std::isfinite(r.phase[i])) continue;
    if (last == end) {
      turns = r.phase[i];
    } else {
      const double d = r.phase[i] - r.phase[last];
      double step = d - std::round(d);
      if (w.stay[i] != w.stay[last]) {  // as much as the time makes of it, give or take half a turn
        const double due = pace * (record.t[i] - record.t[last]);
        step += std::round(due - step);
        if (std::abs(step - due) > jump) ++jumped[place(turns + 0.5 * step)];
      }
      turns += step;
    }
    if (turns < top - back) {
      ++fallen[place(turns)];
      ++fallen[place(top)];
    }
    if (turns > top) {
      const double before = top;
      top = turns;
      if (reached == end || place(turns) > place(before)) {
        double when = record.t[i];
        if (reached != end) when -= (turns - place(turns)) / (turns - before) * (record.t[i] - record.t[reached]);
        if (r.visits.size() > first_visit) {
          r.visits.back().end = when;
          r.visits.back().rows = i - r.visits.back().first;
        }
        Visit v;
        v.first = i;
        v.begin = when;
        v.chart = place(turns);  // its number, until it is known whether it goes round
        r.visits.push_back(std::move(v));
      }
      reached = i;
    }
    last = i;
  }
  if (r.visits.size() == first_visit) return;
  r.visits.back().end = record.t[last];
  r.visits.back().rows = end - r.visits.back().first;
  for (std::size_t k = first_visit; k < r.visits.size(); ++k) {
    Visit& v = r.visits[k];
    const bool whole = k > first_visit && k + 1 < r.visits.size();
    const bool falls = fallen.count(v.chart) > 0, jumps = jumped.count(v.chart) > 0;
    r.good.push_back(!falls && !jumps);
    r.whole += whole;
    if (whole) r.lasted.push_back(v.end - v.begin);
    r.fallen += whole && falls;
    r.jumped += whole && !falls && jumps;
    if (k > first_visit && r.visits[k - 1].chart + 1 == v.chart) {
      v.previous = static_cast<int>(k) - 1;
      r.visits[k - 1].next = static_cast<int>(k);
    }
  }
  for (std::size_t k = first_visit; k < r.visits.size(); ++k) r.visits[k].chart = 0;
}

Turns turns_of(const Passages& w) {
  const Record& record = *w.record;
  Turns r;
  r.phase = phase_of(w, {record.t, w.y, w.stay});
  // How fast it goes round between events.
  double round = 0.0, time = 0.0;
  for (std::size_t i = 1; i < r.phase.size(); ++i) {
    if (w.stay[i] < 0 || w.stay[i] != w.stay[i - 1]) continue;
    const double d = r.phase[i] - r.phase[i - 1];
    if (!std::isfinite(d)) continue;
    round += d - std::round(d);
    time += record.t[i] - record.t[i - 1];
  }
  const double pace = time > 0.0 ? std::max(0.0, round / time) : 0.0;
  for (const Experiment& e : experiments(record)) {
    const std::size_t end = e.first_row + e.rows;
    for (std::size_t from = e.first_row; from < end;) {
      std::size_t to = from + 1;
      while (to < end && record.t[to] - record.t[to - 1] <= gap * w.spacing) ++to;
      add_run(w, from, to, pace, r);
      from = to;
    }
  }
  return r;
}

// A point inside the cycle of an output and its rate, and its size: the middle of where they mostly are, or, `usual`,
// their medians, for what rests now and then, or swings less and less.
PhasePlane plane_of(const Passages& w, std::size_t output, bool usual) {
  PhasePlane p;
  p.output = output;
  for (std::size_t b = 0; b < w.y.size(); ++b) {
    if (w.rate_of[b] == static_cast<int>(output)) p.rate = static_cast<int>(b);
  }
  std::vector<double> values, rates;
  for (std::size_t i = 2; i + 2 < w.stay.size(); ++i) {
    if (w.stay[i] < 0 || w.stay[i - 2] != w.stay[i] || w.stay[i + 2] != w.stay[i]) continue;
    const double rate = p.rate >= 0
                            ? w.y[static_cast<std::size_t>(p.rate)][i]
                            : (w.y[output][i + 2] - w.y[output][i - 2]) / (w.record->t[i + 2] - w.record->t[i - 2]);
    if (!std::isfinite(rate) || !std::isfinite(w.y[output][i])) continue;
    values.push_back(w.y[output][i]);
    rates.push_back(rate);
  }
  if (values.empty()) return p;
  const auto span = [&](const std::vector<double>& v, double& middle, double& half) {
    const double low = quantile(v, 0.05), high = quantile(v, 0.95);
    middle = usual ? median(v) : 0.5 * (low + high);
    half = std::max(0.5 * (high - low), 1e-300);
  };
  span(values, p.o_p, p.s_p);
  span(rates, p.o_v, p.s_v);
  return p;
}

// [s] from event to the same event, 0 where none are marked.
double period_of_events(const Passages& w) {
  std::vector<double> r;
  if (w.record->cycle.empty() && w.record->chart_names.size() < 2) return 0.0;
  for (const Visit& v : w.visits) {
    const Visit* last = &v;
    for (std::size_t c = 1; c < w.order.size() && last != nullptr; ++c)
      last = last->next < 0 ? nullptr : &w.visits[static_cast<std::size_t>(last->next)];
    if (last != nullptr && v.previous >= 0 && last->next >= 0) r.push_back(last->end - v.begin);
  }
  return median(r);
}

// Why the angle of this output is no phase; empty where it is one.
std::string unfit(const Turns& t, double cycle, const std::string& name) {
  if (t.whole < fewest) return format("that of %s goes round %d times", name.c_str(), t.whole);
  if (t.sound() < mostly * t.whole) {
    return format("of the %d turns of %s it falls back in %d and jumps at the events in %d", t.whole, name.c_str(),
                  t.fallen, t.jumped);
  }
  const double cycles = cycle > 0.0 ? median(t.lasted) / cycle : 1.0;
  if (std::abs(cycles - std::max(1.0, std::round(cycles))) < 0.1) return {};
  return format("that of %s takes %.2f cycles between events for a turn", name.c_str(), cycles);
}

}  // namespace

Passages find_turns(const Record& record, const RhythmOptions& o, MatrixXd& noise, VectorXd& count, Rhythm& r) {
  Passages w;
  w.record = &record;
  if (record.rows() < 100 || record.outputs.empty())
    throw RecordError(record.name, "it has hardly any data", "record for longer");
  for (const Channel& c : record.outputs) w.y.push_back(c.values);
  find_visits(w, o.exclude, false);
  find_rates(w);
  const double cycle = period_of_events(w);
  std::string why;
  Turns best;
  std::optional<PhasePlane> chosen;
  for (std::size_t output = 0; output < w.y.size(); ++output) {
    if (w.rate_of[output] >= 0 || (o.plane.size() == 4 && output > 0)) continue;
    Turns turns;
    PhasePlane plane;
    for (const bool usual : {false, true}) {
      w.plane = plane_of(w, output, usual);
      if (o.plane.size() == 4) {
        w.plane->o_p = o.plane[0];
        w.plane->o_v = o.plane[1];
        w.plane->s_p = o.plane[2];
        w.plane->s_v = o.plane[3];
      }
      Turns t = turns_of(w);
      if (usual && t.sound() <= turns.sound()) continue;
      turns = std::move(t);
      plane = *w.plane;
    }
    if (const std::string no = unfit(turns, cycle, record.outputs[output].name); !no.empty()) {
      why += (why.empty() ? "" : "; ") + no;
      continue;
    }
    if (chosen && turns.sound() * best.whole <= best.sound() * turns.whole) continue;
    best = std::move(turns);
    chosen = plane;
  }
  if (!chosen) {
    throw RecordError(record.name, "no output has a phase that goes round: " + why,
                      o.plane.size() == 4 ? "choose another point, --kinematic, or leave it out"
                                          : "record one that swings about a point; a phase that jumps is none");
  }
  w.plane = chosen;
  w.visits = best.visits;
  w.order = {0};
  r.turns_refused = best.fallen + best.jumped;
  const PhasePlane& p = *w.plane;
  const Channel& c = record.outputs[p.output];
  r.plane = format("%s about %.3g %s and %.3g %s/s, scaled by %.3g and %.3g", c.name.c_str(), p.o_p, c.unit.c_str(),
                   p.o_v, c.unit.c_str(), p.s_p, p.s_v);
  if (r.turns_refused > 0) {
    r.notes.push_back(
        format("In %d of %d turns the phase falls back, or jumps; they are not used.", r.turns_refused, best.whole));
  }
  // Half a section off the turning points, where machines have their events.
  w.per_chart = std::max(4, 2 * o.sections);
  for (int j = 0; j < w.per_chart; ++j) w.level.push_back((j + 0.5) / w.per_chart);
  name_coordinates(w, r);
  const Samples samples{record.t, w.y, w.stay};
  const auto locate_all = [&] {
    noise = MatrixXd::Zero(w.per_chart, w.dim);
    count = VectorXd::Zero(w.per_chart);
    for (std::size_t k = 0; k < w.visits.size(); ++k) {
      Visit& v = w.visits[k];
      if (best.good[k]) {
        pass(w, samples, best.phase, v, noise, count);
      } else {
        v.x.assign(at(w.per_chart), {});
        v.when.assign(v.x.size(), std::nan(""));
        v.input = v.when;
      }
    }
  };
  locate_all();
  // Those that lie where the structure rings are passed unseen.
  std::vector<double> seen;
  std::string unseen;
  for (int j = 0; j < w.per_chart; ++j) {
    if (count[j] >= mostly * count.maxCoeff()) {
      seen.push_back(w.level[at(j)]);
    } else {
      unseen += (unseen.empty() ? "" : ", ") + format("%.3f", w.level[at(j)]);
    }
  }
  if (seen.size() < 3) {
    throw RecordError(record.name, "its phase passes all but " + std::to_string(seen.size()) + " sections unseen",
                      "sample faster");
  }
  if (!unseen.empty()) {
    r.notes.push_back("Sections at phase " + unseen + " are left out: most of their passages lie about an event.");
    w.level = seen;
    w.per_chart = static_cast<int>(seen.size());
    locate_all();
  }
  add_inputs(w);
  return w;
}

}  // namespace saltus::rhythm
