#include "core/orbit/rank.hpp"

#include <cmath>
#include <random>
#include <vector>

#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;

namespace {

using M4 = Mat<4, 4>;

// Of a given rank, with small whole numbers as entries.
M4 whole_numbers(int rank, std::mt19937_64& random) {
  std::uniform_int_distribution<int> entry(-3, 3);
  for (;;) {
    Mat<4, 4> left = M4::Zero();
    Mat<4, 4> right = M4::Zero();
    for (int i = 0; i < 4; ++i) {
      for (int k = 0; k < rank; ++k) {
        left(i, k) = entry(random);
        right(k, i) = entry(random);
      }
    }
    const M4 product = left * right;
    if (rank_of<4>(product, 1e-9).value == rank) return product;
  }
}

// Rank by exact elimination on whole numbers: no tolerance, another algorithm.
int exact_rank(const M4& matrix) {
  std::array<std::array<long long, 4>, 4> a{};
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j)
      a[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] = std::llround(matrix(i, j));
  }
  std::size_t rank = 0;
  for (std::size_t col = 0; col < 4 && rank < 4; ++col) {
    std::size_t pivot = rank;
    while (pivot < 4 && a[pivot][col] == 0) ++pivot;
    if (pivot == 4) continue;
    std::swap(a[pivot], a[rank]);
    for (std::size_t row = rank + 1; row < 4; ++row) {
      const long long p = a[rank][col];
      const long long q = a[row][col];
      for (std::size_t k = 0; k < 4; ++k) a[row][k] = p * a[row][k] - q * a[rank][k];
    }
    ++rank;
  }
  return static_cast<int>(rank);
}

Bounds bounds_of(const std::vector<int>& ranks, const std::vector<int>& interior) { return sylvester(ranks, interior); }
Bounds theorem(const std::vector<EdgeRank>& edges, std::size_t q) { return theorem4(edges, q); }

}  // namespace

TEST_CASE("the numerical rank is the exact one, whatever the noise below the tolerance") {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 40; ++trial) {
    const int wanted = trial % 5;
    const M4 clean = wanted == 0 ? M4(M4::Zero()) : whole_numbers(wanted, random);
    CHECK(exact_rank(clean) == wanted);
    M4 noise;
    for (int i = 0; i < 16; ++i) noise.data()[i] = normal(random);
    noise *= 1e-7 / noise.norm();
    const Rank<4> rank = rank_of<4>(M4(clean + noise), 1e-7);
    CHECK(rank.known());
    CHECK(rank.value == wanted);
    CHECK(rank.margin > 10.0);
    CHECK(std::is_sorted(rank.sigma.rbegin(), rank.sigma.rend()));
  }
}

TEST_CASE("a singular value near the tolerance leaves the rank undecided: a status, not a number") {
  M4 matrix = M4::Zero();
  matrix(0, 0) = 1.0;
  matrix(2, 1) = 3e-8;
  CHECK(rank_of<4>(matrix, 1e-10).value == 2);
  CHECK(rank_of<4>(matrix, 1e-7).value == 1);
  const Rank<4> doubtful = rank_of<4>(matrix, 1e-8);
  CHECK_FALSE(doubtful.known());
  CHECK(doubtful.value == -1);
  matrix(3, 3) = std::nan("");
  CHECK_FALSE(rank_of<4>(matrix, 1e-10).known());
  CHECK_FALSE(rank_of<4>(M4(M4::Zero()), std::nan("")).known());
  CHECK(rank_of<4>(M4(M4::Zero()), 0.0).value == 0);  // exactly zero, known exactly
}

TEST_CASE("a singular value within its error is zero where rounding explains it, or where it shrinks with the step") {
  const auto measured = [](double coarse, double fine, double rounding) {
    M4 a = M4::Zero();
    M4 b = M4::Zero();
    a(0, 0) = b(0, 0) = 1.0;
    a(1, 2) = coarse;
    b(1, 2) = fine;
    return Measured<4>{b, a, 1e-4, rounding, M4::Zero()};
  };
  const Bounds any{0, 4};
  CHECK(rank_of<4>(measured(1.6e-6, 1e-7, 1e-12), any).value == 1);  // fourth order
  CHECK(rank_of<4>(measured(1e-13, 1e-13, 1e-12), any).value == 1);  // rounding
  const Rank<4> stands = rank_of<4>(measured(1.001e-7, 1e-7, 1e-12), any);
  CHECK_FALSE(stands.known());  // the same with both steps: it looks like a number
  CHECK(stands.counted == 1);
  CHECK(rank_of<4>(measured(1e-7, 1e-6, 1e-12), any).status == Status::failed);
}

TEST_CASE("where a theorem leaves one rank it is that one, and numbers can only contradict it from above") {
  M4 matrix = M4::Zero();
  matrix(0, 0) = 1.0;
  matrix(1, 1) = 1e-9;  // too small to count
  const Measured<4> m{matrix, matrix, 1e-8, 1e-14, M4::Zero()};
  const Rank<4> proved = rank_of<4>(m, {2, 2});
  CHECK(proved.value == 2);
  CHECK(proved.counted == 1);
  CHECK(std::abs(proved.margin - 1e8) < 1.0);
  CHECK(rank_of<4>(m, {0, 1}).value == 1);  // beyond the upper bound all are zero
  CHECK_FALSE(rank_of<4>(m, {0, 2}).known());
  CHECK_FALSE(rank_of<4>(m, {0, 0}).known());  // one counts where none may
  // All below the lower bound look like zeros, and one is not: then none of them can be told.
  matrix(1, 1) = 0.0;
  CHECK_FALSE(rank_of<4>({matrix, matrix, 1e-8, 1e-14, M4::Zero()}, {2, 3}).known());
}

