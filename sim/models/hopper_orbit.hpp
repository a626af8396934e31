// The hopper's limit cycle, compiled once: most commands and tests begin with it.
#pragma once

#include "../../core/orbit/orbit.hpp"
#include "hopper.hpp"

namespace saltus {

extern template Orbit<Hopper<>, 32> find_orbit<32>(const Hopper<>&, Timebase, const ClockPhases&, LdtpOf<Hopper<>, 32>&,
                                                   std::int64_t) noexcept;
extern template Orbit<Hopper<>, 32> find_orbit<32>(const Hopper<>&, Timebase, const KinematicPhases&,
                                                   LdtpOf<Hopper<>, 32>&, std::int64_t) noexcept;

}  // namespace saltus
