// What every sample of a campaign or record tells beyond its lines.
#include <algorithm>
#include <cmath>
#include <optional>

#include "../record_identification.hpp"
#include "identify.hpp"

namespace saltus::program {

void refine(Identified& r, const Record& record, const IdentifyOptions& o, const std::vector<Complex>& multipliers) {
  constexpr double settled = 1e-4;  // [-] of the first transient, as the campaign's note has it
  const auto settle = static_cast<double>(record.settle_cycles.value_or(0));
  const double decay = multipliers.empty() ? 0.0 : std::abs(multipliers[0]);
  std::optional<Record> without;  // the transient
  const bool transient = o.transient == "model" || (o.transient == "auto" && !(std::pow(decay, settle) <= settled));
  if (transient && o.campaign.ramp > 0) {
    r.id.notes.emplace_back("the decay under a stimulus that grows is not modelled");
  } else if (transient) {
    const auto choice = o.transient == "model" ? TransientChoice::model : TransientChoice::automatic;
    without = record;
    r.transient = remove_transient(*without, std::clamp(static_cast<int>(multipliers.size()), 1, 2), choice);
  }
  if (r.transient && r.transient->removed) {
    Identification again = identify_record(*without, o.campaign.harmonics);
    r.id.htf = std::move(again.htf);
    r.id.classes = std::move(again.classes);
    for (HtfEstimate& h : r.id.htf) h.sigma *= r.transient->inflation;
  }
  if (r.sections != "clock") return;  // an event has no instant of its own to be missed
  r.jitter = estimate_jitter(without ? *without : record);
  if (!(r.jitter->sigma > 0.0)) {
    r.jitter.reset();
  } else if (r.jitter->found && o.correct_jitter) {
    correct_jitter(r.id, r.jitter->seconds, *record.cycle_period);
    r.id.notes.emplace_back("corrected for instants that scatter");
  }
}

}  // namespace saltus::program
