#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "../format.hpp"
#include "story.hpp"

namespace saltus::diagnosis {
namespace {

// Angles are told in degrees.
double told(double x, const std::string& unit) { return unit.substr(0, 3) == "rad" ? x * 180.0 / std::numbers::pi : x; }
std::string told_unit(const std::string& unit) { return unit.substr(0, 3) == "rad" ? "deg" + unit.substr(3) : unit; }

// The outputs a reader is told of: where there are many, those that the declared model predicts worst, in its noise.
std::vector<std::size_t> outputs_to_tell(const Diagnosis& d, const FreeRun& f) {
  constexpr std::size_t most = 3;
  std::vector<std::size_t> r(f.after.size());
  for (std::size_t j = 0; j < r.size(); ++j) r[j] = j;
  if (r.size() <= most) return r;
  const auto off = [&](std::size_t j) { return f.before[j] / d.noise[j]; };
  std::stable_sort(r.begin(), r.end(), [&](std::size_t a, std::size_t b) { return off(a) > off(b); });
  r.resize(most);
  std::sort(r.begin(), r.end());
  return r;
}

}  // namespace

void tell_self_paced(Diagnosis& d) {
  auto& s = d.story;
  const SelfPaced& q = d.self_paced;
  s.push_back(
      format("%s against %s: %d experiment%s cut into %d stretches of about %.3g s, each with its own unknown start; "
             "%d fitted.",
             d.record.c_str(), d.model.c_str(), d.experiments, d.experiments == 1 ? "" : "s", q.stretches, q.stretch,
             q.fitted));
  s.push_back(verdict_sentence(d));
  for (const Finding& f : d.effects) {
    const std::string tie = listed(f.ties);
    s.push_back(format("  %s = %.4g%s, 95 %% in [%.4g, %.4g]%s%s.", f.name.c_str(), f.value,
                       after_number(f.unit).c_str(), f.low, f.high, tie.empty() ? "" : "; could as well be ",
                       tie.c_str()));
  }
  for (const Step& t : q.steps) {
    std::string beside;
    for (const auto& b : t.beside) beside += (beside.empty() ? " beside " : ", ") + b;
    s.push_back(
        format("  %s%s: the residual's likelihood gains %.0f; fitted on part of the data it leaves %.0f %% of the "
               "error of predicting the "
               "rest, better on %d of %d parts%s%s.",
               t.effect.c_str(), beside.c_str(), t.gain, 100.0 * t.predicted, t.better, t.parts,
               t.instead.empty() ? ""
                                 : format("; its free runs over the fitted part are off by %.0f %% of what they are "
                                          "with %s",
                                          100.0 * t.free_run, t.instead.c_str())
                                       .c_str(),
               t.taken ? "" : ": not claimed"));
  }
  for (const FreeRun& f : q.runs) {
    const auto outputs = outputs_to_tell(d, f);
    if (outputs.size() < f.after.size() && f.data != q.runs.front().data) continue;
    for (const std::size_t j : outputs) {
      const std::string& u = d.output_units[j];
      s.push_back(format(
          "Free runs of %.3g s, %s (%d%s): %s off by %.3g%s as declared, %.3g refitted, %.3g with what was "
          "found; at the end %.3g, %.3g, "
          "%.3g; noise %.2g.",
          f.horizon, f.data.c_str(), f.runs,
          (f.lost > 0 ? format(", %d not finished", f.lost) : std::string())
              .append(f.unstable > 0
                          ? format(", %d more not told for an error of the start grows more than twentyfold there",
                                   f.unstable)
                          : std::string())
              .c_str(),
          d.output_names[j].c_str(), told(f.before[j], u), after_number(told_unit(u)).c_str(), told(f.refit[j], u),
          told(f.after[j], u), told(f.end_before[j], u), told(f.end_refit[j], u), told(f.end_after[j], u),
          told(d.noise[j], u)));
    }
    if (outputs.size() < f.after.size())
      s.push_back((f.after.size() == outputs.size() + 1
                       ? std::string("The other output is nearer to what was measured; it is")
                       : format("The other %zu outputs are nearer to what was measured; they are",
                                f.after.size() - outputs.size())) +
                  " on the page and in the JSON.");
  }
  if (!d.effects.empty() && !q.runs.empty()) {
    for (std::size_t j = 0; j < q.explained.size(); ++j) {
      if (q.explained[j] || !(q.runs.front().after[j] > 2.0 * d.noise[j])) continue;
      s.push_back(format("%s hardly improves: what is missing there, some %.2g%s, is unexplained by any candidate.",
                         d.output_names[j].c_str(), told(q.runs.front().after[j], d.output_units[j]),
                         after_number(told_unit(d.output_units[j])).c_str()));
    }
  }
  if (std::isfinite(d.heldout.after)) {
    s.push_back(
        format("Error on held-out stretches, in units of the sensors' noise: declared %.4g, refitted %.4g, final %.4g.",
               d.heldout.before, d.heldout.refit, d.heldout.after));
    if (!d.effects.empty() && d.excess_explained > 0.0) {
      s.push_back(format(
          "That is %.1f %% of the excess over the noise that refitting alone leaves (%.1f %% of the declared model's).",
          100.0 * d.excess_explained, 100.0 * d.excess_explained_declared));
    }
    if (!d.effects.empty() && !(d.excess_explained > 0.0) && !(d.heldout.after < d.heldout.refit)) {
      s.push_back("There what was found does not help: it is not to be relied on beyond what was fitted.");
    }
    if (d.heldout.after > 1.5) {
      s.push_back(
          format("What remains, %.2g times the noise, is the model's own error. It is correlated in time, worth %.0f "
                 "independent numbers, and no "
                 "candidate predicts it; claims and intervals are measured against it, not against the noise.",
                 d.heldout.after, q.independent));
    }
  }
}

}  // namespace saltus::diagnosis
