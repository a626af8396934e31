#include "core/spectrum/htf.hpp"

#include <array>
#include <cmath>
#include <memory>
#include <numbers>

#include "core/orbit/orbit.hpp"
#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"
#include "tests/support/table.hpp"

using namespace saltus;

namespace {

constexpr double turn = 2.0 * std::numbers::pi;

template <class Family>
std::unique_ptr<LdtpOf<Hopper<>, 32>> hopper_system(const Family& family) {
  const Hopper<> m;
  auto system = std::make_unique<LdtpOf<Hopper<>, 32>>();
  REQUIRE(find_orbit<32>(m, timebase_of(m, 512), family, *system).status == Status::ok);
  return system;
}

// Largest norm, over m and outputs, of the difference to the reference, over that of H_0; all m and lines of the table.
template <class Family>
double reference_error(const Family& family, const std::string& file) {
  const auto system = hopper_system(family);
  std::array<std::array<double, 2>, 7> squared{};
  std::array<double, 2> fundamental{};
  double at = -1.0;
  Harmonics<2, 1, 32> h;
  int rows = 0;
  for (const auto& row : test::table(file)) {
    const int m = std::stoi(row[0]);
    const double f = std::stod(row[1]);  // [cycles per period]
    const std::size_t output = row[2] == "vM" ? 1 : 0;
    const Complex expected(std::stod(row[3]), std::stod(row[4]));
    if (f != at) h = htf(*system, turn * f / 32.0);
    at = f;
    const Complex found = h(m)(static_cast<Eigen::Index>(output), 0);
    squared[static_cast<std::size_t>(m + 3)][output] += std::norm(found - expected);
    if (m == 0) fundamental[output] += std::norm(expected);
    ++rows;
  }
  CHECK(rows == 7 * 2 * 640);
  double worst = 0.0;
  for (const auto& one : squared) {
    for (std::size_t i = 0; i < 2; ++i) worst = std::fmax(worst, std::sqrt(one[i] / fundamental[i]));
  }
  return worst;
}

// Steady response of a system to e^{i w n}, by running it: y[n] e^{-i w n} over one cycle, then its Fourier sum.
template <int NX, int NU, int NY, int N>
Harmonics<NY, NU, N> by_running(const Ldtp<NX, NU, NY, N>& system, double omega, int cycles) {
  Harmonics<NY, NU, N> r;
  for (auto& h : r.h) h.setZero();
  for (int j = 0; j < NU; ++j) {
    Mat<NX, 1, Complex> x = Mat<NX, 1, Complex>::Zero();
    for (int n = 0; n < (cycles + 1) * N; ++n) {
      const auto k = static_cast<std::size_t>(n % N);
      const Complex u = std::polar(1.0, omega * n);
      if (n >= cycles * N) {
        const Mat<NY, 1, Complex> y = system.C[k].template cast<Complex>() * x + system.D[k].col(j) * u;
        for (int m = 0; m < N; ++m) {
          r(m).col(j) += y * std::polar(1.0 / N, -omega * n - turn * m * static_cast<double>(k) / N);
        }
      }
      x = (system.A[k].template cast<Complex>() * x + system.B[k].col(j) * u).eval();
    }
  }
  return r;
}

template <int NY, int NU, int N>
double distance(const Harmonics<NY, NU, N>& a, const Harmonics<NY, NU, N>& b) {
  double d = 0.0;
  for (int m = 0; m < N; ++m) d = std::fmax(d, (a(m) - b(m)).cwiseAbs().maxCoeff());
  return d;
}

// A system of one state: A = a, B = b(n), C = c(n), D = d(n).
template <int N, class B, class C, class D>
Ldtp<1, 1, 1, N> scalar_system(double a, B b, C c, D d) {
  Ldtp<1, 1, 1, N> s;
  for (int n = 0; n < N; ++n) {
    const auto i = static_cast<std::size_t>(n);
    s.dim[i] = 1;
    s.A[i](0, 0) = a;
    s.B[i](0, 0) = b(n);
    s.C[i](0, 0) = c(n);
    s.D[i](0, 0) = d(n);
  }
  return s;
}

}  // namespace

TEST_CASE("htf: the hopper's are those of the reference at every line and harmonic") {
  SECTION("isochrons") { CHECK(reference_error(ClockPhases{}, "hopper/htf_isochron.csv") < 1e-9); }
  SECTION("kinematic phase") { CHECK(reference_error(KinematicPhases{}, "hopper/htf_kinematic.csv") < 1e-9); }
}

