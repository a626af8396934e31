#include "core/spectrum/twiddles.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

// An ulp of x, in long double.
long double ulp(double x) {
  const double a = std::fabs(x);
  return static_cast<long double>(std::nextafter(a, std::numeric_limits<double>::infinity())) - a;
}

}  // namespace

TEST_CASE("every root of unity is within an ulp", "[twiddles]") {
  constexpr long double turn = 2.0L * std::numbers::pi_v<long double>;
  if constexpr (std::numeric_limits<long double>::digits < 64) return;  // no better arithmetic to compare with
  long double worst = 0.0L;
  for (const int n : {1, 2, 3, 5, 7, 8, 12, 100, 2047, 2048, 65537}) {
    for (int j = 0; j < n; ++j) {
      // The reference reduces to the nearest quarter turn, so that small parts keep their digits.
      const int quarter = (8 * j + n) / (2 * n);  // n < 2^28
      const long double rest =
          turn * static_cast<long double>(4LL * j - static_cast<long long>(quarter) * n) / (4.0L * n);
      const long double c = std::cos(rest), s = std::sin(rest);
      const long double x = quarter % 4 == 0 ? c : quarter % 4 == 1 ? -s : quarter % 4 == 2 ? -c : s;
      const long double y = quarter % 4 == 0 ? s : quarter % 4 == 1 ? c : quarter % 4 == 2 ? -s : -c;
      const Complex w = root_of_unity(j, n);
      worst = std::max(worst, std::fabs(w.real() - x) / ulp(w.real()));
      worst = std::max(worst, std::fabs(w.imag() - y) / ulp(w.imag()));
    }
  }
  CHECK(worst < 1.0L);
}

TEST_CASE("in single precision too", "[twiddles]") {
  double worst = 0.0;
  for (const int n : {1, 2, 3, 5, 7, 8, 12, 100, 2047, 2048, 65537}) {
    for (int j = 0; j < n; ++j) {
      const Complex exact = root_of_unity(j, n);
      const std::complex<float> w = root_of_unity<float>(j, n);
      const auto off = [&](double x, float y) {
        const float next = std::nextafter(std::fabs(y), std::numeric_limits<float>::infinity());
        return std::fabs(x - static_cast<double>(y)) / static_cast<double>(next - std::fabs(y));
      };
      worst = std::max({worst, off(exact.real(), w.real()), off(exact.imag(), w.imag())});
    }
  }
  CHECK(worst < 1.0);
  CHECK(root_of_unity<float>(3, 12) == std::complex<float>(0.0f, 1.0f));
  CHECK(root_of_unity<float>(-100, 2048) == std::conj(root_of_unity<float>(100, 2048)));
}

TEST_CASE("quarter turns and mirror images are exact", "[twiddles]") {
  CHECK(root_of_unity(0, 12) == Complex(1.0, 0.0));
  CHECK(root_of_unity(3, 12) == Complex(0.0, 1.0));
  CHECK(root_of_unity(6, 12) == Complex(-1.0, 0.0));
  CHECK(root_of_unity(9, 12) == Complex(0.0, -1.0));
  for (const int n : {8, 12, 2048}) {
    for (int j = 0; j < n; ++j) {
      const Complex w = root_of_unity(j, n);
      CHECK(root_of_unity(-j, n) == std::conj(w));
      CHECK(root_of_unity(j + n / 2, n) == -w);
      CHECK(root_of_unity(j + n / 4, n) == Complex(-w.imag(), w.real()));
    }
  }
}

TEST_CASE("an index is reduced alike whatever its size", "[twiddles]") {
  constexpr std::int64_t two31 = std::int64_t{1} << 31;
  for (const std::int64_t x :
       {std::int64_t{0}, std::int64_t{17}, std::int64_t{-17}, two31 - 1, two31, -two31, -two31 - 1, 977 * two31 + 5}) {
    for (const std::int64_t n : {std::int64_t{1}, std::int64_t{7}, two31 - 1, two31, 3 * two31}) {
      const std::int64_t r = wrap(x, n);
      CHECK(r >= 0);
      CHECK(r < n);
      CHECK((x - r) / n * n == x - r);
    }
  }
}

TEST_CASE("the table is looked up by the product of any two integers", "[twiddles]") {
  static Twiddles<2048> table;
  REQUIRE(table.configure(2047));
  CHECK(table.length() == 2047);
  constexpr std::int64_t far = std::numeric_limits<std::int64_t>::max();
  for (const std::int64_t a : {std::int64_t{0}, std::int64_t{1}, std::int64_t{-1}, std::int64_t{12345}, far, -far}) {
    for (const std::int64_t b : {std::int64_t{1}, std::int64_t{-639}, far}) {
      const int j = table.index(a, b);
      CHECK(j == ((a % 2047) * (b % 2047) % 2047 + 2047) % 2047);
      CHECK(table(a, b) == root_of_unity(j, 2047));
      CHECK(table(a, b) == Complex(table.cos(j), table.sin(j)));
    }
  }
  CHECK_FALSE(table.configure(2049));
  CHECK_FALSE(table.configure(0));
  CHECK(table.length() == 2047);
}
