#include "pieces.hpp"

#include <cmath>
#include <limits>

namespace saltus::diagnosis {
namespace {

// Where the machine is at every multiple of `length` samples, as far as a fit knows.
std::vector<Start> along(const Problem& p, const Segment& s, const std::vector<double>& values, Start start,
                         std::size_t length) {
  const std::size_t inputs = p.machine->inputs.size();
  std::vector<Start> r;
  for (std::size_t begin = 0; begin < s.samples(); begin += length) {
    r.push_back(start);
    if (begin + length >= s.samples()) break;
    const std::size_t at = s.first + begin;
    const Response on =
        p.machine->values_only(values,
                               Course{std::span(s.t).subspan(at, length + 1),
                                      std::span(s.u).subspan(at * inputs, (length + 1) * inputs), 0, p.h_max},
                               start);
    if (usable(on.status)) start = on.end;
  }
  return r;
}

}  // namespace

Fit fit_growing(const Problem& p, const std::vector<int>& segments, const Fit& from, const std::vector<int>& effects,
                const FitOptions& options, double hopeless) {
  const auto cycle = static_cast<std::size_t>(p.data->sections);
  Fit best = from;
  best.chi2 = std::numeric_limits<double>::infinity();
  std::vector<std::vector<Start>> starts;  // (segments)(pieces)
  std::size_t longest = 0;
  for (const int index : segments) {
    const Segment& s = p.data->segments[static_cast<std::size_t>(index)];
    starts.push_back(along(p, s, from.values, from.start[static_cast<std::size_t>(index)], cycle));
    longest = std::max(longest, s.samples());
  }
  for (std::size_t length = cycle;; length *= 2) {
    Data data;
    data.sections = p.data->sections;
    data.noise = p.data->noise;
    Fit f = best;
    f.start.clear();
    std::vector<int> all;
    for (std::size_t j = 0; j < segments.size(); ++j) {
      const Segment& s = p.data->segments[static_cast<std::size_t>(segments[j])];
      for (std::size_t k = 0; k < starts[j].size(); ++k) {
        const std::size_t begin = k * length, end = std::min(begin + length, s.samples());
        Segment piece = part_of(s, begin, end, s.first);
        piece.spread = s.spread;
        piece.guess = starts[j][k];
        f.start.push_back(piece.guess);
        all.push_back(static_cast<int>(data.segments.size()));
        data.segments.push_back(std::move(piece));
      }
    }
    Problem q = p;
    q.data = &data;
    f = fit(q, all, f, effects, options);
    if (!std::isfinite(f.chi2)) return best;
    if (f.chi2 > hopeless) {
      best.chi2 = std::numeric_limits<double>::infinity();
      return best;
    }
    // Of every two pieces the first one's start.
    std::size_t at = 0;
    for (std::size_t j = 0; j < segments.size(); ++j) {
      std::vector<Start> next;
      for (std::size_t k = 0; k < starts[j].size(); ++k, ++at) {
        if (k == 0) best.start[static_cast<std::size_t>(segments[j])] = f.start[at];
        if (k % 2 == 0) next.push_back(f.start[at]);
      }
      starts[j] = std::move(next);
    }
    best.values = f.values;
    best.chi2 = f.chi2;
    best.penalty = f.penalty;
    best.status = f.status;
    if (length >= longest) return best;
  }
}

}  // namespace saltus::diagnosis
