#include "coverage.hpp"

#include "core/spectrum/noise.hpp"

namespace saltus {

bool circle_holds(const HtfEstimate& h, Complex truth, double level, std::int64_t periods) {
  const double freedom = 48.0 * static_cast<double>(periods - 1);  // LineNoise pools so many lines
  return std::abs(h.value - truth) < confidence_radius(level, freedom) * h.sigma;
}

}  // namespace saltus
