#include "core/orbit/section_map.hpp"

#include <cmath>
#include <memory>

#include "core/orbit/orbit.hpp"
#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/table.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;
using namespace saltus::worlds;

namespace {

// The system around the orbit of the hopper, with `ticks` ticks a turn.
template <int N, class Family>
std::unique_ptr<LdtpOf<Hopper<>, N>> system_of(const Family& family, Orbit<Hopper<>, N>& orbit, int ticks = 512) {
  auto system = std::make_unique<LdtpOf<Hopper<>, N>>();
  const Hopper<> m;
  orbit = find_orbit<N>(m, timebase_of(m, ticks), family, *system);
  REQUIRE(orbit.status == Status::ok);
  return system;
}

// Puts p on section `index` by moving coordinate `out`.
template <class M, class Family>
void onto(const M& m, const Family& family, int index, Point<M>& p, int out) {
  const Input<M> u = Input<M>::Zero();
  visit_chart(p, [&](auto c) {
    for (int i = 0; i < 50; ++i) {
      Point<M> moved = p;
      moved.x[out] += 1e-6;
      const double h = family.value(index, m, c, p.in(c), u);
      const double slope = (family.value(index, m, c, moved.in(c), u) - h) / 1e-6;
      p.x[out] -= h / slope;
    }
  });
}

// An angle that decreases, and leaps from -1 to -2: sections between are never met.
struct Before : Chart<1> {};
struct Beyond : Chart<1> {};
struct Leap : Edge<Before, Beyond> {};
struct Home : Edge<Beyond, Before> {};
template <class S = double>
struct Leaper {
  using X = Vec<1, S>;
  using U = Vec<0, S>;
  using Charts = List<Before, Beyond>;
  using Edges = List<Leap, Home>;
  static constexpr std::string_view name = "leaper";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"p", "-"}, Quantity{"v", "-"}};
  static constexpr auto parameters() { return std::array<Parameter<Leaper, S>, 0>{}; }
  template <class C>
  X flow(C, const X&, const U&) const noexcept {
    return X(S(-1.0));
  }
  S guard(Leap, const X& x, const U&) const noexcept { return x[0] + 1.0; }
  S guard(Home, const X& x, const U&) const noexcept { return x[0] + 2.0 * std::numbers::pi; }
  X reset(Leap, const X& x, const U&) const noexcept { return X(x[0] - 1.0); }
  X reset(Home, const X&, const U&) const noexcept { return X(S(0.0)); }
  template <class C>
  Vec<2, S> output(C, const X& x, const U&) const noexcept {
    return {cos(x[0]), sin(x[0])};
  }
  Start<Before, S> start() const noexcept { return {X(S(-0.1))}; }
};
static_assert(check<Leaper<>>());

// A section that is never met.
struct Never {
  static constexpr bool on_grid = false;
  static constexpr int count() noexcept { return 1; }
  template <class M, class C>
  ScalarOf<M> value(int, const M&, C, const Vec<C::dim, ScalarOf<M>>&, const Input<M>&) const noexcept {
    return 1.0;
  }
};

// Largest difference of A, B, C, D at section `index` from central differences of the map itself.
template <class M, class Family>
double difference_error(const M& m, Timebase base, const Family& family, const Run<M>& start, int index) {
  const Input<M> zero = Input<M>::Zero();
  if constexpr (!Family::on_grid) base.sets_clock = false;
  SectionMap<M> map;
  Run<M> end = start;
  REQUIRE(linearise_section(m, end, index, zero, base, family, map) == Status::ok);
  const int next = (index + 1) % family.count();
  const Tangent<M> from = tangent_of(family, index, m, start.at, zero);
  const Tangent<M> to = tangent_of(family, next, m, end.at, zero);
  CHECK(map.cols == from.dim);
  CHECK(map.rows == to.dim);
  constexpr double step = 1e-6;
  double worst = 0.0;
  const auto compare = [&](auto move, auto column, auto output_column) {
    Vec<section_dim<M>> d = Vec<section_dim<M>>::Zero();
    Output<M> dy = Output<M>::Zero();
    for (const double sign : {1.0, -1.0}) {
      Run<M> run = start;
      Input<M> u = zero;
      move(run, u, sign * step);
      dy += sign * output_at(m, run.at, u) / (2.0 * step);
      REQUIRE(to_next_section(m, run, index, u, base, family, [](auto...) {}) == Status::ok);
      for (int i = 0; i < to.dim; ++i) d[i] += sign * run.at.x[to.coordinate(i)] / (2.0 * step);
    }
    worst = std::fmax(worst, (d - column).cwiseAbs().maxCoeff());
    worst = std::fmax(worst, (dy - output_column).cwiseAbs().maxCoeff());
  };
  for (int j = 0; j < from.dim; ++j) {
    compare(
        [&](Run<M>& run, Input<M>&, double s) {
          run.at.x[from.coordinate(j)] += s;
          onto(m, family, index, run.at, from.out);
        },
        map.A.col(j), map.C.col(j));
  }
  for (int j = 0; j < input_count<M>; ++j) {
    compare([&](Run<M>&, Input<M>& u, double s) { u[j] += s; }, map.B.col(j), map.D.col(j));
  }
  return worst;
}

}  // namespace

