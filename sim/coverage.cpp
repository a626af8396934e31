#include "coverage.hpp"

namespace saltus {

bool circle_holds(const HtfEstimate& h, Complex truth, double level) {
  return std::abs(h.value - truth) < confidence_radius(level, h.freedom) * h.sigma;
}

}  // namespace saltus
