// saltus identify MODEL --stimulus chirp|prbs: one long experiment that need not repeat.
#include <algorithm>

#include "identify.hpp"

namespace saltus::program {
namespace {

struct Deaf {  // the machine is played to, and its record kept; no estimator listens
  Status push(std::int64_t, const auto&) noexcept { return Status::ok; }
};

template <class M>
Record play(const M& m, const IdentifyOptions& o) {
  const ClockPhases family{sections_per_cycle};
  const Timebase base = timebase_of(m, o.model.ticks);
  const auto system = std::make_unique<LdtpOf<M, sections_per_cycle>>();
  const auto orbit = find_orbit<sections_per_cycle>(m, base, family, *system);
  if (orbit.status != Status::ok) throw RunError(no_orbit(M::name, orbit.status, true));
  Run<M> start;
  start.at = orbit.point[0];
  Rig<M, ClockPhases> rig(m, base, family, start, by_output<M>(o.campaign.noise), o.campaign.seed);
  rig.jitter(o.campaign.jitter);
  const double band = std::min(o.plan.band + 2.0, 0.5 * sections_per_cycle);  // the edge of a sweep is weak
  const std::vector<double> u = o.stimulus == "chirp"
                                    ? chirp_input(o.cycles, sections_per_cycle, band, o.plan.amplitude)
                                    : binary_input(o.cycles, sections_per_cycle, o.plan.amplitude, o.plan.seed);
  Plan plan;
  plan.options = o.plan;
  Record r = blank_record<M>(plan, 0, base.period);
  r.stimulus_period_cycles.reset();
  r.settle_cycles.reset();
  Deaf deaf;
  const Status s = run_experiment(rig, u, static_cast<std::int64_t>(u.size()), 0, deaf,
                                  [&](std::int64_t n, double input, const auto& y) {
                                    add_row(r, 0, n, sections_per_cycle, base.period, input, y);
                                  });
  if (!usable(s)) {
    throw RunError(std::string(M::name) + ": the machine left its cycle (" + std::string(name(s)) +
                   "); lower --amplitude");
  }
  return r;
}

}  // namespace

Record play_any_stimulus(const IdentifyOptions& o) {
  Record record;
  with_model(o.model, [&](auto m) {
    using M = decltype(m);
    if constexpr (input_count<M> == 1 && clocked<M>) {
      record = play(m, o);
    } else {
      throw UsageError("--stimulus " + o.stimulus + ": " + std::string(M::name) +
                       (clocked<M> ? " has not one input alone" : " is not paced by a clock"));
    }
  });
  return record;
}

}  // namespace saltus::program
