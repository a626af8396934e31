#include "core/exponential.hpp"

#include <cmath>
#include <limits>

#include "core/random.hpp"
#include "core/scalar.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

long double ulp(long double x) {
  const double d = std::fabs(static_cast<double>(x));
  return static_cast<long double>(std::nextafter(d, infinity)) - d;
}

}  // namespace

TEST_CASE("exp is within 1 ulp of long double's, tanh within 2.5", "[exponential]") {
  if constexpr (std::numeric_limits<long double>::digits < 64) return;  // no better arithmetic to compare with
  Random random(1);
  for (const double largest : {1e-9, 1e-3, 0.4, 1.0, 5.0, 30.0, 745.0}) {
    long double of_exp = 0.0L, of_tanh = 0.0L;
    for (int i = 0; i < 100000; ++i) {
      const double x = largest * (2.0 * random.uniform() - 1.0);
      const long double e = std::exp(static_cast<long double>(x)), t = std::tanh(static_cast<long double>(x));
      if (e < std::numeric_limits<double>::max()) {
        of_exp = std::fmax(of_exp, std::fabs(saltus::exp(x) - e) / ulp(e));
      }
      of_tanh = std::fmax(of_tanh, std::fabs(saltus::tanh(x) - t) / ulp(t));
    }
    INFO(largest);
    CHECK(of_exp < 1.0L);
    CHECK(of_tanh < 2.5L);
  }
}

TEST_CASE("exp and tanh at their ends", "[exponential]") {
  CHECK(saltus::exp(0.0) == 1.0);
  CHECK(saltus::exp(1e-300) == 1.0);
  CHECK(saltus::exp(709.78) < infinity);
  CHECK(saltus::exp(709.79) == infinity);
  CHECK(saltus::exp(infinity) == infinity);
  CHECK(saltus::exp(-745.0) == std::numeric_limits<double>::denorm_min());
  CHECK(saltus::exp(-746.0) == 0.0);
  CHECK(saltus::exp(-infinity) == 0.0);
  CHECK(saltus::tanh(0.0) == 0.0);
  CHECK(saltus::tanh(1e-300) == 1e-300);
  CHECK(saltus::tanh(-21.99) == -1.0);
  CHECK(saltus::tanh(infinity) == 1.0);
  CHECK(saltus::tanh(-infinity) == -1.0);
  CHECK(std::isnan(saltus::exp(std::numeric_limits<double>::quiet_NaN())));
  CHECK(std::isnan(saltus::tanh(std::numeric_limits<double>::quiet_NaN())));
}

TEST_CASE("tanh is odd and never falls", "[exponential]") {
  double last = -1.0;
  bool odd = true, rises = true;
  for (int i = -240000; i <= 240000; ++i) {
    const double x = 1e-4 * i, t = saltus::tanh(x);
    odd = odd && saltus::tanh(-x) == -t;
    rises = rises && t >= last;
    last = t;
  }
  CHECK(odd);
  CHECK(rises);
}