TEST_CASE("Sylvester's bounds hold for any chain, and are attained") {
  std::mt19937_64 random(5);
  std::uniform_int_distribution<int> any(0, 4);
  bool low = false;
  bool high = false;
  for (int trial = 0; trial < 300; ++trial) {
    const M4 a = whole_numbers(std::max(1, any(random)), random);
    const M4 b = whole_numbers(std::max(1, any(random)), random);
    const M4 c = whole_numbers(std::max(1, any(random)), random);
    const Bounds bounds = bounds_of({exact_rank(a), exact_rank(b), exact_rank(c)}, {4, 4});
    const int rank = exact_rank(M4(a * b)) == 0 ? 0 : rank_of<4>(M4(a * b * c), 1e-7).value;
    CHECK(bounds.contains(rank));
    low = low || (rank == bounds.lower && bounds.lower < bounds.upper);
    high = high || (rank == bounds.upper && bounds.lower < bounds.upper);
  }
  CHECK(low);
  CHECK(high);
  // Eq. 7 as printed subtracts every dimension: it would bound the rank of two regular (4 x 4) matrices by 4 + 4 - 8.
  CHECK(bounds_of({4, 4}, {4}) == Bounds{4, 4});
  CHECK(bounds_of({2, 1}, {4}) == Bounds{0, 1});
}

TEST_CASE("Lemma 3 and Theorem 4 give the bounds of both examples") {
  // The kneed biped: unlocked (6) to locked (4) with rank 4, back with rank 3.
  const std::vector<EdgeRank> biped{{6, 4, 4, false}, {4, 6, 3, true}};
  CHECK(decreasing_edges(biped) == 1);
  CHECK(lemma3(biped[0]) == Bounds{3, 3});
  CHECK(lemma3(biped[1]) == Bounds{3, 3});
  CHECK(theorem(biped, 0) == Bounds{3, 3});
  CHECK(theorem(biped, 1) == Bounds{1, 3});
  // The zero-rank example: the lower bounds -1 and 0 mean 0.
  const std::vector<EdgeRank> zero{{2, 3, 1, true}, {3, 2, 1, true}};
  CHECK(lemma3(zero[0]) == Bounds{1, 1});
  CHECK(lemma3(zero[1]) == Bounds{0, 1});
  CHECK(theorem(zero, 0) == Bounds{0, 1});
  CHECK(theorem(zero, 1) == Bounds{0, 1});
  // One chart, one edge: Theorem 3 when the image is transverse; else one direction may be lost.
  CHECK(theorem({{4, 4, 3, true}}, 0) == Bounds{3, 3});
  CHECK(theorem({{4, 4, 2, true}}, 0) == Bounds{2, 2});
  CHECK(theorem({{4, 4, 3, false}}, 0) == Bounds{2, 3});
}

TEST_CASE("Theorem 4 bounds random chains of resets and projections along the flow") {
  std::mt19937_64 random(9);
  std::uniform_int_distribution<int> any(1, 3);
  for (int trial = 0; trial < 200; ++trial) {
    // Two charts of dimension 4; an edge map is a projection along f of a reset: onto the plane of the last section.
    const auto edge = [&](int reset_rank, EdgeRank& e) {
      M4 reset = whole_numbers(reset_rank, random);
      reset.col(3).setZero();  // on the tangent space of the guard
      const int rank = exact_rank(reset);
      M4 project = M4::Identity();
      project(3, 3) = 0.0;
      // Transverse: the flow, e_3, is not in the image.
      M4 with_flow = reset;
      with_flow.col(3) = Vec<4>::Unit(3);
      e = {4, 4, rank, exact_rank(with_flow) == rank + 1};
      return M4(project * reset);
    };
    std::vector<EdgeRank> ranks(2);
    const M4 first = edge(any(random), ranks[0]);
    const M4 second = edge(any(random), ranks[1]);
    CHECK(lemma3(ranks[0]).contains(exact_rank(first)));
    CHECK(lemma3(ranks[1]).contains(exact_rank(second)));
    CHECK(theorem(ranks, 0).contains(exact_rank(M4(second * first))));
    CHECK(theorem(ranks, 1).contains(exact_rank(M4(first * second))));
  }
}

TEST_CASE("every zero multiplier has a reason, and the reasons add up") {
  const std::vector<EdgeRank> biped{{6, 4, 4, false}, {4, 6, 3, true}};
  const ZeroMultipliers unlocked = classify(biped, 0, 3, 3);
  CHECK(unlocked.section == 1);
  CHECK(unlocked.dimension == 2);
  CHECK(unlocked.reset + unlocked.chain + unlocked.nilpotent == 0);
  CHECK(unlocked.total() == 3);
  CHECK(classify(biped, 1, 3, 3).total() == 1);
  const std::vector<EdgeRank> zero{{2, 3, 1, true}, {3, 2, 1, true}};
  const ZeroMultipliers d1 = classify(zero, 0, 0, 0);
  CHECK(d1.chain == 1);
  CHECK(d1.nilpotent == 0);
  CHECK(d1.total() == 2);
  const ZeroMultipliers d2 = classify(zero, 1, 1, 0);
  CHECK(d2.dimension == 1);
  CHECK(d2.chain == 0);
  CHECK(d2.nilpotent == 1);
  CHECK(d2.total() == 3);
  const std::vector<EdgeRank> walker{{4, 4, 2, true}};
  CHECK(classify(walker, 0, 2, 2).reset == 1);
  CHECK(classify(walker, 0, 2, 2).total() == 2);
}

TEST_CASE("ranks do not allocate") {
  M4 matrix = M4::Identity();
  const test::AllocationCount allocated;
  const int rank = rank_of<4>(matrix, 1e-10).value;
  CHECK(allocated() == 0);
  CHECK(rank == 4);
}
