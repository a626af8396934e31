#include "core/least_squares.hpp"

#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

#include <Eigen/Dense>

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <random>
#include <type_traits>

namespace {

using saltus::LeastSquares;
using saltus::Status;

// The normal equations in long double: another algorithm, and digits enough for it to serve as the truth.
template <int N>
class Normal {
 public:
  void add(const std::array<double, static_cast<std::size_t>(N)>& row, double rhs, double weight) {
    Eigen::Matrix<long double, N, 1> a;
    for (int j = 0; j < N; ++j) a[j] = row[static_cast<std::size_t>(j)];
    gram_ += static_cast<long double>(weight) * a * a.transpose();
    moment_ += static_cast<long double>(weight) * static_cast<long double>(rhs) * a;
    square_ += static_cast<long double>(weight) * static_cast<long double>(rhs) * static_cast<long double>(rhs);
  }
  Eigen::Matrix<long double, N, 1> solution() const { return gram_.ldlt().solve(moment_); }
  Eigen::Matrix<long double, N, N> covariance() const {
    return gram_.ldlt().solve(Eigen::Matrix<long double, N, N>::Identity());
  }
  long double rss() const { return square_ - moment_.dot(solution()); }

 private:
  Eigen::Matrix<long double, N, N> gram_ = Eigen::Matrix<long double, N, N>::Zero();
  Eigen::Matrix<long double, N, 1> moment_ = Eigen::Matrix<long double, N, 1>::Zero();
  long double square_ = 0.0L;
};

double difference(double a, long double b) { return std::abs(static_cast<double>(static_cast<long double>(a) - b)); }

TEST_CASE("least squares agrees with the normal equations in long double", "[least_squares]") {
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 20; ++trial) {
    LeastSquares<6> fit;
    Normal<6> truth;
    for (int i = 0; i < 60; ++i) {
      std::array<double, 6> row;
      for (double& a : row) a = normal(random);
      const double rhs = normal(random);
      const double weight = 0.1 + std::abs(normal(random));
      REQUIRE(fit.add(row, rhs, weight) == Status::ok);
      truth.add(row, rhs, weight);
    }
    std::array<double, 6> x;
    REQUIRE(fit.solve(x) == Status::ok);
    for (int j = 0; j < 6; ++j) CHECK(difference(x[static_cast<std::size_t>(j)], truth.solution()[j]) < 1e-13);
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) CHECK(difference(fit.covariance(i, j), truth.covariance()(i, j)) < 1e-14);
    }
    CHECK(difference(fit.rss(), truth.rss()) < 1e-12);
    CHECK(fit.rows() == 60);
    CHECK(fit.rank() == 6);
  }
}

TEST_CASE("least squares gives the textbook straight line with its standard errors", "[least_squares]") {
  // y = 1, 3, 2, 5, 4 at t = 1..5: slope 0.8, intercept 0.6, rss 3.6; Sxx = 10, mean 3.
  LeastSquares<2> fit;
  const std::array<double, 5> y{1.0, 3.0, 2.0, 5.0, 4.0};
  for (std::size_t i = 0; i < 5; ++i) fit.add(std::array<double, 2>{1.0, static_cast<double>(i + 1)}, y[i]);
  std::array<double, 2> x;
  REQUIRE(fit.solve(x) == Status::ok);
  CHECK(std::abs(x[0] - 0.6) < 1e-14);
  CHECK(std::abs(x[1] - 0.8) < 1e-14);
  CHECK(std::abs(fit.rss() - 3.6) < 1e-13);
  CHECK(std::abs(fit.covariance(1, 1) - 0.1) < 1e-15);
  CHECK(std::abs(fit.covariance(0, 0) - (0.2 + 0.9)) < 1e-14);
  CHECK(std::abs(fit.covariance(0, 1) - -0.3) < 1e-15);
}

