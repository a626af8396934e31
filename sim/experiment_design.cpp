#include "experiment_design.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "core/spectrum/crest.hpp"

namespace saltus {
namespace {

constexpr int max_points = 65536;
using Reduction = CrestReduction<max_tones, max_points>;

// Points a sample: the highest line gets 13 a cycle at least, where they fit, which misses 3 % of a peak at most.
int oversampling(const Multisine<max_tones>& u) {
  int highest = 1;
  for (int k = 0; k < u.tones(); ++k) highest = std::max(highest, u.tone(k).line);
  const int wanted = (13 * highest + u.samples() - 1) / u.samples();
  return std::clamp(wanted, 1, std::max(1, max_points / u.samples()));
}

[[noreturn]] void refuse(const std::string& why) { throw std::invalid_argument(why); }

// The lines dealt into `subsets` experiments, no two of a class together; the sizes differ by one line at most.
std::vector<std::vector<int>> deal(const std::vector<int>& lines, int period, std::size_t subsets, Random& random) {
  std::vector<std::vector<int>> classes(static_cast<std::size_t>(period / 2 + 1));
  for (const int q : lines) classes[static_cast<std::size_t>(residue_class(q, period))].push_back(q);
  const auto shuffle = [&](auto& list) {
    for (std::size_t i = list.size(); i > 1; --i) std::swap(list[i - 1], list[random.uniform_int(i)]);
  };
  shuffle(classes);
  std::vector<std::vector<int>> dealt(subsets);
  std::size_t next = 0;
  for (auto& list : classes) {
    shuffle(list);
    for (const int q : list) dealt[next++ % subsets].push_back(q);  // a class is no larger than the subsets are many
  }
  for (auto& list : dealt) std::sort(list.begin(), list.end());
  return dealt;
}

Plan selected_plan(const PlanOptions& o, const DesignOptions& d) {
  int classes = (o.period - 1) / 2 - (d.odd ? (o.period / 2 - 1) / 2 : 0);
  if (o.half_multiples) classes += d.odd ? o.period / 2 % 2 : 2 - o.period % 2;
  if (d.odd && o.period % 2 != 0) refuse("--odd: an odd period has no parity to keep; give an even --period");
  if (d.detection > 0 && !d.odd) refuse("--detection: silent classes tell distortion in odd designs; add --odd");
  if (d.tones < 0 || d.detection < 0 || d.detection >= classes) {
    refuse("--tones, --detection: there are " + std::to_string(classes) + " classes of lines; leave at least one");
  }
  std::vector<int> lines;
  for (int q = o.half_multiples ? 0 : 1; q <= last_line_below(o.band, o.period); ++q) {
    if ((!o.half_multiples && !identifiable(q, o.period)) || (d.odd && q % 2 == 0)) continue;
    for (int play = 0; play < plays(q, o.period); ++play) lines.push_back(q);
  }
  if (lines.empty()) refuse("--band, --period: no line lies in the band");
  std::vector<int> size(static_cast<std::size_t>(o.period), 0);
  if (o.half_multiples && !d.odd) ++size[0];  // the machine's own cycle
  Clique bound;
  for (const int q : lines) {
    const int r = residue_class(q, o.period);
    const int n = ++size[static_cast<std::size_t>(r)];
    if (n > bound.size) bound = {r, n};
  }
  const int most = std::min({d.tones > 0 ? d.tones : max_tones, classes - d.detection, max_tones});
  const auto needed = (static_cast<int>(lines.size()) + most - 1) / most;
  const auto subsets = static_cast<std::size_t>(std::max({needed, bound.size, o.subsets}));
  if (subsets > lines.size()) refuse("--subsets: more experiments than there are lines");
  Random random(o.seed);
  Plan plan{o, bound, {}};
  std::uint64_t stream = 1;
  for (const auto& list : deal(lines, o.period, subsets, random)) {
    Multisine<max_tones> u(o.sections * o.period);
    for (const int q : list) {
      if (!u.add({q, o.amplitude, 0.0})) refuse("--amplitude: give a positive number");
    }
    Random phases(o.seed, stream++);
    u.randomise_phases(phases);
    plan.experiments.push_back(u);
  }
  if (o.half_multiples) set_quadrature(plan.experiments, o.period);
  return plan;
}

}  // namespace

double crest_between_samples(const Multisine<max_tones>& stimulus) {
  const auto fine = std::make_unique<Reduction>();
  const int factor = std::max(1, std::min(4 * oversampling(stimulus), max_points / stimulus.samples()));
  return fine->configure(stimulus.samples(), factor) ? fine->crest(stimulus) : 0.0;
}

Plan design_plan(const PlanOptions& options, const DesignOptions& d) {
  PlanOptions once = options;
  once.opposed = false;
  once.inputs = 1;
  once.share.clear();
  const bool selected = d.tones != 0 || d.odd || d.detection != 0;
  if (selected) once.half_multiples = false;
  Plan plan = make_plan(once);  // refuses what cannot be
  once.half_multiples = options.half_multiples;
  if (selected) plan = selected_plan(once, d);
  if (d.peak_limit > 0.0 && !std::has_single_bit(static_cast<unsigned>(options.inputs))) {
    refuse("--peak: every play has a peak of its own unless there are 1, 2, 4 or 8 inputs");
  }
  if (d.realisations < 1) refuse("--realisations: play the plan once at least");
  const std::vector<Multisine<max_tones>> base = plan.experiments;
  plan.options = options;
  plan.realisations = d.realisations;
  plan.experiments.clear();
  std::unique_ptr<Reduction> reduction;
  if (d.crest) reduction = std::make_unique<Reduction>();
  std::uint64_t stream = 0;
  for (int r = 0; r < d.realisations; ++r) {
    std::vector<Multisine<max_tones>> stimuli = base;
    for (Multisine<max_tones>& u : stimuli) {
      Random random(options.seed ^ 0xc2b2ae3d27d4eb4fu, ++stream);
      if (r > 0) u.randomise_phases(random);
      if (!d.crest) continue;
      if (!reduction->configure(u.samples(), oversampling(u))) {
        refuse("--crest: a stimulus period longer than " + std::to_string(max_points) + " samples; lower --period");
      }
      reduction->reduce(u, random);
    }
    if (options.half_multiples) set_quadrature(stimuli, options.period);
    for (Multisine<max_tones>& u : stimuli) {
      if (d.peak_limit > 0.0) {
        double square = 0.0;  // a cosine's is half that of a constant
        for (int k = 0; k < u.tones(); ++k) {
          const Tone& t = u.tone(k);
          square += (t.line == 0 ? 1.0 : 0.5) * t.amplitude * t.amplitude;
        }
        const double peak = crest_between_samples(u) * std::sqrt(square);
        const double factor = std::min(1.0, d.peak_limit / peak);
        if (!std::isfinite(factor)) refuse("--peak: give a positive number");
        u = scaled(u, factor);
      }
    }
    for (const auto& u : repeated(stimuli, options)) plan.experiments.push_back(u);
  }
  return plan;
}

}  // namespace saltus
