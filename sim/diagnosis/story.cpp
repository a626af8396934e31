#include "story.hpp"

#include <algorithm>
#include <cmath>

#include "../format.hpp"

namespace saltus::diagnosis {

std::string verdict_sentence(const Diagnosis& d) {
  switch (d.verdict) {
    case Verdict::no_discrepancy:
      return "Verdict: no discrepancy. The declared model explains the record.";
    case Verdict::parameters_only:
      return "Verdict: parameters only. The declared model holds once its parameters are corrected.";
    case Verdict::effect_found:
      return format("Verdict: effect found, %zu of the %d candidates tried.", d.effects.size(), d.tried);
    case Verdict::ambiguous:
      return "Verdict: ambiguous. Several causes explain the record equally well.";
    case Verdict::unexplained:
      return "Verdict: unexplained. Something is missing that none of the candidates is.";
  }
  return {};
}

namespace {

// The parameters that moved by more than three standard errors; where many share it, the one that moved most of these.
std::string corrections(const Diagnosis& d) {
  constexpr double clearly = 3.0;  // [-] standard errors
  const auto moved = [](const ParameterRow& r) {
    const double off = std::abs(r.with_effect - r.declared);
    return r.with_effect_error > 0.0 ? off / r.with_effect_error : off > 0.0 ? clearly : 0.0;
  };
  double most = 0.0;
  for (const ParameterRow& r : d.parameters) most = std::max(most, moved(r));
  std::string t;
  for (const ParameterRow& r : d.parameters) {
    if (!(most > 0.0) || moved(r) < std::min(most, clearly)) continue;
    t += format("%s%s %.6g -> %.6g%s", t.empty() ? "" : ", ", r.name.c_str(), r.declared, r.with_effect,
                after_number(r.unit).c_str());
  }
  return t;
}

}  // namespace

void tell(Diagnosis& d) {
  auto& s = d.story;
  s.push_back(format("%s against %s: %d experiments, %d repeats, noise %s.", d.record.c_str(), d.model.c_str(),
                     d.experiments, d.repeats,
                     [&] {
                       std::string t;
                       for (std::size_t j = 0; j < d.noise.size(); ++j) {
                         t += format("%s%s %.3g%s", j > 0 ? ", " : "", d.output_names[j].c_str(), d.noise[j],
                                     after_number(d.output_units[j]).c_str());
                       }
                       return t;
                     }()
                         .c_str()));
  const double sigmas = d.expected > 0.0 ? (d.chi2_refit - d.expected) / std::sqrt(2.0 * d.expected) : 0.0;
  s.push_back(
      format("The declared model misses by %.3g times the noise; with its parameters refitted within tolerance, %.4g "
             "(%+.1f sigma).",
             d.all.before, d.all.refit, sigmas));
  s.push_back(verdict_sentence(d));
  for (const Finding& f : d.effects) {
    const std::string tie = listed(f.ties);
    const std::string from = f.declared == 0.0 ? "" : format(" from the declared %.4g", f.declared);
    const std::string peak = std::isfinite(f.phase) ? format(", largest at %.2f of the cycle", f.phase) : "";
    s.push_back(format("  %s = %.4g%s, 95 %% in [%.4g, %.4g]; %.0f standard errors%s%s%s%s.", f.name.c_str(), f.value,
                       after_number(f.unit).c_str(), f.low, f.high, std::abs(f.z), from.c_str(), peak.c_str(),
                       tie.empty() ? "" : "; could as well be ", tie.c_str()));
  }
  if (d.verdict == Verdict::parameters_only) {
    const std::string t = corrections(d);
    if (!t.empty()) s.push_back("  Corrected: " + t + ".");
  }
  if (d.where.known) {
    s.push_back(format("The missing force is largest at port %s, chart %s, between %.2f and %.2f of the cycle.",
                       d.where.port.c_str(), d.where.chart.c_str(), d.where.from, d.where.to));
  }
  if (!d.rivals.empty()) {
    const Rival& next = d.rivals.front();
    s.push_back(format("Next best: %s (BIC %+.1f).", together(next.names).c_str(), next.bic));
  }
  if (d.verdict == Verdict::unexplained && d.candidates.size() > 0) {
    s.push_back(format("Closest candidate: %s (score %.1f), which does not leave noise.", d.candidates[0].name.c_str(),
                       d.candidates[0].z));
  }
  if (std::isfinite(d.heldout.after)) {
    s.push_back(format("Error on held-out data, in units of the noise: declared %.4g, refitted %.4g, %s %.4g.",
                       d.heldout.before, d.heldout.refit, d.effects.empty() ? "final" : "with the effect",
                       d.heldout.after));
  }
  if (!d.effects.empty() && std::isfinite(d.heldout.after) && d.excess_explained > 0.0) {
    s.push_back(format(
        "That is %.1f %% of the excess over the noise that refitting alone leaves (%.2f %% of the declared model's).",
        100.0 * d.excess_explained, 100.0 * d.excess_explained_declared));
  }
  if (!d.separate.empty()) s.push_back(d.separate);
  if (d.verdict == Verdict::no_discrepancy || d.verdict == Verdict::parameters_only) {
    std::string t;
    int n = 0;
    for (const CandidateRow& c : d.candidates) {
      if (c.limit <= 0.0 || n == 4) continue;
      t += format("%s%s %.2g%s", n++ > 0 ? ", " : "", c.name.c_str(), c.limit, after_number(c.unit).c_str());
    }
    s.push_back("Would have been seen (95 % power) above: " + t + ".");
  }
}

}  // namespace saltus::diagnosis
