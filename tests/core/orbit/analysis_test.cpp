#include "core/orbit/analysis.hpp"

#include <cmath>
#include <memory>
#include <string>

#include "core/orbit/shooting.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"
#include "tests/support/strobe.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;
using worlds::Strobe;

namespace saltus {
extern template ConditionedMultipliers<4> conditioned_multipliers<4>(const Measured<4>&, int, Rank<4>) noexcept;
}

namespace {

constexpr std::int64_t ticks = 128;

// The cycle with steps h and h/2.
struct Pair {
  Cycle<4> coarse, fine;
  double dt = 0.0;
  CycleAnalysis<4> analysis() const { return analyse(coarse, fine); }
};
template <class M>
std::unique_ptr<Pair> pair_of(const M& m) {
  auto p = std::make_unique<Pair>();
  const Search s = find_cycle(m, start_of(m), ticks, p->coarse);
  REQUIRE(s.outcome == SearchOutcome::found);
  p->fine = p->coarse;
  p->dt = s.dt;
  REQUIRE(shoot(m, s.dt / 2.0, 8.0 * p->coarse.period(), p->fine).outcome == SearchOutcome::found);
  return p;
}

}  // namespace

TEST_CASE("analysis: one chart, one edge, a multiplier in closed form") {
  Strobe<> m;
  const auto p = pair_of(m);
  const auto a = p->analysis();
  REQUIRE(a.doubt == Doubt::none);
  REQUIRE(a.count == 1);
  const auto& g = a.guard[0];
  CHECK(g.rank.value == 1);
  CHECK(g.bounds == Bounds{1, 1});  // Theorem 3
  CHECK(g.spectrum.nonzero == 1);
  CHECK(std::abs(g.spectrum.value[0] - Complex(-0.5)) <= g.spectrum.error[0] + 1e-14);
  CHECK(g.spectrum.error[0] < 1e-11);
  CHECK(g.zeros.section == 1);
  CHECK(g.zeros.total() == 1);
  CHECK(g.one < 1e-12);
  CHECK(std::abs(a.edge[0].guard_angle - 1.0) < 1e-12);
  CHECK(std::abs(a.edge[0].image_angle - 1.0) < 1e-12);
  CHECK(a.leg[0].total.value == 1);
  CHECK(a.leg[0].section.value == 1);
  CHECK(a.leg[0].invariant < 1e-12);

  m.a = 2.0;  // multiplier 0: superstable, by the rank of the reset
  const auto q = pair_of(m);
  const auto b = q->analysis();
  REQUIRE(b.doubt == Doubt::none);
  CHECK(b.edge[0].reset.value == 0);
  CHECK(b.guard[0].rank.value == 0);
  CHECK(b.guard[0].bounds == Bounds{0, 0});
  CHECK(b.guard[0].spectrum.nonzero == 0);
  CHECK(b.guard[0].zeros.reset == 1);
  CHECK(b.guard[0].zeros.total() == 2);
}

TEST_CASE("analysis: a clocked model, the same multiplier at both guards and at a section between them") {
  const worlds::Metronome<> m;
  const auto p = pair_of(m);
  const auto a = p->analysis();
  REQUIRE(a.doubt == Doubt::none);
  REQUIRE(a.count == 2);
  const double exact = 0.81 * std::exp(-1.0);
  for (const auto& g : {a.guard[0], a.guard[1]}) {
    CHECK(g.spectrum.nonzero == 1);
    CHECK(std::abs(g.spectrum.value[0] - exact) <= g.spectrum.error[0] + 1e-14);
    CHECK(g.spectrum.error[0] < 1e-9);
    CHECK(g.bounds.contains(g.rank.value));
  }
  CHECK(a.spread <= a.allowed);
  for (int j = 0; j < 2; ++j) {
    Cycle<4> coarse = p->coarse;
    Cycle<4> fine = p->fine;
    REQUIRE(cut_leg(m, p->dt, coarse, j, 0.3 * coarse[j].leg.duration));
    REQUIRE(cut_leg(m, p->dt / 2.0, fine, j, 0.3 * fine[j].leg.duration));
    CHECK(fine.count == 3);
    CHECK(std::abs(fine.period() - p->fine.period()) < 1e-11);
    const auto s = multipliers_at(coarse, fine, j + 1);
    CHECK(spectral_distance(s, a.guard[0].spectrum) <= allowed_distance(s, a.guard[0].spectrum));
    // The whole cycle's derivative keeps the flow's direction, from there too.
    const Vec<4> f = fine[j + 1].leg.f0;
    CHECK((cycle_derivative(fine, j + 1) * f - f).norm() < 1e-8 * f.norm());
  }
}