TEST_CASE("htf: the impulse route agrees") {
  for (const double f : {0.015625, 0.3, 1.0, 3.4, 9.984375, -2.7}) {
    const double omega = turn * f / 32.0;
    const auto iso = hopper_system(ClockPhases{});
    CHECK(distance(htf(*iso, omega), htf_by_impulses(*iso, omega, 120)) < 1e-12);
    const auto kinematic = hopper_system(KinematicPhases{});
    CHECK(distance(htf(*kinematic, omega), htf_by_impulses(*kinematic, omega, 120)) < 1e-12);
  }
}

TEST_CASE("htf: running the system shows the same response") {
  const auto system = hopper_system(KinematicPhases{});
  for (const double f : {0.1, 0.5, 5.3}) {
    const double omega = turn * f / 32.0;
    CHECK(distance(htf(*system, omega), by_running(*system, omega, 120)) < 1e-11);
  }
}

TEST_CASE("htf: scalar systems in closed form") {
  constexpr int N = 12;
  const double a = 0.8;
  const auto one = [](int) { return 1.0; };
  const auto zero = [](int) { return 0.0; };
  const auto wave = [](int n) { return 0.7 * std::cos(turn * n / N); };
  for (const double omega : {0.0, 0.1, 1.3, 3.0, -0.4}) {
    const auto pole = [&](double w) { return 1.0 / (std::polar(1.0, w) - a); };
    Harmonics<1, 1, N> expected;
    const auto clear = [&] {
      for (auto& h : expected.h) h.setZero();
    };
    clear();  // time-invariant: no harmonic but the fundamental
    expected(0)(0, 0) = pole(omega) + 0.5;
    CHECK(distance(htf(scalar_system<N>(a, one, one, [](int) { return 0.5; }), omega), expected) < 1e-14);
    clear();  // a modulated output shifts what has passed the pole
    expected(1)(0, 0) = expected(-1)(0, 0) = 0.35 * pole(omega);
    CHECK(distance(htf(scalar_system<N>(a, one, wave, zero), omega), expected) < 1e-14);
    clear();  // a modulated input shifts before the pole
    expected(1)(0, 0) = 0.35 * pole(omega + turn / N);
    expected(-1)(0, 0) = 0.35 * pole(omega - turn / N);
    CHECK(distance(htf(scalar_system<N>(a, wave, one, zero), omega), expected) < 1e-14);
    clear();  // and a modulated feedthrough has no pole
    expected(0)(0, 0) = pole(omega);
    expected(1)(0, 0) = expected(-1)(0, 0) = 0.35;
    CHECK(distance(htf(scalar_system<N>(a, one, one, wave), omega), expected) < 1e-14);
  }
}

TEST_CASE("htf: several inputs, states and outputs, and a system that grows in part of its cycle") {
  constexpr int N = 5;
  Ldtp<3, 2, 2, N> s;
  for (int n = 0; n < N; ++n) {
    const auto i = static_cast<std::size_t>(n);
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) s.A[i](r, c) = (n == 2 ? 1.1 : 0.4) * std::sin(1.0 + 3.0 * r + 2.0 * c + 7.0 * n);
      for (int c = 0; c < 2; ++c) s.B[i](r, c) = std::cos(2.0 + r + 5.0 * c + 3.0 * n);
      for (int c = 0; c < 2; ++c) s.C[i](c, r) = std::sin(4.0 + 2.0 * r + c + n);
    }
    for (int c = 0; c < 2; ++c) s.D[i].col(c).setConstant(0.1 * n + c);
  }
  for (const double omega : {0.05, 0.9, 2.5}) {
    CHECK(distance(htf(s, omega), by_running(s, omega, 300)) < 1e-11);
    CHECK(distance(htf(s, omega), htf_by_impulses(s, omega, 300)) < 1e-11);
  }
  // A real system: the response at -omega is the conjugate, of the opposite harmonic.
  const auto plus = htf(s, 0.9);
  const auto minus = htf(s, -0.9);
  for (int m = -2; m <= 2; ++m) CHECK((plus(m) - minus(-m).conjugate()).norm() < 1e-13);
  // A whole turn more in omega shifts the harmonics by none; a section's share of it, by one.
  CHECK(distance(htf(s, 0.9 + turn), plus) < 1e-13);
}

TEST_CASE("htf: at a multiplier nothing is finite") {
  const auto one = [](int) { return 1.0; };
  const auto h = htf(scalar_system<4>(1.0, one, one, one), 0.0);
  CHECK_FALSE(std::isfinite(h(0)(0, 0).real()));
}

TEST_CASE("htf: nothing is allocated") {
  const auto system = hopper_system(ClockPhases{});
  const test::AllocationCount allocated;
  const auto h = htf(*system, 0.3);
  CHECK(allocated() == 0);
  CHECK(std::isfinite(h(0)(0, 0).real()));
}
