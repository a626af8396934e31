#include "plan.hpp"

#include <stdexcept>

namespace saltus {

Plan make_plan(const PlanOptions& o) {
  const auto refuse = [](const std::string& why) { throw std::invalid_argument(why); };
  if (o.period < 3 || o.period > 2 * max_tones) {
    refuse("--period " + std::to_string(o.period) + ": a stimulus repeats after 3 to " + std::to_string(2 * max_tones) +
           " cycles");
  }
  if (!(o.band > 0.0) || o.band > 0.5 * o.sections) {
    refuse("--band: lines lie between 0 and half the sections a cycle, " + std::to_string(o.sections / 2) +
           " cycles a cycle");
  }
  if (!(o.amplitude > 0.0) || !std::isfinite(o.amplitude)) refuse("--amplitude: give a positive number");
  const int last = last_line_below(o.band, o.period);
  if (last > max_lines) {
    refuse("--band, --period: more than " + std::to_string(max_lines) + " lines lie in the band; lower one of them");
  }
  const auto partition = std::make_unique<Partition<max_lines>>();
  if (o.subsets == 0) {
    if (!optimal_partition(last, o.period, *partition)) refuse("--band, --period: no line lies in the band");
  } else if (!random_partition(last, o.period, o.subsets, o.seed, *partition)) {
    const Clique bound = largest_class(last, o.period);
    refuse("--subsets " + std::to_string(o.subsets) + ": give at least " + std::to_string(bound.size) + ", for " +
           std::to_string(bound.size) + " lines exclude one another, and no more than there are lines");
  }
  Plan plan{o, partition->bound, {}};
  for (int s = 0; s < partition->subsets; ++s) {
    Multisine<max_tones> stimulus(o.sections * o.period);
    std::array<int, max_tones> lines{};
    const int n = partition->collect(s, lines);
    for (int k = 0; k < n; ++k) {
      if (k >= max_tones || !stimulus.add({lines[static_cast<std::size_t>(k)], o.amplitude, 0.0})) {
        refuse("--subsets: an experiment would have more than " + std::to_string(max_tones) + " tones");
      }
    }
    Random random(o.seed, static_cast<std::uint64_t>(s) + 1);
    stimulus.randomise_phases(random);
    plan.experiments.push_back(stimulus);
    if (!o.opposed) continue;
    Multisine<max_tones> reversed(stimulus.samples());
    for (int k = 0; k < stimulus.tones(); ++k) {
      const Tone& t = stimulus.tone(k);
      if (!reversed.add({t.line, t.amplitude, t.phase + std::numbers::pi})) refuse("--opposed: too many tones");
    }
    plan.experiments.push_back(reversed);
  }
  return plan;
}

}  // namespace saltus