TEST_CASE("a weight of three is the same row three times", "[least_squares]") {
  LeastSquares<2> weighted, repeated;
  const std::array<std::array<double, 2>, 3> rows{{{1.0, 0.5}, {1.0, -2.0}, {1.0, 3.0}}};
  for (std::size_t i = 0; i < 3; ++i) {
    const double rhs = std::sin(static_cast<double>(i));
    weighted.add(rows[i], rhs, i == 1 ? 3.0 : 1.0);
    for (int k = 0; k < (i == 1 ? 3 : 1); ++k) repeated.add(rows[i], rhs);
  }
  std::array<double, 2> x, y;
  weighted.solve(x);
  repeated.solve(y);
  CHECK(std::abs(x[0] - y[0]) < 1e-15);
  CHECK(std::abs(x[1] - y[1]) < 1e-15);
  CHECK(std::abs(weighted.rss() - repeated.rss()) < 1e-15);
}

TEST_CASE("least squares loses digits as the condition, not as its square", "[least_squares]") {
  // Monomials up to degree 11 on [0, 1]: condition 1e8. The normal equations would keep no digit.
  LeastSquares<12> fit;
  for (int i = 0; i <= 200; ++i) {
    const double t = i / 200.0;
    std::array<double, 12> row;
    double power = 1.0;
    double rhs = 0.0;
    for (std::size_t j = 0; j < 12; ++j, power *= t) {
      row[j] = power;
      rhs += (j % 2 == 0 ? 1.0 : -2.0) * power;
    }
    fit.add(row, rhs);
  }
  std::array<double, 12> x;
  REQUIRE(fit.solve(x) == Status::ok);
  CHECK(fit.rank() == 12);
  for (std::size_t j = 0; j < 12; ++j) CHECK(std::abs(x[j] - (j % 2 == 0 ? 1.0 : -2.0)) < 1e-6);
  CHECK(fit.rss() < 1e-26);
}

TEST_CASE("a dependent column gets zero and costs the others nothing", "[least_squares]") {
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  LeastSquares<4> fit;
  LeastSquares<2> without;
  for (int i = 0; i < 40; ++i) {
    const double a = normal(random);
    const double b = normal(random);
    const double rhs = 2.0 * a - b + 0.1 * normal(random);
    fit.add(std::array<double, 4>{a, 3.0 * a, b, a + b}, rhs);
    without.add(std::array<double, 2>{a, b}, rhs);
  }
  std::array<double, 4> x;
  std::array<double, 2> y;
  REQUIRE(fit.solve(x) == Status::ok);
  REQUIRE(without.solve(y) == Status::ok);
  CHECK(fit.rank() == 2);
  CHECK(x[1] == 0.0);
  CHECK(x[3] == 0.0);
  CHECK(std::abs(x[0] - y[0]) < 1e-13);
  CHECK(std::abs(x[2] - y[1]) < 1e-13);
  CHECK(std::abs(fit.rss() - without.rss()) < 1e-13);
  CHECK(std::abs(fit.covariance(2, 2) - without.covariance(1, 1)) < 1e-14);
  CHECK(std::isinf(fit.covariance(1, 1)));
  CHECK(fit.covariance(1, 2) == 0.0);

  // Rows that tell the columns apart may still come.
  for (int i = 0; i < 40; ++i) {
    const std::array<double, 4> row{normal(random), normal(random), normal(random), normal(random)};
    fit.add(row, row[0] + 2.0 * row[1] - row[2] + 4.0 * row[3], 1e12);
  }
  REQUIRE(fit.solve(x) == Status::ok);
  CHECK(fit.rank() == 4);
  CHECK(std::abs(x[1] - 2.0) < 1e-9);
  CHECK(std::abs(x[3] - 4.0) < 1e-9);
}

TEST_CASE("fewer rows than columns leave the rest at zero", "[least_squares]") {
  LeastSquares<3> fit;
  std::array<double, 3> x{7.0, 7.0, 7.0};
  REQUIRE(fit.solve(x) == Status::ok);
  CHECK(fit.rank() == 0);
  CHECK(x == std::array<double, 3>{});
  fit.add(std::array<double, 3>{0.0, 2.0, 0.0}, 6.0);
  REQUIRE(fit.solve(x) == Status::ok);
  CHECK(x == std::array<double, 3>{0.0, 3.0, 0.0});
  CHECK(fit.rank() == 1);
  fit.reset();
  CHECK(fit.rank() == 0);
  CHECK(fit.rows() == 0);
  CHECK(fit.rss() == 0.0);
}

