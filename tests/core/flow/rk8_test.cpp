#include "core/flow/rk8.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "core/flow/linearise.hpp"
#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"
#include "tests/support/plain.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;
using namespace saltus::worlds;

namespace {

const Vec<1> still(0.0);

// A rooted tree, by its number in `trees`: the trees that hang from its root, in falling order.
struct Tree {
  std::vector<int> branches;
  int size = 1;
  double density = 1.0;  // Butcher's gamma: the size times that of every branch
};

// Every rooted tree of up to `largest` vertices.
std::vector<Tree> rooted_trees(int largest) {
  std::vector<Tree> trees{Tree{}};
  for (int size = 2; size <= largest; ++size) {
    const int known = static_cast<int>(trees.size());
    std::vector<std::vector<int>> open{{}};
    while (!open.empty()) {
      const std::vector<int> branches = open.back();
      open.pop_back();
      int used = 1;
      for (const int b : branches) used += trees[static_cast<std::size_t>(b)].size;
      if (used == size) {
        Tree t{branches, size, static_cast<double>(size)};
        for (const int b : branches) t.density *= trees[static_cast<std::size_t>(b)].density;
        trees.push_back(t);
        continue;
      }
      for (int b = 0; b < (branches.empty() ? known : branches.back() + 1); ++b) {
        if (used + trees[static_cast<std::size_t>(b)].size > size) continue;
        open.push_back(branches);
        open.back().push_back(b);
      }
    }
  }
  return trees;
}

// By how much the tableau misses each tree's order condition, sum_i b_i Phi_i = 1 / gamma (Butcher).
std::vector<double> defects(const std::vector<Tree>& trees) {
  constexpr std::size_t n = Rk8::stages;
  std::vector<std::array<long double, n + 1>> weight(trees.size());  // of each stage and of the end; the first has none
  std::vector<double> r;
  for (std::size_t t = 0; t < trees.size(); ++t) {
    std::array<long double, n> product;
    product.fill(1.0L);
    for (const int b : trees[t].branches) {
      for (std::size_t i = 0; i < n; ++i) product[i] *= weight[static_cast<std::size_t>(b)][i];
    }
    for (std::size_t i = 1; i <= n; ++i) {
      const auto& row = Rk8::tableau[i - 1];
      weight[t][i] = row[0] * product[0];
      for (std::size_t j = 1; j < i; ++j) weight[t][i] += row[j] * (product[j] - product[0]);
    }
    r.push_back(static_cast<double>(std::abs(weight[t][n] - 1.0L / static_cast<long double>(trees[t].density))));
  }
  return r;
}

// Slope of log error over log step, by least squares.
template <class Error>
double order(const std::vector<double>& steps, const Error& error) {
  double sx = 0.0, sy = 0.0, sxx = 0.0, sxy = 0.0;
  for (const double h : steps) {
    const double x = std::log(h), y = std::log(error(h));
    sx += x;
    sy += y;
    sxx += x * x;
    sxy += x * y;
  }
  const auto n = static_cast<double>(steps.size());
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

template <class Method, class M>
Point<M> after(const M& m, double T, int n) {
  Point<M> p = start_of(m);
  Status status = Status::ok;
  for (int i = 0; i < n; ++i) status = worse(status, advance<Method>(m, p, Input<M>(Input<M>::Zero()), T / n).status);
  CHECK(status == Status::ok);
  return p;
}

// The steps in which T seconds are made, from `first` of them to `last`.
std::vector<double> steps_of(double T, double first, double last) {
  std::vector<double> r;
  for (double n = first; n < last; n *= 1.07) r.push_back(T / std::floor(n));
  std::sort(r.begin(), r.end());
  r.erase(std::unique(r.begin(), r.end()), r.end());
  return r;
}

}  // namespace

TEST_CASE("rk8: the tableau meets all 200 conditions of order eight, and not all of order nine") {
  const std::vector<Tree> trees = rooted_trees(9);
  const std::vector<double> defect = defects(trees);
  std::map<int, int> count;
  double worst = 0.0, worst_of_nine = 0.0;
  for (std::size_t t = 0; t < trees.size(); ++t) {
    ++count[trees[t].size];
    double& w = trees[t].size <= 8 ? worst : worst_of_nine;
    w = std::fmax(w, defect[t]);
  }
  CHECK(count[1] + count[2] + count[3] + count[4] + count[5] + count[6] + count[7] + count[8] == 200);
  CHECK(count[8] == 115);
  CHECK(count[9] == 286);
  CHECK(worst < 2e-15);  // the rounding of its numbers, of up to 43
  CHECK(worst_of_nine > 1e-5);
}

TEST_CASE("rk8: one step is of order nine in its length, its last rate of order five, for eleven evaluations") {
  int calls = 0;
  const auto f = [&](const Vec<2>& x) -> Vec<2> {  // around the circle, nonlinear
    ++calls;
    return Vec<2>(-x[1], x[0]) * x.squaredNorm();
  };
  const Vec<2> x(1.0, 0.0), f0 = f(x);
  const std::vector<double> steps{0.15, 0.2, 0.3, 0.4, 0.5};
  Vec<2> f1;
  const double of_state = order(
      steps, [&](double h) { return (Rk8::step<2, double>(f, x, f0, h) - Vec<2>(std::cos(h), std::sin(h))).norm(); });
  CHECK(of_state > 8.8);
  CHECK(of_state < 9.4);
  const double of_rate = order(steps, [&](double h) {
    Rk8::step<2, double>(f, x, f0, h, f1);
    return (f1 - Vec<2>(-std::sin(h), std::cos(h))).norm();
  });
  CHECK(of_rate > 4.7);
  calls = 0;
  Rk8::step<2, double>(f, x, f0, 0.1);
  CHECK(calls == 11);
  // A constant rate is exact to the last bit.
  const auto drift = [](const Vec<1>&) { return Vec<1>(0.7); };
  for (const double h : {1.0, 1.0 / 3.0, 0.1}) {
    CHECK(Rk8::step<1, double>(drift, Vec<1>(0.3), Vec<1>(0.7), h)[0] == 0.3 + 0.7 * h);
  }
  // (t, x), t' = 1, x' = 8 t^7: the quadrature is exact to degree seven.
  const auto g = [](const Vec<2>& y) { return Vec<2>(1.0, 8.0 * std::pow(y[0], 7)); };
  const Vec<2> start(0.3, 0.0);
  CHECK(std::abs(Rk8::step<2, double>(g, start, g(start), 0.7)[1] - (1.0 - std::pow(0.3, 8))) < 2e-14);
}

TEST_CASE("rk8: order eight through events") {
  SECTION("spring and wall, closed form") {
    const Wall<> m;
    const double T = 4.0;  // three impacts
    // x = amplitude cos(angle), angle' = w, and the wall is where cos(angle) = -d / amplitude.
    double amplitude = 1.0, angle = 0.0, left = T;
    for (;;) {
      const double hit = std::acos(-m.d / amplitude), wait = (hit - angle) / m.w;
      if (wait > left) break;
      left -= wait;
      amplitude = std::hypot(m.d, m.e * amplitude * std::sin(hit));
      angle = -std::acos(-m.d / amplitude);
    }
    angle += m.w * left;
    const Vec<2> truth(amplitude * std::cos(angle), -amplitude * m.w * std::sin(angle));
    const double slope = order(steps_of(T, 16.0, 80.0), [&](double h) {
      return (after<Rk8>(m, T, static_cast<int>(std::lround(T / h))).x - truth).norm();
    });
    CHECK(slope > 7.6);
    CHECK(slope < 8.4);
  }
  SECTION("hopper's liftoff, closed form") {
    // M y'' = k (l0 - y) + a sin(omega t) - M g: a harmonic about y0 and a forced one.
    const Hopper<> m;
    const double w = std::sqrt(m.k / m.M), y0 = m.l0 - m.M * m.g / m.k;
    const double forced = m.a / m.M / (w * w - m.omega * m.omega), from = 0.3;  // [s]
    const Vec<3> start(1.6, 0.0, m.omega * from);
    const double A = start[0] - y0 - forced * std::sin(m.omega * from);
    const double B = (start[1] - forced * m.omega * std::cos(m.omega * from)) / w;
    const auto y = [&](double t) {
      return y0 + forced * std::sin(m.omega * (from + t)) + A * std::cos(w * t) + B * std::sin(w * t);
    };
    const auto force = [&](double t) { return m.k * (m.l0 - y(t)) + m.a * std::sin(m.omega * (from + t)) + m.m * m.g; };
    double lo = 0.0, hi = 0.5;
    REQUIRE(force(lo) > 0.0);
    REQUIRE(force(hi) < 0.0);
    for (int i = 0; i < 60; ++i) (force(0.5 * (lo + hi)) > 0.0 ? lo : hi) = 0.5 * (lo + hi);
    const double slope = order(steps_of(0.5, 2.0, 11.0), [&](double h) {
      Point<Hopper<>> p = at<Hopper<>>(hopper::Stance{}, start);
      for (double t = 0.0;; t += h) {
        const Passage r = advance<Rk8>(m, p, still, h);
        REQUIRE(r.status == Status::ok);
        if (r.events > 0) return std::abs(t + r.event[0].at - hi);
      }
    });
    CHECK(slope > 7.4);
    CHECK(slope < 8.6);
  }
  SECTION("hopper, against order four in steps a hundred times shorter") {
    const Hopper<> m;
    const Vec<5> truth = after<Rk4>(m, 1.0, 8192).x;
    CHECK((after<Rk8>(m, 1.0, 64).x - truth).norm() < 1e-11);
    CHECK((after<Rk8>(m, 1.0, 10).x - truth).norm() < 1e-8);
    CHECK((after<Rk4>(m, 1.0, 64).x - truth).norm() > 1e-8);
  }
}

TEST_CASE("rk8: a dip within one long step is taken, one that misses by a hair reported") {
  // x = -(1 + depth) cos(8 t) falls below -1 for a moment, in the middle of a step of 1/16 s.
  Wall<> m;
  m.w = 8.0;
  m.d = 1.0;
  const double h = 1.0 / 16.0, angle = 0.5 * m.w * h, scale = 0.5 * m.w * m.w * h * h;
  for (const double depth : {1e-2, 1e-4, 1.1e-6}) {
    for (const double sign : {1.0, -1.0}) {
      const double amplitude = 1.0 + sign * depth * scale;
      Point<Wall<>> p =
          at<Wall<>>(wall::Free{}, Vec<2>(-amplitude * std::cos(angle), -amplitude * m.w * std::sin(angle)));
      const Passage r = advance<Rk8>(m, p, still, h);
      CHECK(r.events == (sign > 0.0 ? 1 : 0));
      if (r.events == 1) {
        const double t = (angle - std::acos(1.0 / amplitude)) / m.w;  // of the touch
        CHECK(std::abs(r.event[0].at - t) < 1e-9 / std::sqrt(depth));
      }
    }
  }
  Point<Wall<>> p = at<Wall<>>(wall::Free{}, Vec<2>(-0.99999999 * std::cos(angle), -m.w * std::sin(angle)));
  const Passage r = advance<Rk8>(m, p, still, h);
  CHECK(r.status == Status::grazing);
}

TEST_CASE("rk8: the linearisation is the derivative of the interval, events and all") {
  const Hopper<> m;
  const auto interval = [&](const Vec<5>& x, double u) {
    Point<Hopper<>> p = at<Hopper<>>(hopper::Flight{}, x);
    CHECK(advance<Rk8>(m, p, Vec<1>(u), 0.125).events == 1);
    return p.x;
  };
  const Vec<5> x{1.7, -1.9, 2.0, 0.05, -1.0};
  Point<Hopper<>> p = at<Hopper<>>(hopper::Flight{}, x);
  Jacobian<Hopper<>> out;
  const Passage r = linearise<Rk8>(m, p, still, 0.125, out);
  CHECK(r.status == Status::ok);
  CHECK(p.x == interval(x, 0.0));
  const double d = 1e-6;
  for (int i = 0; i < 5; ++i) {
    const Vec<5> e = Vec<5>::Unit(i) * d;
    CHECK((out.state.col(i) - (interval(x + e, 0.0) - interval(x - e, 0.0)) / (2.0 * d)).norm() < 1e-7);
  }
  CHECK((out.input.col(0) - (interval(x, d) - interval(x, -d)) / (2.0 * d)).norm() < 1e-7);
}

TEST_CASE("rk8: a run allocates nothing, and its clock stands on the ticks") {
  const Hopper<> m;
  const Timebase base = timebase_of(m, 16);
  Run<Hopper<>> run;
  run.at = start_of(m);
  set_clock(run.at, base, 0);
  const test::AllocationCount allocated;
  for (int i = 0; i < 2000; ++i) step<Rk8>(m, run, still, base);
  CHECK(allocated() == 0);
  CHECK(run.ledger[Status::ok] == 2000);
  CHECK(run.at.x[2] == base.phase(2000));
}
