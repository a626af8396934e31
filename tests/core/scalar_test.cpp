#include "core/scalar.hpp"

#include <cmath>
#include <limits>
#include <utility>

#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

using D = Dual<2>;

// A function of two variables, its value and its gradient by central differences, against its dual number.
template <class F>
void differentiates(const F& f, double a, double b) {
  const D exact = f(D::variable(a, 0), D::variable(b, 1));
  CHECK(exact.value == f(a, b));
  const double h = 1e-6;
  const double da = (f(a + h, b) - f(a - h, b)) / (2.0 * h);
  const double db = (f(a, b + h) - f(a, b - h)) / (2.0 * h);
  CHECK(std::abs(exact.gradient[0] - da) < 1e-8 * (1.0 + std::abs(da)));
  CHECK(std::abs(exact.gradient[1] - db) < 1e-8 * (1.0 + std::abs(db)));
}

}  // namespace

TEST_CASE("dual numbers: every operation has its derivative") {
  for (const auto& [a, b] : {std::pair{1.3, 0.7}, std::pair{-0.4, 2.1}, std::pair{0.9, -1.6}}) {
    differentiates([](auto x, auto y) { return x + y; }, a, b);
    differentiates([](auto x, auto y) { return x - y; }, a, b);
    differentiates([](auto x, auto y) { return x * y; }, a, b);
    differentiates([](auto x, auto y) { return x / y; }, a, b);
    differentiates([](auto x, auto y) { return -x + y; }, a, b);
    differentiates([](auto x, auto y) { return 2.0 + x - (3.0 - y) * 4.0; }, a, b);
    differentiates([](auto x, auto y) { return (x - 2.0) * (0.5 * y + 1.0) / 7.0 + 3.0 / x; }, a, b);
    differentiates([](auto x, auto y) { return sin(x) * cos(y); }, a, b);
    differentiates([](auto x, auto y) { return exp(x * y) + tanh(x - y); }, a, b);
    differentiates([](auto x, auto y) { return log(x * x + 0.1) * sqrt(y * y + 0.2); }, a, b);
    differentiates([](auto x, auto y) { return abs(x) * abs(y); }, a, b);
    differentiates([](auto x, auto y) { return atan2(x, y); }, a, b);
    differentiates(
        [](auto x, auto y) {
          auto z = x;
          z += y;
          z *= x;
          z -= 2.0;
          z /= y;
          z *= 3.0;
          return z;
        },
        a, b);
  }
}

TEST_CASE("dual numbers: an operation on itself") {
  D x = D::variable(3.0, 0);
  const D& self = x;  // by another name, or the compiler warns
  x *= self;
  CHECK(x.value == 9.0);
  CHECK(x.gradient[0] == 6.0);
  x /= self;
  CHECK(x.value == 1.0);
  CHECK(x.gradient[0] == 0.0);
  x = D::variable(3.0, 0);
  x -= self;
  CHECK(x.value == 0.0);
  CHECK(x.gradient[0] == 0.0);
  x = D::variable(3.0, 0);
  x += self;
  CHECK(x.value == 6.0);
  CHECK(x.gradient[0] == 2.0);
}

TEST_CASE("dual numbers: comparisons look at the value") {
  const D x = D::variable(1.0, 0);
  CHECK(x == D(1.0));
  CHECK(x < 2.0);
  CHECK(x > D::variable(0.5, 1));
  CHECK(2.0 >= x);
  CHECK_FALSE(x < std::numeric_limits<double>::quiet_NaN());
  CHECK(x != 3.0);
}

TEST_CASE("dual numbers: the edges of the elementary functions") {
  CHECK(abs(D::variable(0.0, 0)).gradient[0] == 0.0);
  CHECK(abs(D::variable(-2.0, 0)).gradient[0] == -1.0);
  // A constant has no derivative, not even where the function is steep.
  CHECK(sqrt(D(0.0)).gradient[0] == 0.0);
  CHECK(std::isinf(sqrt(D::variable(0.0, 0)).gradient[0]));
  CHECK(sqrt(D::variable(0.0, 0)).gradient[1] == 0.0);
  CHECK(atan2(D(0.0), D(1.0)).gradient[0] == 0.0);
}

TEST_CASE("dual numbers: intermediate results may be kept by auto") {
  const D k = D::variable(2.0, 0);
  const D y = D::variable(0.5, 1);
  const auto force = k * (1.0 - y);  // an expression template would refer to a temporary here
  const auto twice = force + force;
  CHECK(twice.value == 2.0);
  CHECK(twice.gradient[0] == 1.0);
  CHECK(twice.gradient[1] == -4.0);
}

TEST_CASE("dual numbers: in vectors and matrices") {
  const Vec<2, D> x(D::variable(1.0, 0), D::variable(2.0, 1));
  Mat<2, 2> a;
  a << 1.0, 2.0, 3.0, 4.0;
  const Vec<2, D> y = a.cast<D>() * x * 2.0;
  CHECK(value_of(y) == Vec<2>(10.0, 22.0));
  CHECK(gradient_of(y) == Mat<2, 2>(2.0 * a));
  const D s = x.dot(x);
  CHECK(s.value == 5.0);
  CHECK(s.gradient[0] == 2.0);
  CHECK(s.gradient[1] == 4.0);
  CHECK(value_of(Vec<2>(3.0, 4.0)) == Vec<2>(3.0, 4.0));
}

TEST_CASE("scalars: elementary functions of float stay float") {
  static_assert(std::is_same_v<decltype(saltus::sin(1.0F)), float>);
  static_assert(std::is_same_v<decltype(saltus::atan2(1.0F, 2.0F)), float>);
  CHECK(std::abs(saltus::cos(0.5F) - std::cos(0.5F)) < 1e-7F);
  CHECK(value_of(0.5F) == 0.5);
}
