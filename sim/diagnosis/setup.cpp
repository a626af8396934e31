#include "setup.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace saltus::diagnosis {
namespace {

constexpr int settling = 60;  // [turn] to the orbit

// From the orbit through what was applied before the segment, whose first section is that of the clock's zero.
Start through_history(const Problem& p, const std::vector<double>& values, const std::vector<Start>& orbit,
                      const Segment& s) {
  const Machine& m = *p.machine;
  const std::size_t N = orbit.size();
  const Start& start = orbit[(N - s.first % N) % N];
  const Course before{std::span(s.t).first(s.first + 1), std::span(s.u).first((s.first + 1) * m.inputs.size()), 0,
                      p.h_max};
  const Response r = m.values_only(values, before, start);
  return usable(r.status) ? r.end : orbit.front();
}

}  // namespace

bool settle_starts(const Problem& p, Fit& f) {
  const auto orbit = p.machine->cycle(f.values, settling, p.data->sections);
  if (orbit.empty()) return false;
  for (std::size_t k = 0; k < f.start.size(); ++k)
    f.start[k] = through_history(p, f.values, orbit, p.data->segments[k]);
  return true;
}

void guess_starts(const Problem& p, Data& data, const std::string& record) {
  const Machine& m = *p.machine;
  std::vector<double> values;
  for (const Coefficient& c : m.coefficients) values.push_back(c.nominal);
  const auto orbit = m.cycle(values, settling, data.sections);
  if (orbit.empty()) {
    throw RecordError(record,
                      "the declared model does not keep going: it leaves its charts or diverges before it settles",
                      "check --set and the model");
  }
  for (Segment& s : data.segments) {
    s.guess = through_history(p, values, orbit, s);
    s.spread.clear();
    for (const int c : m.free_coordinates(s.guess.chart)) {
      double low = 1e300, high = -1e300;
      for (const Start& o : orbit) {
        if (o.chart != s.guess.chart) continue;
        low = std::min(low, o.x[static_cast<std::size_t>(c)]);
        high = std::max(high, o.x[static_cast<std::size_t>(c)]);
      }
      s.spread.push_back(std::max(1e-6, 0.5 * (high - low)));
    }
    // What lies further back no input of the segment remembers: a lag is a quarter of a cycle at most, and has
    // forgotten all but a hundred-thousandth of it.
    constexpr int remembered = 3;  // [cycle]
    const auto keep = std::min(s.first, static_cast<std::size_t>(remembered * data.sections));
    const std::size_t drop = s.first - keep;
    s.t.erase(s.t.begin(), s.t.begin() + static_cast<std::ptrdiff_t>(drop));
    s.u.erase(s.u.begin(), s.u.begin() + static_cast<std::ptrdiff_t>(drop * m.inputs.size()));
    s.first = keep;
  }
}

namespace {

// What the outputs of the last segment change by with steps half as long, as chi squared of all segments.
double change(const Problem& p, const Response& fine, const Response& coarse) {
  const Data& data = *p.data;
  const Segment& s = data.segments.back();
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  double sum = 0.0;
  for (std::size_t i = 0; i < fine.rows; ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    const double d = (fine.y[i] - coarse.y[i]) / data.noise[row % ny];
    sum += d * d * s.count[row];
  }
  return sum * static_cast<double>(data.segments.size());
}

// The last segment, from a fit's start, by steps of h [s].
Response run_last(const Problem& p, const Fit& f, double h) {
  return p.machine->values_only(f.values, p.data->segments.back().course(h), f.start.back());
}

constexpr int most_halvings = 6;  // of the spacing of samples, however far off a step of it may be

// [s] The least spacing of the last segment's samples.
double spacing_of_last(const Problem& p) {
  const Segment& s = p.data->segments.back();
  double spacing = std::numeric_limits<double>::infinity();
  for (std::size_t i = s.first + 1; i < s.t.size(); ++i) spacing = std::min(spacing, s.t[i] - s.t[i - 1]);
  return spacing;
}

}  // namespace

double choose_step(const Problem& p, const Fit& f, double trifle) {
  double h = spacing_of_last(p);
  Response coarse = run_last(p, f, h);
  for (int halvings = 1; halvings < most_halvings; ++halvings) {
    h *= 0.5;
    Response fine = run_last(p, f, h);
    if (usable(fine.status) && change(p, fine, coarse) < trifle) return 2.0 * h;
    coarse = std::move(fine);
  }
  return 0.5 * h;
}

double finer_step(const Problem& p, const Fit& f) {
  // [-] of chi squared, and of what the fit leaves of it over the noise: where much is left steps are not what is
  // amiss.
  constexpr double told = 1.0, little = 0.3, of_left = 0.05;
  if (p.h_max <= std::ldexp(spacing_of_last(p), -most_halvings)) return p.h_max;
  const Response fine = run_last(p, f, 0.5 * p.h_max), coarse = run_last(p, f, p.h_max);
  const double much = std::max(told, of_left * (f.chi2 - p.data->measured()));
  const bool fails = usable(fine.status) && usable(coarse.status) && change(p, fine, coarse) > much;
  return fails ? std::min(choose_step(p, f, little), 0.5 * p.h_max) : p.h_max;
}

}  // namespace saltus::diagnosis
