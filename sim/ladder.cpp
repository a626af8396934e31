#include "ladder.hpp"

#include <algorithm>
#include <cmath>

#include "core/spectrum/distortion.hpp"

namespace saltus {

Identification extrapolate(std::span<const Identification> rungs, Ladder& ladder) {
  Identification id = rungs.front();
  for (const Identification& rung : rungs.subspan(1)) {
    id.samples += rung.samples;
    id.missing += rung.missing;
    id.worst = worse(id.worst, rung.worst);
  }
  const bool known = id.noise_known();
  for (std::size_t i = 0; i < id.htf.size(); ++i) {
    std::vector<Complex> value;
    std::vector<double> sigma;
    int cycles = 0;
    for (const Identification& rung : rungs) {
      value.push_back(rung.htf[i].value);
      sigma.push_back(known ? rung.htf[i].sigma : 1e-15 + 1e-12 * std::abs(rung.htf[i].value));
      cycles += rung.htf[i].cycles;
    }
    if (!known) std::fill(sigma.begin(), sigma.end(), sigma.front());
    const ZeroAmplitude zero = extrapolate_to_zero(ladder.amplitude, value, sigma);
    id.htf[i].value = zero.value;
    id.htf[i].cycles = cycles;
    if (known) id.htf[i].sigma = zero.sigma;
    ++ladder.degree[static_cast<std::size_t>(zero.degree)];
    ladder.misfits += known && !zero.fits ? 1 : 0;
  }
  return id;
}

}  // namespace saltus
