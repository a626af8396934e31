#include "significance.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "core/spectrum/noise.hpp"

namespace saltus {

std::vector<HarmonicTest> test_harmonics(const Identification& id, double level) {
  if (!id.noise_known()) return {};
  std::map<std::pair<int, int>, HarmonicTest> tests;
  std::map<std::pair<int, int>, double> freedom;
  for (const HtfEstimate& h : id.htf) {
    if (!(h.sigma > 0.0) || h.input != 0) continue;
    HarmonicTest& t = tests[{h.m, h.output}];
    t.m = h.m;
    t.output = h.output;
    ++t.lines;
    // The mean of 1 / sigma^2, known to so many degrees of freedom, is larger than it should be by as much.
    const double excess = h.freedom > 1.0 ? h.freedom / (h.freedom - 1.0) : 1.0;
    t.mean_square += std::norm(h.value) / (h.sigma * h.sigma * excess);
    t.norm += std::norm(h.value) - h.sigma * h.sigma;
    freedom[{h.m, h.output}] += std::max(0.0, static_cast<double>(h.cycles) / id.period - 1.0);
  }
  std::vector<HarmonicTest> r;
  for (auto& [key, t] : tests) {
    t.mean_square /= t.lines;
    t.norm = std::sqrt(std::max(0.0, t.norm / t.lines));
    t.chance = chance_of(t.mean_square, t.lines, std::max(1.0, freedom[key]));
    t.significant = t.chance < level / static_cast<double>(tests.size());
    r.push_back(t);
  }
  return r;
}

}  // namespace saltus
