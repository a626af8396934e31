#include "core/lanes.hpp"

#include <bit>
#include <cmath>
#include <limits>
#include <type_traits>
#include <vector>

#include "core/random.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

constexpr double nan_ = std::numeric_limits<double>::quiet_NaN();
constexpr double inf = std::numeric_limits<double>::infinity();

bool same(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b) || (std::isnan(a) && std::isnan(b));
}

// Quadrants and what lies beside them, far angles, zeros, what is not finite; and many at random, of every size.
std::vector<double> arguments() {
  std::vector<double> r{0.0,
                        -0.0,
                        nan_,
                        inf,
                        -inf,
                        5e-324,
                        -5e-324,
                        1e-310,
                        1.7e308,
                        -1.7e308,
                        22.0,
                        -22.0,
                        709.79,
                        710.0,
                        -745.3,
                        -740.0,
                        700.0,
                        -700.0,
                        0x1.921fb54442d18p+20,
                        1e6,
                        1e15,
                        0x1p50,
                        0x1p60};
  for (int q = -9; q <= 9; ++q) {
    const double x = q * 0x1.921fb54442d18p-1;
    for (const double y : {x, std::nextafter(x, 1e9), std::nextafter(x, -1e9), 1e5 * x}) r.push_back(y);
  }
  Random random(1);
  for (const double largest : {1e-8, 1.0, 10.0, 1e3, 1e6, 1e9, 1e20}) {
    for (int i = 0; i < 3000; ++i) r.push_back(largest * (2.0 * random.uniform() - 1.0));
  }
  while (r.size() % 32 != 0) r.push_back(1.0);
  return r;
}

// f, of anything, and of lanes of it.
template <int W, class F>
bool as_doubles(const F& f, const std::vector<double>& xs) {
  bool ok = true;
  for (std::size_t i = 0; i < xs.size(); i += W) {
    Lanes<W> x;
    for (int l = 0; l < W; ++l) x.set(l, xs[i + static_cast<std::size_t>(l)]);
    const Lanes<W> y = f(x);
    for (int l = 0; l < W; ++l) ok = ok && same(y[l], f(x[l]));
    const Lanes<W> alike = f(Lanes<W>(xs[i]));
    for (int l = 0; l < W; ++l) ok = ok && same(alike[l], f(xs[i]));
  }
  return ok;
}

template <int W>
void check_functions() {
  const std::vector<double> xs = arguments();
  CHECK(as_doubles<W>([](const auto& x) { return saltus::sin(x); }, xs));
  CHECK(as_doubles<W>([](const auto& x) { return saltus::cos(x); }, xs));
  CHECK(as_doubles<W>([](const auto& x) { return saltus::on_circle(x).sin; }, xs));
  CHECK(as_doubles<W>([](const auto& x) { return saltus::on_circle(x).cos; }, xs));
  CHECK(as_doubles<W>([](const auto& x) { return saltus::exp(x); }, xs));
  CHECK(as_doubles<W>([](const auto& x) { return saltus::tanh(x); }, xs));
  CHECK(as_doubles<W>([](const auto& x) { return saltus::sqrt(x); }, xs));
  CHECK(as_doubles<W>([](const auto& x) { return saltus::log(x); }, xs));
  CHECK(as_doubles<W>([](const auto& x) { return saltus::abs(x); }, xs));
  CHECK(as_doubles<W>([](const auto& x) { return saltus::atan2(x, x + 1.0); }, xs));
  CHECK(as_doubles<W>([](const auto& x) { return -x; }, xs));
  CHECK(as_doubles<W>([](const auto& x) { return (1.0 - x) * (x / 3.0) + (x + 0.1) / x; }, xs));
}

}  // namespace

TEST_CASE("Every lane of every function has the bits of a double", "[lanes]") {
  check_functions<1>();
  check_functions<2>();
  check_functions<4>();
  check_functions<8>();
  check_functions<16>();
}

TEST_CASE("A comparison of lanes is a choice in each, and no bool", "[lanes]") {
  using S = Lanes<4>;
  static_assert(!std::is_convertible_v<Mask<4>, bool> && !std::is_constructible_v<bool, Mask<4>>);
  S a, b;
  const double left[] = {1.0, 2.0, nan_, -0.0}, right[] = {2.0, 1.0, 1.0, 0.0};
  for (int l = 0; l < 4; ++l) {
    a.set(l, left[l]);
    b.set(l, right[l]);
  }
  CHECK((a < b).bits() == 0b0001u);
  CHECK((a > b).bits() == 0b0010u);
  CHECK((a <= b).bits() == 0b1001u);
  CHECK((a >= b).bits() == 0b1010u);
  CHECK((a == b).bits() == 0b1000u);
  CHECK((a != b).bits() == 0b0111u);
  CHECK(finite(a).bits() == 0b1011u);
  const S c = select(Mask<4>::of(0b0101u), a, b);
  for (int l = 0; l < 4; ++l) CHECK(same(c[l], l % 2 == 0 ? left[l] : right[l]));
  for (unsigned m = 0; m < 16; ++m) {
    CHECK(Mask<4>::of(m).bits() == m);
    CHECK(any(Mask<4>::of(m)) == (m != 0));
    CHECK(all(Mask<4>::of(m)) == (m == 15));
    CHECK((~Mask<4>::of(m)).bits() == 15 - m);
    CHECK((Mask<4>::of(m) & Mask<4>::of(6)).bits() == (m & 6));
    CHECK((Mask<4>::of(m) | Mask<4>::of(6)).bits() == (m | 6));
  }
}
