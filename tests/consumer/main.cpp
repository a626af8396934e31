// A project of its own that knows saltus only as an installed package: its own model, its own effect.
#include "ball.hpp"

#include <saltus/core/orbit/orbit.hpp>
#include <saltus/core/spectrum/htf.hpp>

#include <cmath>
#include <cstdio>

namespace {

constexpr int sections = 8;

template <class M>
struct Cycle {
  saltus::Orbit<M, sections> orbit;
  saltus::LdtpOf<M, sections> system;

  explicit Cycle(const M& m) {
    orbit = saltus::find_orbit<sections>(m, saltus::timebase_of(m, 256), saltus::ClockPhases{sections}, system);
  }
  double contraction() const { return system.monodromy(0).determinant(); }
};

bool check(const char* what, bool holds) {
  std::printf("%s: %s\n", what, holds ? "holds" : "FAILS");
  return holds;
}

}  // namespace

int main() {
  const ball::Juggler<> ideal;
  const Cycle<ball::Juggler<>> free(ideal);
  bool good = check("the ball has a limit cycle", free.orbit.status == saltus::Status::ok && free.orbit.events == 1);
  // A turn of free flight brings it back to the same height.
  good &= check("it leaves the table with g T / 2", std::abs(free.orbit.event[0].after.x[1] - 9.81 / 2.0) < 1e-9);
  good &= check("a cycle contracts areas by the square of the restitution", std::abs(free.contraction() - 0.64) < 1e-8);

  using Dragged = saltus::With<ball::Juggler<>, ball::AirDrag<>>;
  const Dragged dragged(ideal, ball::AirDrag<>{});
  const Cycle<Dragged> damped(dragged);
  good &= check("with air drag it still has one", damped.orbit.status == saltus::Status::ok);
  good &= check("and contracts more", damped.contraction() < 0.64 - 1e-3);
  const auto slow = saltus::htf(free.system, 2.0 * 3.141592653589793 * 0.1 / sections);
  good &= check("it answers a push", std::abs(slow(0)(0, 0)) > 1e-3);
  return good ? 0 : 1;
}
