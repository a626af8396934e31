#include "identification.hpp"

#include <algorithm>
#include <cstdio>

namespace saltus {
namespace {

// Output lines alias: f and -f, and f + N, are one frequency of a real signal sampled N times a cycle.
double folded(double f, int sections) {
  const double n = sections;
  f = std::abs(std::remainder(f, n));
  return std::min(f, n - f);
}

}  // namespace

void LineNoise::add(int output, double frequency, double variance, std::int64_t periods) {
  const auto c = static_cast<std::size_t>(output);
  if (entries_.size() <= c) entries_.resize(c + 1);
  const auto freedom = static_cast<double>(periods - 1);
  entries_[c].push_back({frequency, variance * freedom, freedom});
}

void LineNoise::append(const LineNoise& more) {
  if (entries_.size() < more.entries_.size()) entries_.resize(more.entries_.size());
  for (std::size_t c = 0; c < more.entries_.size(); ++c) {
    entries_[c].insert(entries_[c].end(), more.entries_[c].begin(), more.entries_[c].end());
  }
  classes.append(more.classes);
}

void LineNoise::sort(int sections) {
  for (auto& list : entries_) {
    for (Entry& e : list) e.frequency = folded(e.frequency, sections);
    std::sort(list.begin(), list.end(), [](const Entry& a, const Entry& b) { return a.frequency < b.frequency; });
  }
}

LineNoise::Pooled LineNoise::pooled(int output, double frequency, int sections) const {
  // Complex degrees of freedom: a standard error good to 7 %, from so few lines that the peaks of noise which went
  // through the machine, a tenth of a cycle wide, are not flattened.
  constexpr double wanted = 48.0;
  const auto c = static_cast<std::size_t>(output);
  if (c >= entries_.size() || entries_[c].empty()) return {std::numeric_limits<double>::quiet_NaN(), 0.0};
  const auto& list = entries_[c];
  const double f = folded(frequency, sections);
  auto hi = static_cast<std::size_t>(
      std::lower_bound(list.begin(), list.end(), f, [](const Entry& e, double x) { return e.frequency < x; }) -
      list.begin());
  std::size_t lo = hi;
  for (double held = 0.0; held < wanted && hi - lo < list.size();) {  // the nearest lines on either side
    const bool down = hi == list.size() || (lo > 0 && f - list[lo - 1].frequency <= list[hi].frequency - f);
    held += down ? list[--lo].freedom : list[hi++].freedom;
  }
  // All of a frequency or none: the order in which experiments come decides nothing.
  while (lo > 0 && list[lo - 1].frequency == list[lo].frequency) --lo;
  while (hi < list.size() && list[hi - 1].frequency == list[hi].frequency) ++hi;
  double sum = 0.0, freedom = 0.0;
  for (std::size_t i = lo; i < hi; ++i) {
    sum += list[i].sum;
    freedom += list[i].freedom;
  }
  return {freedom > 0.0 ? sum / freedom : std::numeric_limits<double>::quiet_NaN(), freedom};
}

std::string Drift::story() const {
  char text[256];
  if (output.empty()) {
    std::snprintf(text, sizeof text, "experiment %d, cycle %lld: the residual scatters more than the noise does",
                  experiment, static_cast<long long>(cycle));
  } else {
    std::snprintf(text, sizeof text,
                  "experiment %d, cycle %lld: %s is off in %s, at phase %.2f of the cycle (%.1f standard deviations)",
                  experiment, static_cast<long long>(cycle), output.c_str(), chart.c_str(), phase, z);
  }
  return text;
}

std::vector<HtfEstimate> Identification::select(int m, int output, int input) const {
  std::vector<HtfEstimate> r;
  for (const HtfEstimate& h : htf) {
    if (h.m == m && h.output == output && h.input == input) r.push_back(h);
  }
  return r;
}

const ClassCorrelation* Identification::correlation(int line) const {
  const auto at = std::lower_bound(classes.begin(), classes.end(), line,
                                   [](const ClassCorrelation& c, int wanted) { return c.line < wanted; });
  return at != classes.end() && at->line == line && at->freedom > 0.0 ? &*at : nullptr;
}

void finish(Identification& id, LineNoise& noise) {
  noise.sort(id.sections);
  for (HtfEstimate& h : id.htf) {
    const double f = static_cast<double>(h.line) / id.period + h.m;
    const LineNoise::Pooled pooled = noise.pooled(h.output, f, id.sections);
    h.sigma *= std::sqrt(pooled.variance);
    h.freedom = pooled.freedom;
  }
  const auto key = [](const HtfEstimate& h) { return std::array{h.m, h.line, h.output, h.input}; };
  std::stable_sort(id.htf.begin(), id.htf.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
  // A line played in several experiments: one estimate, by inverse variance, or by cycles where there is no noise.
  std::vector<HtfEstimate> merged;
  for (std::size_t i = 0; i < id.htf.size();) {
    HtfEstimate sum = id.htf[i];
    sum.value = 0.0;
    sum.cycles = 0;
    double weights = 0.0;
    bool known = true;
    std::size_t j = i;
    for (; j < id.htf.size() && key(id.htf[j]) == key(id.htf[i]); ++j) {
      known = known && std::isfinite(id.htf[j].sigma) && id.htf[j].sigma > 0.0;
    }
    for (; i < j; ++i) {
      const HtfEstimate& h = id.htf[i];
      const double w = known ? 1.0 / (h.sigma * h.sigma) : h.cycles;
      weights += w;
      sum.value += w * h.value;
      sum.cycles += h.cycles;
    }
    sum.value /= weights;
    if (known) sum.sigma = 1.0 / std::sqrt(weights);
    merged.push_back(sum);
  }
  id.htf = std::move(merged);
  id.classes.clear();
  for (const HtfEstimate& h : id.htf) {  // by rising line under each harmonic and output
    if (noise.classes.empty() || h.m != id.htf.front().m) break;
    if (!identifiable(h.line, id.period)) continue;
    if (id.classes.empty() || id.classes.back().line != h.line) id.classes.push_back(noise.classes.correlation(h.line));
  }
}

}  // namespace saltus