TEST_CASE("section map: the hopper's A, B and C on its isochrons are those of the reference") {
  Orbit<Hopper<>, 32> orbit;
  const auto system = system_of<32>(ClockPhases{}, orbit);
  double worst = 0.0;
  int entries = 0;
  for (const auto& row : test::table("hopper/ldtp_isochron.csv")) {
    const auto n = static_cast<std::size_t>(std::stoi(row[1]));
    const int i = std::stoi(row[2]);
    const int j = std::stoi(row[3]);
    const double value = std::stod(row[4]);
    if (row[0] == "chart") CHECK(orbit.point[n].chart == std::stoi(row[4]));
    if (row[0] == "t") CHECK(std::abs(orbit.time[n] - value) < 1e-12);
    if (row[0] == "A") worst = std::fmax(worst, std::abs(system->A[n](i, j) - value));
    if (row[0] == "B") worst = std::fmax(worst, std::abs(system->B[n](i, j) - value));
    if (row[0] == "C") worst = std::fmax(worst, std::abs(system->C[n](i, j) - value));
    ++entries;
  }
  CHECK(entries > 800);
  CHECK(worst < 1e-7);
  // Square but for the two that hold an event.
  for (std::size_t n = 0; n < 32; ++n) {
    CHECK(system->dim[n] == (n >= 12 && n <= 16 ? 2 : 4));
    CHECK(system->D[n].isZero(0.0));
  }
  CHECK(system->A[11].bottomRows<2>().isZero(0.0));  // 2 x 4
  CHECK(system->A[16].rightCols<2>().isZero(0.0));   // 4 x 2
}

TEST_CASE("section map: derivatives are those of the map itself, on every family") {
  const Hopper<> m;
  SECTION("clock phases") {
    Orbit<Hopper<>, 32> orbit;
    const auto system = system_of<32>(ClockPhases{}, orbit);
    const Timebase base = timebase_of(m, 512);
    for (const int n : {0, 10, 11, 12, 15, 16, 17, 31}) {
      const Run<Hopper<>> run{orbit.point[static_cast<std::size_t>(n)], 16 * n};
      CHECK(difference_error(m, base, ClockPhases{}, run, n) < 1e-7);
    }
  }
  SECTION("kinematic phases") {
    Orbit<Hopper<>, 32> orbit;
    const auto system = system_of<32>(KinematicPhases{}, orbit);
    const Timebase base = timebase_of(m, 512);
    for (int n = 0; n < 32; ++n) {
      const Run<Hopper<>> run{orbit.point[static_cast<std::size_t>(n)]};
      CHECK(difference_error(m, base, KinematicPhases{}, run, n) < 1e-7);
    }
  }
  SECTION("a guard") {
    const Timebase base = timebase_of(m, 512);
    Orbit<Hopper<>, 1> orbit;
    auto system = system_of<1>(AtEdge<hopper::Touchdown>{}, orbit);
    CHECK(difference_error(m, base, AtEdge<hopper::Touchdown>{}, Run<Hopper<>>{orbit.point[0]}, 0) < 1e-7);
    system = system_of<1>(AtEdge<hopper::Liftoff>{}, orbit);
    CHECK(difference_error(m, base, AtEdge<hopper::Liftoff>{}, Run<Hopper<>>{orbit.point[0]}, 0) < 1e-7);
  }
}

