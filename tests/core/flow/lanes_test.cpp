#include "core/flow/lanes.hpp"

#include <bit>
#include <memory>

#include "core/random.hpp"
#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;

namespace {

template <class M>
bool same(const Run<M>& a, const Run<M>& b) {
  bool ok = a.at.chart == b.at.chart && a.tick == b.tick && a.ledger.count == b.ledger.count &&
            a.ledger.last_tick == b.ledger.last_tick &&
            std::bit_cast<std::uint64_t>(a.into) == std::bit_cast<std::uint64_t>(b.into);
  for (int i = 0; i < max_dim<M>; ++i) {
    ok = ok && (std::bit_cast<std::uint64_t>(a.at.x[i]) == std::bit_cast<std::uint64_t>(b.at.x[i]) ||
                (std::isnan(a.at.x[i]) && std::isnan(b.at.x[i])));
  }
  return ok;
}

// What came of lanes and of one after the other.
struct Beside {
  int differ = 0;               // lane-ticks
  int together = 0, apart = 0;  // events that all lanes had in a tick, and that only some had
  std::array<std::int64_t, status_count> statuses{};
};

// Each lane has a model, a start and an input of its own.
template <int W, class M, class Models, class Starts, class Push>
Beside beside(const Models& models, const Starts& starts, const Timebase& base, int ticks, const Push& push) {
  Beside result;
  const auto lanes = std::make_unique<LaneRuns<M, W>>(models);
  std::array<Run<M>, static_cast<std::size_t>(W)> runs = starts;
  for (int l = 0; l < W; ++l) lanes->set(l, runs[static_cast<std::size_t>(l)]);
  for (int i = 0; i < ticks; ++i) {
    typename LaneRuns<M, W>::U u;
    int events = 0;
    std::array<Status, static_cast<std::size_t>(W)> statuses{};
    for (int l = 0; l < W; ++l) {
      const auto at = static_cast<std::size_t>(l);
      Input<M> single;
      for (int k = 0; k < input_count<M>; ++k) {
        single[k] = push(l, i);
        u[k].set(l, single[k]);
      }
      const Passage r = step(models[at], runs[at], single, base);
      statuses[at] = r.status;
      ++result.statuses[static_cast<std::size_t>(r.status)];
      events += r.events > 0 ? 1 : 0;
    }
    (events == W ? result.together : events > 0 ? result.apart : events) += 1;
    lanes->step(u, base);
    const auto y = lanes->output(u);
    bool ok = true;
    for (int l = 0; l < W; ++l) {
      const auto at = static_cast<std::size_t>(l);
      Input<M> single;
      for (int k = 0; k < input_count<M>; ++k) single[k] = u[k][l];
      bool as_one = same(lanes->run(l), runs[at]) && lanes->status(l) == statuses[at];
      const Output<M> out = output_at(models[at], runs[at].at, single);
      for (int k = 0; k < output_count<M>; ++k) as_one = as_one && (y[k][l] == out[k] || std::isnan(out[k]));
      result.differ += as_one ? 0 : 1;
      ok = ok && statuses[at] == Status::ok;
    }
    result.differ += ok == lanes->ok() ? 0 : 1;
  }
  return result;
}

// A model that branches.
struct Line : Chart<1> {};
template <class S = double>
struct Branching {
  using Charts = List<Line>;
  using Edges = List<>;
  static constexpr std::string_view name = "branching";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"x", "-"}};
  S k = 1.0;
  static constexpr auto parameters() { return std::array{Parameter{"k", "-", &Branching::k}}; }
  Vec<1, S> flow(Line, const Vec<1, S>& x, const Vec<0, S>&) const noexcept {
    if (x[0] < 0.0) return Vec<1, S>(k);
    return Vec<1, S>(-k);
  }
  Vec<1, S> output(Line, const Vec<1, S>& x, const Vec<0, S>&) const noexcept { return x; }
  Start<Line, S> start() const noexcept { return {Vec<1, S>(S(0.0))}; }
};
// A steep pit: guards that are grazed, left at once, crossed several times in a tick, and lost.
struct Hole : Chart<2> {};
struct Floor : Edge<Hole, Hole> {};
struct Wall : Edge<Hole, Hole> {};
template <class S = double>
struct Pit {
  using Charts = List<Hole>;
  using Edges = List<Floor, Wall>;
  static constexpr std::string_view name = "pit";
  static constexpr bool branchless = true;
  static constexpr std::array inputs{Quantity{"u", "m/s^2"}};
  static constexpr std::array outputs{Quantity{"y", "m"}};
  S g = 9.81, e = 0.5, room = 1.0;
  static constexpr auto parameters() {
    return std::array{Parameter{"g", "m/s^2", &Pit::g}, Parameter{"e", "-", &Pit::e},
                      Parameter{"room", "m", &Pit::room}};
  }
  Vec<2, S> flow(Hole, const Vec<2, S>& x, const Vec<1, S>& u) const noexcept { return {x[1], u[0] - g}; }
  S guard(Floor, const Vec<2, S>& x, const Vec<1, S>&) const noexcept { return x[0]; }
  S guard(Wall, const Vec<2, S>& x, const Vec<1, S>&) const noexcept { return room - x[0]; }
  template <class E>
  Vec<2, S> reset(E, const Vec<2, S>& x, const Vec<1, S>&) const noexcept {
    return {x[0], -e * x[1]};
  }
  Vec<1, S> output(Hole, const Vec<2, S>& x, const Vec<1, S>&) const noexcept { return Vec<1, S>(x[0]); }
  Start<Hole, S> start() const noexcept { return {Vec<2, S>{1.0, 0.0}}; }
};
static_assert(check<Pit<>>());

