#include "setup.hpp"

#include <algorithm>
#include <cmath>

namespace saltus::diagnosis {

void guess_starts(const Problem& p, Data& data, const std::string& record) {
  const Machine& m = *p.machine;
  std::vector<double> values;
  for (const Coefficient& c : m.coefficients) values.push_back(c.nominal);
  const auto orbit = m.cycle(values, 60, data.sections);
  if (orbit.empty()) {
    throw RecordError(record,
                      "the declared model does not keep going: it leaves its charts or diverges before it settles",
                      "check --set and the model");
  }
  for (Segment& s : data.segments) {
    // From the orbit through what was applied before the segment.
    Course before{s.t, s.u, 0, p.h_max};
    const Start& start = orbit.front();
    before.t = before.t.first(s.first + 1);
    before.u = before.u.first((s.first + 1) * m.inputs.size());
    const Response r = m.values_only(values, before, start);
    s.guess = usable(r.status) ? r.end : start;
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
    // What lies further back no input of the segment remembers: keep enough for late ones.
    const std::size_t keep = std::min<std::size_t>(s.first, static_cast<std::size_t>(std::max(4, data.sections / 2)));
    const std::size_t drop = s.first - keep;
    s.t.erase(s.t.begin(), s.t.begin() + static_cast<std::ptrdiff_t>(drop));
    s.u.erase(s.u.begin(), s.u.begin() + static_cast<std::ptrdiff_t>(drop * m.inputs.size()));
    s.first = keep;
  }
}

double choose_step(const Problem& p) {
  const Data& data = *p.data;
  const Segment& s = data.segments.back();
  double spacing = 1e300;
  for (std::size_t i = s.first + 1; i < s.t.size(); ++i) spacing = std::min(spacing, s.t[i] - s.t[i - 1]);
  std::vector<double> values;
  for (const Coefficient& c : p.machine->coefficients) values.push_back(c.nominal);
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  double h = spacing;
  std::vector<double> coarse;
  for (int halvings = 0; halvings < 6; ++halvings) {
    const Response fine = p.machine->values_only(values, s.course(h), s.guess);
    if (!coarse.empty() && usable(fine.status)) {
      double sum = 0.0;
      for (std::size_t i = 0; i < fine.rows; ++i) {
        const auto row = static_cast<Eigen::Index>(i);
        const double d = (fine.y[i] - coarse[i]) / data.noise[row % ny];
        sum += d * d * s.count[row];
      }
      if (sum * static_cast<double>(data.segments.size()) < 0.05) return 2.0 * h;
    }
    coarse = fine.y;
    h *= 0.5;
  }
  return h;
}

}  // namespace saltus::diagnosis