TEST_CASE("section map: closed forms") {
  SECTION("from impact to impact a ball keeps a share of its speed, whatever the force held") {
    const Ball<> m;
    const Timebase base{1.0, 100};
    Run<Ball<>> run;
    run.at = at<Ball<>>(ball::Air{}, Vec<2>(0.0, -3.0));
    SectionMap<Ball<>> map;
    CHECK(linearise_section(m, run, 0, Vec<1>(0.0), base, AtEdge<ball::Impact>{}, map) == Status::ok);
    CHECK(map.rows == 1);
    CHECK(map.cols == 1);
    CHECK(std::abs(map.A(0, 0) - m.e) < 1e-12);
    CHECK(std::abs(map.B(0, 0)) < 1e-12);
    CHECK(std::abs(run.at.x[1] + 3.0 * m.e) < 1e-12);
    CHECK(std::abs(run.time(base) - 2.0 * 3.0 * m.e / m.g) < 1e-12);
  }
  SECTION("a metronome between clock phases") {
    Metronome<> m;
    m.shift = 0.3;
    constexpr int N = 8;
    Ldtp<1, 1, 1, N> system;
    const auto orbit = find_orbit<N>(m, timebase_of(m, 64), ClockPhases{N}, system);
    REQUIRE(orbit.status == Status::ok);
    const double tau = 1.0 / N;
    const double decay = std::exp(-m.k * tau);
    for (std::size_t n = 0; n < N; ++n) {
      // Turned on in the interval of section 0, at clock 0.3; off in that of section 4, at pi + 0.3.
      const bool event = n == 0 || n == 4;
      const double before = 0.3 / (2.0 * std::numbers::pi);  // [s] into it
      CHECK(std::abs(system.A[n](0, 0) - (event ? m.keep : 1.0) * decay) < 1e-8);
      const double early = (1.0 - std::exp(-m.k * before)) / m.k * std::exp(-m.k * (tau - before));
      const double late = (1.0 - std::exp(-m.k * (tau - before))) / m.k;
      const double b = event ? m.keep * early + late : (1.0 - decay) / m.k;
      CHECK(std::abs(system.B[n](0, 0) - b) < 1e-8);
      CHECK(system.C[n](0, 0) == 1.0);
    }
    // Its orbit and its one multiplier.
    const double half = std::exp(-0.5 * m.k);
    CHECK(std::abs(system.monodromy(3)(0, 0) - m.keep * m.keep * half * half) < 1e-8);
  }
}

TEST_CASE("section map: a section that is never met, and trouble on the way") {
  const Hopper<> hopper;
  Run<Hopper<>> run;
  run.at = start_of(hopper);
  const Timebase base = timebase_of(hopper, 64);
  CHECK(to_next_section(hopper, run, 0, Vec<1>(0.0), base, Never{}, [](auto...) {}) == Status::failed);
  CHECK(run.tick == 4 * 64);

  const Ball<> ball;
  Run<Ball<>> bouncing;
  bouncing.at = start_of(ball);
  CHECK(to_next_section(ball, bouncing, 0, Vec<1>(0.0), Timebase{10.0, 64}, Never{}, [](auto...) {}) == Status::zeno);
}

TEST_CASE("section map: a section that a reset leaps over is not met a turn later") {
  const Leaper<> m;
  const Timebase base{1.0, 100};
  const KinematicPhases eighths{8, 0, 1, 0.0, 0.0, 1.0, 1.0};
  const double eighth = std::numbers::pi / 4.0;
  Run<Leaper<>> run;
  run.at = start_of(m);
  REQUIRE(to_next_section(m, run, 0, Vec<0>(), base, eighths, [](auto...) {}) == Status::ok);
  CHECK(std::abs(run.at.x[0] + eighth) < 1e-12);
  CHECK(to_next_section(m, run, 1, Vec<0>(), base, eighths, [](auto...) {}) == Status::failed);
  CHECK(run.at.chart == 1);
  CHECK(run.time(base) < 1.0);
  // The other seven are met in turn.
  for (int index = 2; index < 8; ++index) {
    REQUIRE(to_next_section(m, run, index, Vec<0>(), base, eighths, [](auto...) {}) == Status::ok);
    CHECK(std::abs(std::remainder(run.at.x[0] + (index + 1) * eighth, 2.0 * std::numbers::pi)) < 1e-12);
  }
  Ldtp<1, 0, 2, 8> system;
  CHECK(find_orbit<8>(m, base, eighths, system, 3).status == Status::failed);
}

TEST_CASE("section map: the tangent space of a section") {
  const Hopper<> m;
  const Point<Hopper<>> p = start_of(m);
  const Tangent<Hopper<>> clock = tangent_of(ClockPhases{}, 3, m, p, Vec<1>(0.0));
  CHECK(clock.dim == 4);
  CHECK(clock.out == 2);
  CHECK(clock.gradient == Vec<5>(0.0, 0.0, -1.0, 0.0, 0.0));
  CHECK(clock.coordinate(1) == 1);
  CHECK(clock.coordinate(2) == 3);
  const Tangent<Hopper<>> touchdown = tangent_of(AtEdge<hopper::Touchdown>{}, 0, m, p, Vec<1>(0.0));
  CHECK(touchdown.out == 3);
}