TEST_CASE("analysis: charts of one dimension leave nothing to a return map") {
  const auto p = pair_of(worlds::Relaxation<>{});
  const auto a = p->analysis();
  REQUIRE(a.doubt == Doubt::none);
  for (int q = 0; q < 2; ++q) {
    const auto& g = a.guard[static_cast<std::size_t>(q)];
    CHECK(g.rank.value == 0);
    CHECK(g.bounds == Bounds{0, 0});
    CHECK(g.spectrum.nonzero == 0);
    CHECK(g.zeros.section == 1);
    CHECK(g.zeros.total() == 1);
  }
  // charges from 0.3 to 0.8 and back: tau ln(0.7/0.2) + tau ln(0.8/0.3)
  CHECK(std::abs(p->fine.period() - 0.25 * (std::log(3.5) + std::log(8.0 / 3.0))) < 1e-9);
}

TEST_CASE("analysis: what cannot be trusted is a doubt, not a number") {
  const Strobe<> m;
  const auto p = pair_of(m);
  {
    Pair q = *p;
    q.fine[0].edge = 1;
    CHECK(q.analysis().doubt == Doubt::other_order);
  }
  {
    Pair q = *p;
    q.fine[0].leg.status = Status::grazing;
    CHECK(q.analysis().doubt == Doubt::grazing);
  }
  {
    Pair q = *p;
    q.fine[0].leg.rate *= 1e-8;
    CHECK(q.analysis().doubt == Doubt::grazing);
  }
  {
    Pair q = *p;
    q.fine[0].leg.rate *= 2.0;  // the step sizes disagree on how the guard is met
    CHECK(q.analysis().doubt == Doubt::grazing);
  }
  {
    Pair q = *p;
    q.fine[0].leg.Phi(1, 1) += 1e-3;
    CHECK(q.analysis().doubt == Doubt::coarse);
  }
  {
    Pair q = *p;
    q.coarse[0].reset(0, 0) += 0.4;  // the error is as large as the number
    CHECK(q.analysis().doubt == Doubt::undecided_rank);
    CHECK(q.analysis().finer);  // smaller steps would help
  }
  {
    Pair q = *p;  // the flow leaves the image of the guard at an angle that is as large as its error
    q.fine[0].leg.f0 = q.fine[0].leg.f1 = Vec<4>(1.0, 1e-5, 0.0, 0.0);
    q.coarse[0].leg.f0 = q.coarse[0].leg.f1 = Vec<4>(1.0, 2e-5, 0.0, 0.0);
    CHECK(q.analysis().doubt == Doubt::undecided_image);
  }
}

TEST_CASE("analysis: rounding in a long cycle is that of its maps, not the product of their magnitudes") {
  // x -> -x/2 twelve times: the multiplier is 2^-12, known about as well as one passage's.
  const Strobe<> m;
  auto p = std::make_unique<Pair>();
  const Search s = find_cycle(m, start_of(m), ticks, p->coarse, 12);
  REQUIRE(s.outcome == SearchOutcome::found);
  p->fine = p->coarse;
  REQUIRE(shoot(m, s.dt / 2.0, 8.0 * p->coarse.period(), p->fine).outcome == SearchOutcome::found);
  const auto a = p->analysis();
  REQUIRE(a.doubt == Doubt::none);
  CHECK(a.guard[0].rank.value == 1);
  CHECK(std::abs(a.guard[0].spectrum.value[0] - std::pow(0.5, 12)) <= a.guard[0].spectrum.error[0]);
  CHECK(a.guard[0].spectrum.error[0] < 1e-12);
}

TEST_CASE("analysis: where a multiplier is 1 the cycle is not isolated, and its numbers are not determined") {
  Strobe<> m;
  m.a = 1.0;
  m.c = 1e-8;  // x -> x - x^2 + c: fixed points +-sqrt(c), multipliers 1 -+ 2 sqrt(c)
  const auto near = pair_of(m);
  CHECK(near->analysis().doubt == Doubt::none);
  CHECK(std::abs(near->fine[0].x[0] - 1e-4) < 1e-9);
  m.c = 0.0;  // where they meet
  const auto fold = pair_of(m);
  CHECK(fold->analysis().doubt == Doubt::not_isolated);
}

TEST_CASE("analysis: between a multiplier that counts and one that is zero lie those that cannot be told") {
  std::string told;
  for (double multiplier = 1e-9; multiplier > 1e-16; multiplier *= 0.5) {
    Strobe<> m;
    m.a = 2.0 + multiplier;
    const auto p = pair_of(m);
    const auto a = p->analysis();
    REQUIRE((a.doubt == Doubt::none || a.doubt == Doubt::undecided_rank));
    const char now = a.doubt != Doubt::none ? '?' : (a.guard[0].spectrum.nonzero > 0 ? '1' : '0');
    if (told.empty() || told.back() != now) told += now;
  }
  CHECK(told == "1?0");
}

TEST_CASE("analysis: does not allocate") {
  const auto p = pair_of(worlds::Metronome<>{});
  const test::AllocationCount allocated;
  const CycleAnalysis<4> a = analyse(p->coarse, p->fine);
  CHECK(allocated() == 0);
  CHECK(a.doubt == Doubt::none);
}
