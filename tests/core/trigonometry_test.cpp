#include "core/trigonometry.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "core/random.hpp"
#include "core/scalar.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

long double ulp(long double x) {
  const double d = std::fabs(static_cast<double>(x));
  return static_cast<long double>(std::nextafter(d, std::numeric_limits<double>::infinity())) - d;
}

// Largest error of either function [ulp], over the angles met.
struct Errors {
  long double sin = 0.0L, cos = 0.0L;

  void meet(double x) {
    const long double s = std::sin(static_cast<long double>(x)), c = std::cos(static_cast<long double>(x));
    sin = std::fmax(sin, std::fabs(saltus::sin(x) - s) / ulp(s));
    cos = std::fmax(cos, std::fabs(saltus::cos(x) - c) / ulp(c));
  }
};

}  // namespace

TEST_CASE("sine and cosine are within 0.85 ulp of long double's", "[trigonometry]") {
  if constexpr (std::numeric_limits<long double>::digits < 64) return;  // no better arithmetic to compare with
  Random random(1);
  for (const double largest : {1e-3, 0.8, 4.0, 100.0, 1e4, 1.6e6, 1e9, 1e15}) {
    Errors e;
    for (int i = 0; i < 50000; ++i) e.meet(largest * (2.0 * random.uniform() - 1.0));
    INFO(largest);
    CHECK(e.sin < 0.85L);
    CHECK(e.cos < 0.85L);
  }
}

TEST_CASE("next to the multiples of a quarter turn, where one of them nearly vanishes, within 1.1 ulp",
          "[trigonometry]") {
  if constexpr (std::numeric_limits<long double>::digits < 64) return;
  Errors e;
  for (int n = -1048000; n <= 1048000; n += n > -2000 && n < 2000 ? 1 : 97) {
    const double x = n * (0.5 * std::numbers::pi);
    e.meet(x);
    e.meet(std::nextafter(x, 1e9));
    e.meet(std::nextafter(x, -1e9));
  }
  CHECK(e.sin < 1.1L);
  CHECK(e.cos < 1.1L);
}

TEST_CASE("sine and cosine of odd arguments", "[trigonometry]") {
  CHECK(saltus::sin(0.0) == 0.0);
  CHECK(saltus::cos(0.0) == 1.0);
  CHECK(saltus::sin(5e-324) == 5e-324);
  for (const double x : {std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity(),
                         std::numeric_limits<double>::quiet_NaN()}) {
    CHECK(std::isnan(saltus::sin(x)));
    CHECK(std::isnan(saltus::cos(x)));
  }
  for (const double x : {1e17, 1e100, 1e300, std::numeric_limits<double>::max()}) {
    CHECK(std::fabs(saltus::sin(x)) <= 1.0);
    CHECK(std::fabs(saltus::sin(x) * saltus::sin(x) + saltus::cos(x) * saltus::cos(x) - 1.0) < 4e-16);
  }
}

TEST_CASE("a sine is one number however it is asked for", "[trigonometry]") {
  Random random(2);
  for (int i = 0; i < 10000; ++i) {
    const double x = 20.0 * random.uniform() - 10.0;
    CHECK(saltus::sin(-x) == -saltus::sin(x));
    CHECK(saltus::cos(-x) == saltus::cos(x));
    const auto p = on_circle(x);
    CHECK(p.sin == saltus::sin(x));
    CHECK(p.cos == saltus::cos(x));
    const auto s = sin(Dual<1>::variable(x, 0)), c = cos(Dual<1>::variable(x, 0));
    CHECK(s.value == p.sin);
    CHECK(s.gradient[0] == p.cos);
    CHECK(c.value == p.cos);
    CHECK(c.gradient[0] == -p.sin);
    CHECK(saltus::sin(static_cast<float>(x)) == static_cast<float>(saltus::sin(double{static_cast<float>(x)})));
  }
}
