// The laws that the limit cycle of every model keeps (Wendel & Ames 2010). A test hands a model to `cycle_of` and what
// it gets to `obeys_cycle_laws`.
#pragma once

#include <cmath>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "sim/orbit_report.hpp"
#include "tests/support/catch.hpp"

namespace saltus::test {

// A limit cycle with steps h and h/2, and all that is said about it.
struct FoundCycle {
  Search search;
  WideCycle coarse, fine;
  WideAnalysis analysis;
};

template <class M>
void halve(const M& m, FoundCycle& r) {
  REQUIRE(r.search.outcome == saltus::SearchOutcome::found);
  r.fine = r.coarse;
  REQUIRE(shoot(m, r.search.dt / 2.0, 8.0 * r.coarse.period(), r.fine).outcome == saltus::SearchOutcome::found);
  r.analysis = analyse(r.coarse, r.fine);
}

template <class M>
std::unique_ptr<FoundCycle> cycle_of(const M& m, const Point<M>& start, std::int64_t ticks = 512, int returns = 1) {
  auto r = std::make_unique<FoundCycle>();
  r->search = find_cycle(m, start, ticks, r->coarse, returns);
  halve(m, *r);
  return r;
}
template <class M>
std::unique_ptr<FoundCycle> cycle_of(const M& m) {
  return cycle_of(m, start_of(m));
}

// The cycle of other parameters, followed from those of `usual`.
template <class M>
std::unique_ptr<FoundCycle> followed(const M& usual, const M& m, std::int64_t ticks = 512) {
  auto r = std::make_unique<FoundCycle>();
  REQUIRE(find_cycle(usual, start_of(usual), ticks, r->coarse).outcome == saltus::SearchOutcome::found);
  double reached = 0.0;
  r->search = follow_cycle(usual, m, ticks, r->coarse, reached);
  CHECK(reached == 1.0);
  halve(m, *r);
  return r;
}

// Nothing is in doubt; every rank keeps its bounds; every leg keeps eq. 3 and Theorem 1; the non-zero multipliers agree
// at all guards and on a section in the middle of every leg; the cycle repeats; its resets have constant rank.
template <class M>
void obeys_cycle_laws(const M& m, const FoundCycle& c) {
  const WideAnalysis& a = c.analysis;
  REQUIRE(a.doubt == Doubt::none);
  CHECK(c.search.residual < 1e-12);
  CHECK(a.spread <= a.allowed);
  const WideMultipliers& first = a.guard[0].spectrum;
  for (int j = 0; j < c.fine.count; ++j) {
    const auto at = static_cast<std::size_t>(j);
    INFO("edge map " << j);
    CHECK(a.edge[at].bounds.contains(a.edge[at].map.value));
    CHECK(a.edge[at].guard_angle > 1e-3);
    CHECK((a.edge[at].rank.decreasing() || a.edge[at].rank.transverse));
    CHECK(a.leg[at].total.value == c.fine[j].leg.dim - 1);
    CHECK(a.leg[at].section.value == c.fine[j].leg.dim - 1);
    CHECK(a.leg[at].invariant < 1e-8);
    CHECK(a.leg[at].kernel < 1e-8);
    CHECK(a.guard[at].bounds.contains(a.guard[at].rank.value));
    CHECK(a.guard[at].zeros.total() == c.fine[j].dim - a.guard[at].spectrum.nonzero);
    CHECK(a.guard[at].one < 1e-8);
    const auto sample = sample_reset(m, c.fine[j], 1e-3);
    const auto& reset = a.edge[at].reset;
    CHECK(sample.constant(reset.value, std::fmax(reset.tolerance, 1e-9 * reset.sigma[0])));

    WideCycle coarse = c.coarse;
    WideCycle fine = c.fine;
    REQUIRE(cut_leg(m, c.search.dt, coarse, j, 0.5 * coarse[j].leg.duration));
    REQUIRE(cut_leg(m, c.search.dt / 2.0, fine, j, 0.5 * fine[j].leg.duration));
    const WideMultipliers middle = multipliers_at(coarse, fine, j + 1);
    CHECK(spectral_distance(first, middle) <= allowed_distance(first, middle));
  }
  const Periodicity again = repeat(m, c.search.dt / 2.0, c.fine);
  CHECK(again.same_order);
  CHECK(again.time < 1e-10);
  CHECK(again.state < 1e-10);
}

// The multipliers are these, each within its own error, and that is at most `error`.
inline void has_multipliers(const WideMultipliers& m, const std::vector<Complex>& expected, double error) {
  REQUIRE(m.status == Status::ok);
  REQUIRE(m.nonzero == static_cast<int>(expected.size()));
  for (std::size_t i = 0; i < expected.size(); ++i) {
    INFO("multiplier " << i << ": " << m.value[i] << ", error " << m.error[i]);
    CHECK(std::abs(m.value[i] - expected[i]) < m.error[i] + 1e-12);
    CHECK(m.error[i] < error);
  }
  for (int i = m.nonzero; i < m.dim; ++i) CHECK(m.value[static_cast<std::size_t>(i)] == 0.0);
}

template <class... Numbers>
void has_state(const Vec<orbit_width>& x, double tolerance, Numbers... numbers) {
  int i = 0;
  const auto check = [&](double number) {
    INFO("coordinate " << i);
    CHECK(std::abs(x[i] - number) < tolerance);
    ++i;
  };
  (check(numbers), ...);
}

// How errors shrink when the step is halved, in the 2-norm: 16 for a method of order four.
struct Halved {
  double states, multipliers;
};
template <class M>
Halved halved(const M& m, std::int64_t ticks) {
  WideCycle cycle;
  const Search s = find_cycle(m, start_of(m), ticks, cycle);
  REQUIRE(s.outcome == saltus::SearchOutcome::found);
  std::array<Eigen::VectorXd, 3> state;
  std::array<Eigen::VectorXcd, 3> spectrum;
  for (std::size_t i = 0; i < 3; ++i) {
    const double h = s.dt / static_cast<double>(1 << i);
    const WideCycle wide = cycle;
    REQUIRE(shoot(m, h, 8.0 * cycle.period(), cycle).outcome == saltus::SearchOutcome::found);
    state[i] = Eigen::VectorXd(cycle.count * (orbit_width + 1));
    for (int j = 0; j < cycle.count; ++j) {
      state[i].segment(j * (orbit_width + 1), orbit_width + 1) << cycle[j].x, cycle[j].leg.duration;
    }
    const WideMultipliers mu = multipliers_at(wide, cycle, 0);
    REQUIRE(mu.status == Status::ok);
    spectrum[i] = Eigen::VectorXcd(mu.nonzero);
    for (int k = 0; k < mu.nonzero; ++k) spectrum[i][k] = mu.value[static_cast<std::size_t>(k)];
  }
  return {(state[0] - state[1]).norm() / (state[1] - state[2]).norm(),
          (spectrum[0] - spectrum[1]).norm() / (spectrum[1] - spectrum[2]).norm()};
}

// A matrix of tests/data, row after row without a header, in the upper left corner.
inline Mat<orbit_width, orbit_width> matrix_of(const std::string& name) {
  std::ifstream file(std::string(SALTUS_TEST_DATA) + "/" + name);
  Mat<orbit_width, orbit_width> m = Mat<orbit_width, orbit_width>::Zero();
  std::string line;
  int rows = 0;
  for (; std::getline(file, line); ++rows) {
    std::istringstream cells(line);
    int col = 0;
    for (std::string cell; std::getline(cells, cell, ','); ++col) m(rows, col) = std::stod(cell);
  }
  INFO(name);
  REQUIRE(rows > 0);
  return m;
}

}  // namespace saltus::test