template <int W>
void hoppers(int per_turn, int ticks, bool phases, bool parameters) {
  using M = Hopper<>;
  Random random(7);
  std::array<M, static_cast<std::size_t>(W)> models;
  std::array<Run<M>, static_cast<std::size_t>(W)> starts;
  for (int l = 0; l < W; ++l) {
    const auto at = static_cast<std::size_t>(l);
    if (parameters) models[at].k *= 1.0 + 0.02 * random.uniform();
    starts[at].at = start_of(models[at]);
    starts[at].at.x[0] += 0.05 * random.uniform();
  }
  const Timebase base = timebase_of(models[0], per_turn);
  if (phases) {
    for (int l = 0; l < W; ++l) {
      const auto at = static_cast<std::size_t>(l);
      for (int i = 0; i < 7 * l; ++i) step(models[at], starts[at], Input<M>(0.0), base);
    }
  }
  const auto r = beside<W, M>(models, starts, base, ticks, [&](int l, int i) { return 0.2 * sin(0.1 * i + l * l); });
  CHECK(r.differ == 0);
  CHECK(r.together + r.apart > ticks / per_turn);
  if (W > 1) CHECK(r.apart > 0);
}

}  // namespace

TEST_CASE("Hoppers side by side live as each does alone, to the last bit", "[lanes]") {
  hoppers<8>(64, 10000, false, false);
  hoppers<4>(64, 3000, true, true);
  hoppers<8>(512, 3000, true, true);
  hoppers<1>(64, 1000, false, false);
}

TEST_CASE("Lanes meet events in the same tick as well as in ticks of their own", "[lanes]") {
  using M = Hopper<>;
  std::array<M, 8> models;
  std::array<Run<M>, 8> starts;
  for (std::size_t l = 0; l < 8; ++l) {
    starts[l].at = start_of(models[l]);
    starts[l].at.x[0] += 1e-3 * static_cast<double>(l);
  }
  const auto r = beside<8, M>(models, starts, timebase_of(models[0], 64), 6400,
                              [](int l, int i) { return 0.01 * sin(i + 0.3 * l); });
  CHECK(r.differ == 0);
  CHECK(r.together > 100);
  CHECK(r.apart > 0);
}

TEST_CASE("Trouble in a lane is the trouble of a run alone", "[lanes]") {
  using M = Pit<>;
  std::array<M, 8> models;
  std::array<Run<M>, 8> starts;
  const double y[] = {1.0, 0.5, 0.1, -0.1, std::numeric_limits<double>::quiet_NaN(), 0.0, 1.0 - 0x1p-40, 0.3};
  const double v[] = {0.0, 3.0, 0.0, 0.0, 0.0, 1.0, 30.0, 1e300};
  for (std::size_t l = 0; l < 8; ++l) {
    models[l].e = 0.2 + 0.1 * static_cast<double>(l);
    starts[l].at.x << y[l], v[l];
  }
  starts[7].at.chart = 3;  // there is none
  const auto r = beside<8, M>(models, starts, Timebase{1.0, 16}, 400, [](int, int i) { return i > 300 ? 20.0 : 0.0; });
  CHECK(r.differ == 0);
  for (const Status s : {Status::ok, Status::zeno, Status::escaped, Status::diverged, Status::failed}) {
    INFO(name(s));
    CHECK(r.statuses[static_cast<std::size_t>(s)] > 0);
  }
}

TEST_CASE("A dip between two ticks, and one that is nearly grazed, are met as alone", "[lanes]") {
  using M = Pit<>;
  std::array<M, 8> models;
  std::array<Run<M>, 8> starts;
  // Parabolas whose bottom is in the middle of the tick: y = depth + (t - h/2)^2.
  constexpr double h = 1.0 / 16.0;
  const double depth[] = {0.1, 1e-3, 1e-6, 1e-10, 0.0, -1e-10, -1e-6, -1e-3};
  for (std::size_t l = 0; l < 8; ++l) {
    models[l].g = -2.0;
    models[l].room = 1e3;
    starts[l].at.x << depth[l] + h * h / 4.0, -h;
  }
  const auto r = beside<8, M>(models, starts, Timebase{1.0, 16}, 1, [](int, int) { return 0.0; });
  CHECK(r.differ == 0);
  CHECK(r.statuses[static_cast<std::size_t>(Status::grazing)] > 0);
  CHECK(r.apart == 1);
}

TEST_CASE("Only a model that says it never branches runs in lanes", "[lanes]") {
  static_assert(Branchless<Hopper<>>);
  static_assert(!Branchless<Branching<>>);
  static_assert(Branchless<Rebind<Hopper<>, Dual<3>>>);
}

TEST_CASE("Lanes do not allocate", "[lanes]") {
  using M = Hopper<>;
  LaneRuns<M, 8> lanes(std::array<M, 8>{});
  Run<M> run;
  run.at = start_of(M{});
  for (int l = 0; l < 8; ++l) lanes.set(l, run);
  const Timebase base = timebase_of(M{}, 64);
  LaneRuns<M, 8>::U u;
  const test::AllocationCount allocated;
  for (int i = 0; i < 1000; ++i) {
    for (int l = 0; l < 8; ++l) u[0].set(l, 0.01 * l);
    lanes.step(u, base);
    u[0] = lanes.output(u)[0] * 0.0;
  }
  CHECK(allocated() == 0);
}
