#include "core/spectrum/fit.hpp"

#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

#include <Eigen/Core>

#include <array>
#include <cmath>
#include <cstddef>
#include <fstream>
#include <limits>
#include <numbers>
#include <random>
#include <sstream>
#include <string>
#include <vector>

namespace {

using saltus::Complex;
using saltus::ImagePoleFit;
using saltus::RationalFit;
using saltus::ResponseSample;
using saltus::Status;

constexpr double pi = std::numbers::pi;

// `count` lines inside (0, band), band <= pi, on no special frequency.
template <class Response>
std::vector<ResponseSample> sampled(Response response, int count, double band) {
  std::vector<ResponseSample> samples;
  for (int i = 0; i < count; ++i) {
    const double omega = band * (i + 0.37) / count;
    samples.push_back({omega, response(omega), 1.0});
  }
  return samples;
}

// Adds white noise whose variance on a real number is `variance` / weight.
void disturb(std::vector<ResponseSample>& samples, double variance, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  for (ResponseSample& s : samples) {
    const double size = std::sqrt(variance / s.weight);
    const double re = size * normal(random);
    s.value += Complex(re, size * normal(random));
  }
}

double rms(const std::vector<ResponseSample>& samples) {
  double sum = 0.0;
  for (const ResponseSample& s : samples) sum += std::norm(s.value);
  return std::sqrt(sum / static_cast<double>(samples.size()));
}

// A scalar-input system of period 6 whose third state is forgotten at the turn of a period: x[n+1] = A[n] x[n] + B[n]
// u[n], y[n] = C[n] x[n]. Its return map has rank 2.
struct Periodic {
  static constexpr int period = 6;

  static Eigen::Matrix3d a(int n) {
    n %= period;
    Eigen::Matrix3d m;
    const double t = n + 1.0;
    m << 0.9, 0.3 * std::sin(t), 0.1, -0.35 + 0.02 * t, 0.95, 0.2 * std::cos(t), 0.3, 0.1 * t, 0.5;
    if (n == period - 1) m.row(2).setZero();  // dropped ...
    if (n == 0) m.col(2).setZero();           // ... and taken up anew
    return m;
  }
  static Eigen::Vector3d b(int n) { return {0.2 * (n % period), 1.0, 0.7 - 0.1 * (n % period)}; }
  static Eigen::RowVector3d c(int n) { return {1.0, std::cos(1.0 * (n % period)), 0.4}; }

  // Non-zero eigenvalues of the return map, from trace and determinant of its 2 x 2 part.
  static Complex multiplier() {
    Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
    for (int n = 0; n < period; ++n) m = a(n) * m;
    const double trace = m(0, 0) + m(1, 1);
    const double determinant = m(0, 0) * m(1, 1) - m(0, 1) * m(1, 0);
    return 0.5 * trace + std::sqrt(Complex(0.25 * trace * trace - determinant));
  }

