#include "core/trace/statistics.hpp"

#include <cmath>

#include "tests/support/catch.hpp"

using namespace saltus;

TEST_CASE("tails agree with printed tables") {
  CHECK(std::abs(normal_tail(1.959963984540054) - 0.025) < 1e-14);
  CHECK(std::abs(normal_quantile(0.025) - 1.959963984540054) < 1e-12);
  CHECK(std::abs(student_tail(2.228138851986273, 10.0) - 0.025) < 1e-12);
  CHECK(std::abs(fisher_tail(3.3258345304130112, 5.0, 10.0) - 0.05) < 1e-12);
  CHECK(std::abs(fisher_tail(4.964602743730711, 1.0, 10.0) - 0.05) < 1e-12);
}

TEST_CASE("tails of closed form") {
  // Two and two degrees: P(F > f) = 1 / (1 + f). One degree: Cauchy.
  for (const double f : {0.1, 1.0, 7.0, 300.0}) CHECK(std::abs(fisher_tail(f, 2.0, 2.0) - 1.0 / (1.0 + f)) < 1e-13);
  for (const double t : {-2.0, 0.0, 0.5, 12.0}) {
    CHECK(std::abs(student_tail(t, 1.0) - (0.5 - std::atan(t) / 3.141592653589793)) < 1e-13);
  }
  // Many degrees: the ratio is nearly normal around 1 with variance 2/d1 + 2/d2.
  const double d = 30000.0, z = 2.0;
  CHECK(std::abs(fisher_tail(1.0 + z * std::sqrt(4.0 / d), d, d) - normal_tail(z)) < 2e-3);
}

TEST_CASE("the largest of many") {
  CHECK(std::abs(largest_of(1, 0.05) - 1.959963984540054) < 1e-9);
  const double z = largest_of(30, 0.01);
  CHECK(std::abs(std::pow(1.0 - 2.0 * normal_tail(z), 30.0) - 0.99) < 1e-12);
  CHECK(largest_of(30, 0.01, true) < z);
}
