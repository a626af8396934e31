#include "sim/eigenvalues.hpp"

#include "tests/support/catch.hpp"

using namespace saltus;

TEST_CASE("Eigenvalues come by falling modulus, of a pair the one above the axis first") {
  Eigen::MatrixXd m = Eigen::MatrixXd::Zero(5, 5);
  m(0, 0) = 0.25;
  m.block<2, 2>(1, 1) << -0.3, -0.4, 0.4, -0.3;  // -0.3 +- 0.4 i, of modulus 0.5
  m(3, 3) = -2.0;
  m(0, 4) = 7.0;  // and a zero
  const auto z = eigenvalues(m);
  REQUIRE(z.size() == 5);
  const Complex expected[] = {-2.0, {-0.3, 0.4}, {-0.3, -0.4}, 0.25, 0.0};
  for (std::size_t i = 0; i < 5; ++i) CHECK(std::abs(z[i] - expected[i]) < 1e-14);
  CHECK(nonzero_multipliers(m).size() == 4);
}

TEST_CASE("What is no matrix of numbers has no eigenvalues") {
  CHECK(eigenvalues(Eigen::MatrixXd(0, 0)).empty());
  Eigen::MatrixXd m = Eigen::MatrixXd::Identity(2, 2);
  m(0, 1) = std::nan("");
  CHECK(eigenvalues(m).empty());
  CHECK(nonzero_multipliers(m).empty());
  CHECK(nonzero_multipliers(Eigen::MatrixXd::Zero(3, 3)).empty());
}
