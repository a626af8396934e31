#include "plan.hpp"

#include <bit>
#include <map>
#include <numbers>
#include <stdexcept>

namespace saltus {
namespace {

[[noreturn]] void refuse(const std::string& why) { throw std::invalid_argument(why); }

}  // namespace

void set_quadrature(std::span<Multisine<max_tones>> experiments, int period) {
  std::map<int, double> first;
  for (Multisine<max_tones>& u : experiments) {
    Multisine<max_tones> turned(u.samples());
    for (int k = 0; k < u.tones(); ++k) {
      Tone t = u.tone(k);
      if (t.line == 0) {
        t.phase = 0.0;
      } else if (!identifiable(t.line, period)) {
        const auto [other, fresh] = first.emplace(t.line, t.phase);
        if (!fresh) t.phase = other->second + 0.5 * std::numbers::pi;
      }
      if (!turned.add(t)) return;  // not finite: not of a plan
    }
    u = turned;
  }
}

Multisine<max_tones> reversed(const Multisine<max_tones>& u) {
  Multisine<max_tones> r(u.samples());
  for (int k = 0; k < u.tones(); ++k) {
    const Tone& t = u.tone(k);
    if (!r.add({t.line, t.amplitude, t.phase + std::numbers::pi})) break;  // not finite
  }
  return r;
}

Multisine<max_tones> Plan::stimulus(std::size_t experiment, int input) const {
  const Multisine<max_tones>& u = experiments[experiment];
  const int play = static_cast<int>(experiment) / (options.opposed ? 2 : 1) % options.inputs;
  const auto j = static_cast<std::size_t>(input);
  const double share = j < options.share.size() ? options.share[j] : 1.0;
  const bool signs = std::has_single_bit(static_cast<unsigned>(options.inputs));
  const double turn = signs ? (std::popcount(static_cast<unsigned>(input & play)) % 2 != 0 ? 0.5 : 0.0)
                            : static_cast<double>(input * play % options.inputs) / options.inputs;
  Multisine<max_tones> r(u.samples());
  for (int k = 0; k < u.tones(); ++k) {
    Tone t = u.tone(k);
    t.amplitude *= share;
    if (signs || t.line != 0) {
      t.phase += 2.0 * std::numbers::pi * turn;
    } else if (play != input) {
      t.amplitude = 0.0;
    }
    if (!r.add(t)) break;  // not finite: not of a plan
  }
  return r;
}

std::vector<Multisine<max_tones>> repeated(const std::vector<Multisine<max_tones>>& stimuli, const PlanOptions& o) {
  if (o.inputs < 1 || o.inputs > most_inputs) {
    refuse("--inputs: an experiment has 1 to " + std::to_string(most_inputs) + " inputs");
  }
  if (o.share.size() > static_cast<std::size_t>(o.inputs)) refuse("--share: there are not so many inputs");
  for (const double part : o.share) {
    if (!(part > 0.0) || !std::isfinite(part)) refuse("--share: give positive numbers");
  }
  std::vector<Multisine<max_tones>> all;
  for (const auto& u : stimuli) {
    for (int play = 0; play < o.inputs; ++play) {
      all.push_back(u);
      if (o.opposed) all.push_back(reversed(u));
    }
  }
  return all;
}

Plan make_plan(const PlanOptions& o) {
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
  const auto too_many = [] {
    return "more than " + std::to_string(max_lines) + " lines lie in the band; lower one of them";
  };
  if (last > max_lines) refuse("--band, --period: " + too_many());
  const auto partition = std::make_unique<Partition<max_lines>>();
  if (o.subsets == 0) {
    if (!optimal_partition(last, o.period, *partition, o.half_multiples)) {
      refuse("--band, --period: " + (last < 1 ? "no line lies in the band" : too_many()));
    }
  } else if (!random_partition(last, o.period, o.subsets, o.seed, *partition, o.half_multiples)) {
    const Clique bound = largest_class(last, o.period, o.half_multiples);
    refuse("--subsets " + std::to_string(o.subsets) + ": give at least " + std::to_string(bound.size) + ", for " +
           std::to_string(bound.size) + " lines exclude one another, and no more than there are lines");
  }
  Plan plan{o, partition->bound, {}};
  std::vector<Multisine<max_tones>> stimuli;
  for (int s = 0; s < partition->subsets; ++s) {
    Multisine<max_tones> stimulus(o.sections * o.period);
    std::array<int, max_tones> lines{};
    const int n = partition->collect(s, lines);
    for (int k = 0; k < n; ++k) {
      if (k >= max_tones || !stimulus.add({lines[static_cast<std::size_t>(k)], o.amplitude, 0.0})) {
        refuse("--subsets: an experiment would have more than " + std::to_string(max_tones) + " tones; add --tones " +
               std::to_string(max_tones));
      }
    }
    Random random(o.seed, static_cast<std::uint64_t>(s) + 1);
    stimulus.randomise_phases(random);
    stimuli.push_back(stimulus);
  }
  if (o.half_multiples) set_quadrature(stimuli, o.period);
  plan.experiments = repeated(stimuli, o);
  return plan;
}

}  // namespace saltus
