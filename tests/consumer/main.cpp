// A project of its own that knows saltus only as an installed package.
#include <saltus/core/linalg.hpp>
#include <saltus/core/tick.hpp>

#include <cstdio>

int main() {
  // A turn of 0.1 s is not a whole number of binary digits; a million turns later its ticks are still exact.
  constexpr saltus::Timebase base{.period = 0.1, .per_turn = 400};
  const saltus::Vec<2> late(base.time(400'000'000), base.phase(400'000'100));
  const saltus::Vec<2> expected(100'000.0, 1.5707963267948966);
  const double error = (late - expected).norm();
  std::printf("error %g\n", error);
  return error < 1e-12 ? 0 : 1;
}
