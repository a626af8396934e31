#include "hopper_orbit.hpp"

namespace saltus {

template Orbit<Hopper<>, 32> find_orbit<32>(const Hopper<>&, Timebase, const ClockPhases&, LdtpOf<Hopper<>, 32>&,
                                            std::int64_t) noexcept;
template Orbit<Hopper<>, 32> find_orbit<32>(const Hopper<>&, Timebase, const KinematicPhases&, LdtpOf<Hopper<>, 32>&,
                                            std::int64_t) noexcept;

}  // namespace saltus