TEST_CASE("a row that is not finite, or weighs nothing, stays out whole", "[least_squares]") {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  constexpr double infinity = std::numeric_limits<double>::infinity();
  LeastSquares<2> fit;
  fit.add(std::array<double, 2>{1.0, 0.0}, 1.0);
  fit.add(std::array<double, 2>{0.0, 1.0}, 2.0);
  CHECK(fit.add(std::array<double, 2>{1.0, nan}, 1.0) == Status::missing);
  CHECK(fit.add(std::array<double, 2>{infinity, 1.0}, 1.0) == Status::missing);
  CHECK(fit.add(std::array<double, 2>{1.0, 1.0}, nan) == Status::missing);
  CHECK(fit.add(std::array<double, 2>{1.0, 1.0}, 1.0, 0.0) == Status::missing);
  CHECK(fit.add(std::array<double, 2>{1.0, 1.0}, 1.0, -1.0) == Status::missing);
  CHECK(fit.add(std::array<double, 2>{1.0, 1.0}, 1.0, nan) == Status::missing);
  CHECK(fit.add(std::array<double, 2>{1.0, 1.0}, 1.0, infinity) == Status::missing);
  CHECK(fit.rows() == 2);
  std::array<double, 2> x;
  REQUIRE(fit.solve(x) == Status::ok);
  CHECK(x == std::array<double, 2>{1.0, 2.0});
  CHECK(fit.rss() == 0.0);
}

TEST_CASE("a million rows neither drift nor allocate", "[least_squares]") {
  LeastSquares<4> fit;
  Normal<4> truth;
  static_assert(std::is_trivially_copyable_v<LeastSquares<4>>);
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::array<double, 4> x;
  const saltus::test::AllocationCount allocated;
  for (int i = 0; i < 1000000; ++i) {
    const double t = uniform(random);
    const std::array<double, 4> row{1.0, t, t * t, std::sin(9.0 * t)};
    const double rhs = 100.0 + t + uniform(random);
    fit.add(row, rhs);
    truth.add(row, rhs, 1.0);
  }
  REQUIRE(fit.solve(x) == Status::ok);
  const double variance = fit.covariance(3, 3);
  CHECK(allocated() == 0);
  CHECK(difference(variance, truth.covariance()(3, 3)) < 1e-12 * variance);
  for (int j = 0; j < 4; ++j) CHECK(difference(x[static_cast<std::size_t>(j)], truth.solution()[j]) < 1e-11);
  CHECK(difference(fit.rss(), truth.rss()) < 1e-11 * fit.rss());
}

TEST_CASE("least squares solves 128 columns, and in float", "[least_squares]") {
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  const auto wide = std::make_unique<LeastSquares<128>>();
  for (int i = 0; i < 400; ++i) {
    std::array<double, 128> row;
    double rhs = 0.0;
    for (std::size_t j = 0; j < 128; ++j) {
      row[j] = normal(random);
      rhs += row[j] * static_cast<double>(j);
    }
    wide->add(row, rhs);
  }
  std::array<double, 128> x;
  REQUIRE(wide->solve(x) == Status::ok);
  for (std::size_t j = 0; j < 128; ++j) CHECK(std::abs(x[j] - static_cast<double>(j)) < 1e-10);

  LeastSquares<2, float> narrow;
  for (int i = 0; i < 50; ++i) {
    const float t = static_cast<float>(i) / 50.0F;
    narrow.add(std::array<float, 2>{1.0F, t}, 2.0F - 3.0F * t);
  }
  std::array<float, 2> y;
  REQUIRE(narrow.solve(y) == Status::ok);
  CHECK(std::abs(y[0] - 2.0F) < 1e-5F);
  CHECK(std::abs(y[1] + 3.0F) < 1e-5F);
}

}  // namespace