  // H_0(omega) by its definition: the mean over the phase of the impulse responses h[n, n-r] (eq. 10, m = 0),
  // transformed.
  static std::vector<double> impulse() {
    std::vector<double> h(2400, 0.0);
    for (int k = 0; k < period; ++k) {
      Eigen::Vector3d x = b(k);
      for (std::size_t r = 1; r < h.size(); ++r) {
        const int n = k + static_cast<int>(r);
        h[r] += c(n).dot(x) / period;
        x = (a(n) * x).eval();
      }
    }
    return h;
  }
};

// Exact H_0 of the hopper, N = 32; `left_out` picks the multiples of half the pumping frequency instead of the 620
// lines.
std::vector<ResponseSample> hopper(const std::string& phase, const std::string& output, bool left_out = false) {
  std::ifstream file(std::string(SALTUS_TEST_DATA) + "/hopper/htf_" + phase + ".csv");
  REQUIRE(file);
  std::vector<ResponseSample> samples;
  std::string line;
  std::getline(file, line);
  while (std::getline(file, line)) {
    for (char& c : line) c = c == ',' ? ' ' : c;
    std::istringstream fields(line);
    int m = 0;
    double f = 0.0, re = 0.0, im = 0.0;
    std::string name;
    fields >> m >> f >> name >> re >> im;
    const long q = std::lround(64.0 * f);
    if (m == 0 && name == output && q < 640 && (q % 32 == 0) == left_out) {
      samples.push_back({2.0 * pi * f / 32.0, Complex(re, im), 1.0});
    }
  }
  REQUIRE(samples.size() == (left_out ? 19 : 620));
  return samples;
}

const Complex hopper_multiplier(-0.248983334736, 0.699333251798);

TEST_CASE("roots are found with their order and multiplicity", "[fit]") {
  const auto pair = saltus::roots(std::array<double, 2>{0.497966669472, 0.551059698116});
  CHECK(std::abs(pair[0] - std::conj(pair[1])) < 1e-15);
  CHECK(pair[0].imag() > 0.0);
  CHECK(std::abs(pair[0].real() + 0.248983334736) < 1e-15);

  // (x - 0.9)(x + 0.5)(x^2 - 0.4 x + 0.2)
  const auto four = saltus::roots(std::array<double, 4>{-0.8, -0.09, 0.1, -0.09});
  CHECK(std::abs(four[0] - 0.9) < 1e-14);
  CHECK(std::abs(four[1] + 0.5) < 1e-14);
  CHECK(four[1].imag() == 0.0);
  CHECK(std::abs(four[2] - Complex(0.2, 0.4)) < 1e-14);
  CHECK(std::abs(four[3] - Complex(0.2, -0.4)) < 1e-14);

  const auto twice = saltus::roots(std::array<double, 2>{-1.0, 0.25});
  CHECK(std::abs(twice[0] - 0.5) < 1e-7);
  CHECK(std::abs(twice[1] - 0.5) < 1e-7);
  const auto partly_zero = saltus::roots(std::array<double, 3>{-0.3, 0.0, 0.0});
  CHECK(std::abs(partly_zero[0] - 0.3) < 1e-14);
  CHECK(std::abs(partly_zero[2]) < 1e-7);
  CHECK(saltus::roots(std::array<double, 2>{0.0, 0.0})[1] == Complex{});
  CHECK(std::abs(saltus::roots(std::array<double, 1>{0.7})[0] + 0.7) < 1e-16);
}

TEST_CASE("the rational fit recovers two poles and a zero", "[fit]") {
  const Complex pole = std::polar(0.97, 0.21);
  const auto truth = [&](double omega) {
    const Complex z = std::polar(1.0, omega);
    return (0.3 * z - 0.1) / ((z - pole) * (z - std::conj(pole)));
  };
  const auto fit = saltus::fit_rational<8>(sampled(truth, 40, 2.0));
  CHECK(fit.status == Status::ok);
  CHECK(std::abs(fit.b[0] - 0.3) < 1e-12);
  CHECK(std::abs(fit.b[1] + 0.1) < 1e-12);
  CHECK(std::abs(fit.a[0] + 2.0 * pole.real()) < 1e-12);
  CHECK(std::abs(fit.a[1] - std::norm(pole)) < 1e-12);
  CHECK(std::abs(fit.poles[0] - pole) < 1e-12);
  CHECK(std::abs(fit.multipliers[1] - std::polar(std::pow(0.97, 8), -8 * 0.21)) < 1e-11);
  CHECK(fit.rms < 1e-12);
  for (const double omega : {0.01, 1.0, 3.0}) CHECK(std::abs(saltus::evaluate(fit, omega) - truth(omega)) < 1e-11);
}

TEST_CASE("the rational fit is a minimum of the cost itself", "[fit]") {
  // A third pole that the form does not have: Sanathanan-Koerner alone stops elsewhere.
  const auto truth = [](double omega) {
    const Complex z = std::polar(1.0, omega);
    return 1.0 / (z * z - 1.5 * z + 0.8) + 0.5 / (z + 0.6);
  };
  const auto samples = sampled(truth, 60, 3.0);
  const auto fit = saltus::fit_rational<4>(samples);
  REQUIRE(fit.status == Status::ok);
  const auto cost = [&](const RationalFit<4>& f) {
    double sum = 0.0;
    for (const ResponseSample& s : samples) sum += std::norm(s.value - saltus::evaluate(f, s.omega));
    return sum;
  };
  CHECK(std::abs(cost(fit) - fit.cost) < 1e-12 * fit.cost);
  CHECK(std::abs(fit.rms - std::sqrt(fit.cost / 60.0)) < 1e-12 * fit.rms);
  for (std::size_t i = 0; i < 4; ++i) {
    RationalFit<4> up = fit;
    RationalFit<4> down = fit;
    (i < 2 ? up.b[i] : up.a[i - 2]) += 1e-4;
    (i < 2 ? down.b[i] : down.a[i - 2]) -= 1e-4;
    CHECK(cost(up) > fit.cost);
    CHECK(cost(down) > fit.cost);
    const double curvature = cost(up) + cost(down) - 2.0 * fit.cost;
    CHECK(std::abs(cost(up) - cost(down)) < 1e-2 * curvature);
  }
}

TEST_CASE("the image poles are exact for a periodic system with a drop of rank", "[fit]") {
  const std::vector<double> impulse = Periodic::impulse();
  REQUIRE(std::abs(Periodic::multiplier()) < 0.95);
  REQUIRE(std::abs(Periodic::multiplier().imag()) > 0.1);
  const auto truth = [&](double omega) {
    Complex sum{};
    for (std::size_t r = 0; r < impulse.size(); ++r)
      sum += impulse[r] * std::polar(1.0, -omega * static_cast<double>(r));
    return sum;
  };
  for (const double band : {pi, 0.7 * pi}) {
    const auto fit = saltus::fit_image_poles<6, 2>(sampled(truth, 120, band));
    CHECK(fit.status == Status::ok);
    CHECK(std::abs(fit.multipliers[0] - Periodic::multiplier()) < 1e-11);
    CHECK(std::abs(fit.multipliers[1] - std::conj(Periodic::multiplier())) < 1e-11);
    CHECK(fit.sigma[0] < 1e-12);
    for (const double part : {0.1, 0.5, 0.9}) {
      CHECK(std::abs(saltus::evaluate(fit, part * band) - truth(part * band)) < 1e-10);
    }
  }
}

TEST_CASE("the image poles are exact for one multiplier and for four", "[fit]") {
  const auto one = [](double omega) {
    const Complex w = std::polar(1.0, -3.0 * omega);
    return (1.0 + 2.0 * std::polar(1.0, -omega) + 0.5 * w * w / std::polar(1.0, -omega)) / (1.0 + 0.7 * w);
  };
  const auto first = saltus::fit_image_poles<3, 1>(sampled(one, 40, 3.0));
  CHECK(first.status == Status::ok);
  CHECK(std::abs(first.multipliers[0] + 0.7) < 1e-13);
  CHECK(std::abs(first.b[0] - 1.0) < 1e-12);
  CHECK(std::abs(first.b[1] - 2.0) < 1e-12);

  const auto four = [](double omega) {
    const Complex w = std::polar(1.0, -4.0 * omega);
    const Complex numerator = 1.0 + std::polar(1.0, -omega) - 0.3 * std::polar(1.0, -5.0 * omega);
    return numerator / ((1.0 - 0.9 * w) * (1.0 + 0.5 * w) * (1.0 - 0.4 * w + 0.2 * w * w));
  };
  const auto fourth = saltus::fit_image_poles<4, 4>(sampled(four, 150, 3.1));
  CHECK(fourth.status == Status::ok);
  CHECK(std::abs(fourth.multipliers[0] - 0.9) < 1e-10);
  CHECK(std::abs(fourth.multipliers[1] + 0.5) < 1e-10);
  CHECK(std::abs(fourth.multipliers[2] - Complex(0.2, 0.4)) < 1e-10);
}

TEST_CASE("the hopper's multipliers come out of its exact H_0", "[fit]") {
  struct Case {
    const char* phase;
    const char* output;
    double least, most;  // what two poles and a zero leave wrong: a model error, so it must neither grow nor vanish
  };
  for (const Case& c : {Case{"isochron", "yM", 2e-3, 3e-3}, Case{"isochron", "vM", 9e-3, 1.2e-2},
                        Case{"kinematic", "yM", 2e-3, 3e-3}, Case{"kinematic", "vM", 8e-3, 1.2e-2}}) {
    CAPTURE(c.phase, c.output);
    const auto samples = hopper(c.phase, c.output);
    const auto rational = saltus::fit_rational<32>(samples);
    CHECK(rational.status == Status::ok);
    CHECK(std::abs(rational.multipliers[0] - hopper_multiplier) > c.least);
    CHECK(std::abs(rational.multipliers[0] - hopper_multiplier) < c.most);

    const auto exact = saltus::fit_image_poles<32, 2>(samples);
    CHECK(exact.status == Status::ok);
    CHECK(std::abs(exact.multipliers[0] - hopper_multiplier) < 1e-12);  // the digits the reference has
    CHECK(exact.rms < 1e-12 * rms(samples));
    // Lines that no single cosine can measure, and that the fit has not seen.
    for (const ResponseSample& s : hopper(c.phase, c.output, true)) {
      CHECK(std::abs(saltus::evaluate(exact, s.omega) - s.value) < 1e-9 * rms(samples));
    }
  }
}

TEST_CASE("the hopper's multipliers survive noise with the standard error stated", "[fit]") {
  std::mt19937_64 random(21);
  for (const double noise : {1e-6, 1e-2}) {
    auto samples = hopper("isochron", "vM");
    disturb(samples, 0.5 * std::pow(noise * rms(samples), 2), random);
    const auto fit = saltus::fit_image_poles<32, 2>(samples);
    CHECK(fit.status == Status::ok);
    CHECK(fit.sigma[0] < 0.03 * noise);
    CHECK(std::abs(fit.multipliers[0] - hopper_multiplier) < 3.0 * fit.sigma[0]);
    for (const double b : fit.b) CHECK(std::abs(b) < rms(samples));
  }
}

// Mean over 200 seeds of |error|^2 / sigma^2, which is 1 for an honest sigma with a standard error below 0.1.
template <class Fit, class Search>
double honesty(std::vector<ResponseSample> exact, double variance, Complex truth, Search search) {
  double sum = 0.0;
  for (unsigned seed = 1; seed <= 200; ++seed) {
    std::mt19937_64 random(seed);
    auto samples = exact;
    disturb(samples, variance, random);
    const Fit fit = search(samples);
    CHECK(fit.status == Status::ok);
    sum += std::norm((fit.multipliers[0] - truth) / fit.sigma[0]) / 200.0;
  }
  return sum;
}

TEST_CASE("errors are as large as the standard error says, over 200 seeds", "[fit]") {
  const auto rational = [](double omega) {
    const Complex z = std::polar(1.0, omega);
    return (0.3 * z - 0.1) / (z * z - 1.8 * z + 0.9);
  };
  const Complex pole(0.9, 0.3);
  auto samples = sampled(rational, 60, 2.0);
  for (std::size_t i = 0; i < samples.size(); ++i) samples[i].weight = i % 2 == 0 ? 1.0 : 25.0;
  const double first = honesty<RationalFit<8>>(samples, 1e-4, std::pow(pole, 8), saltus::fit_rational<8>);
  CHECK(first > 0.75);
  CHECK(first < 1.25);

  const auto image = [](double omega) {
    const Complex z = std::polar(1.0, -omega);
    const Complex w = z * z * z * z;
    return (z + 0.5 * z * z - 0.4 * w + 0.3 * w * w * z) / (1.0 + 0.5 * w + 0.55 * w * w);
  };
  const Complex multiplier(-0.25, std::sqrt(0.55 - 0.0625));
  for (const double band : {pi, 0.65 * pi}) {
    const double second =
        honesty<ImagePoleFit<4, 2>>(sampled(image, 100, band), 1e-3, multiplier, saltus::fit_image_poles<4, 2>);
    CHECK(second > 0.75);
    CHECK(second < 1.25);
  }
}

TEST_CASE("a missing sample is left out and said to be", "[fit]") {
  auto samples = sampled([](double omega) { return 1.0 / (std::polar(1.0, 2.0 * omega) - 0.5); }, 30, 3.0);
  samples[4].value = {std::numeric_limits<double>::quiet_NaN(), 0.0};
  samples[7].weight = 0.0;
  const auto rational = saltus::fit_rational<2>(samples);
  CHECK(rational.status == Status::missing);
  CHECK(std::abs(rational.multipliers[0] - 0.5) < 1e-12);
  const auto image = saltus::fit_image_poles<2, 1>(samples);
  CHECK(image.status == Status::missing);
  CHECK(std::abs(image.multipliers[0] - 0.5) < 1e-12);
}

TEST_CASE("a fit that the samples do not determine fails", "[fit]") {
  const auto first_order = [](double omega) { return 1.0 / (std::polar(1.0, 2.0 * omega) - 0.5); };
  const auto few = saltus::fit_rational<2>(sampled(first_order, 2, 3.0));
  CHECK(few.status == Status::failed);
  CHECK(std::isinf(few.sigma[0]));
  CHECK(saltus::fit_rational<2>({}).status == Status::failed);
  CHECK(saltus::fit_image_poles<2, 1>(sampled(first_order, 2, 3.0)).status == Status::failed);
  CHECK(saltus::fit_rational<2>(sampled([](double) { return Complex{}; }, 30, 3.0)).status == Status::failed);

  // One multiplier, two sought: any second one cancels in numerator and denominator.
  const auto too_many = saltus::fit_image_poles<2, 2>(sampled(first_order, 40, 3.0));
  CHECK((too_many.status == Status::failed || too_many.sigma[1] > 1e-2));
}

TEST_CASE("the fits do not allocate", "[fit]") {
  const auto samples = sampled([](double omega) { return 1.0 / (std::polar(1.0, 2.0 * omega) - 0.5); }, 30, 3.0);
  const saltus::test::AllocationCount allocated;
  const auto rational = saltus::fit_rational<2>(samples);
  const auto image = saltus::fit_image_poles<2, 1>(samples);
  CHECK(allocated() == 0);
  CHECK(rational.status == Status::ok);
  CHECK(image.status == Status::ok);
}

}  // namespace
