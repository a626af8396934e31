#include "core/spectrum/lines.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <memory>
#include <set>
#include <vector>

#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

constexpr int capacity = 1000;
using Plan = Partition<capacity>;

// The rules as the paper prints them, by rational arithmetic on frequencies q / P.
bool allowed_alone(int q, int P) { return (2 * q) % P != 0; }
bool allowed_together(int a, int b, int P) { return (a - b) % P != 0 && (a + b) % P != 0; }

void check_rules(const Plan& plan, int last, int P) {
  std::set<int> met;
  for (int s = 0; s < plan.subsets; ++s) {
    std::vector<int> lines(capacity);
    lines.resize(static_cast<std::size_t>(plan.collect(s, lines)));
    CHECK_FALSE(lines.empty());
    for (std::size_t i = 0; i < lines.size(); ++i) {
      CHECK(allowed_alone(lines[i], P));
      CHECK(met.insert(lines[i]).second);
      for (std::size_t j = 0; j < i; ++j) CHECK(allowed_together(lines[i], lines[j], P));
    }
  }
  std::set<int> all;
  for (int q = 1; q <= last; ++q) {
    if (allowed_alone(q, P)) all.insert(q);
  }
  CHECK(met == all);
  CHECK(plan.lines == static_cast<int>(all.size()));
}

}  // namespace

TEST_CASE("identifiable, compatible and residue_class say what the paper's rules say", "[lines]") {
  for (const int P : {1, 2, 3, 4, 7, 8, 9, 64}) {
    for (int a = -2 * P; a <= 2 * P; ++a) {
      CHECK(identifiable(a, P) == allowed_alone(a, P));
      if (!identifiable(a, P)) continue;
      CHECK(residue_class(a, P) >= 1);
      CHECK(residue_class(a, P) <= (P - 1) / 2);
      for (int b = -2 * P; b <= 2 * P; ++b) CHECK(compatible(a, b, P) == allowed_together(a, b, P));
    }
  }
}

TEST_CASE("the hopper's band: 620 lines, 20 experiments of 31 tones and no fewer", "[lines]") {
  const int last = last_line_below(10.0, 64);
  REQUIRE(last == 639);
  auto plan = std::make_unique<Plan>();
  REQUIRE(optimal_partition(last, 64, *plan));
  CHECK(plan->lines == 620);
  CHECK(plan->subsets == 20);
  check_rules(*plan, last, 64);
  for (int s = 0; s < plan->subsets; ++s) {
    std::array<int, 40> lines{};
    REQUIRE(plan->collect(s, lines) == 31);
    std::set<int> classes;
    for (std::size_t i = 0; i < 31; ++i) classes.insert(residue_class(lines[i], 64));
    CHECK(classes.size() == 31);
    CHECK(*std::max_element(lines.begin(), lines.end()) > 320);  // every experiment spans the band
    CHECK(*std::min_element(lines.begin(), lines.begin() + 31) < 160);
  }

  // The certificate: twenty lines of which no two may share an experiment.
  std::vector<int> clique;
  for (int q = 1; q <= last; ++q) {
    if (identifiable(q, 64) && residue_class(q, 64) == plan->bound.residue) clique.push_back(q);
  }
  CHECK(static_cast<int>(clique.size()) == plan->bound.size);
  CHECK(plan->bound.size == plan->subsets);
  for (std::size_t i = 0; i < clique.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) CHECK_FALSE(allowed_together(clique[i], clique[j], 64));
  }
}

TEST_CASE("a random partition into 80 subsets obeys the rules, evenly, and follows its seed", "[lines]") {
  auto plan = std::make_unique<Plan>(), again = std::make_unique<Plan>(), other = std::make_unique<Plan>();
  REQUIRE(random_partition(639, 64, 80, 1, *plan));
  REQUIRE(random_partition(639, 64, 80, 1, *again));
  REQUIRE(random_partition(639, 64, 80, 2, *other));
  CHECK(plan->subsets == 80);
  check_rules(*plan, 639, 64);
  check_rules(*other, 639, 64);
  CHECK(plan->subset == again->subset);
  CHECK(plan->subset != other->subset);
  for (int s = 0; s < 80; ++s) {
    const int size = plan->collect(s, {});
    CHECK(size >= 7);
    CHECK(size <= 8);
  }
}

TEST_CASE("a random partition exists down to the largest class and is refused below it", "[lines]") {
  auto plan = std::make_unique<Plan>();
  CHECK(random_partition(639, 64, 20, 3, *plan));
  check_rules(*plan, 639, 64);
  CHECK_FALSE(random_partition(639, 64, 19, 3, *plan));
  CHECK(plan->lines == 0);
  CHECK(random_partition(639, 64, 620, 3, *plan));
  check_rules(*plan, 639, 64);
  CHECK_FALSE(random_partition(639, 64, 621, 3, *plan));
  CHECK_FALSE(random_partition(2000, 64, 80, 3, *plan));  // more lines than fit
  CHECK(plan->lines == 0);
}

TEST_CASE("half multiples are dealt twice, the constant once, and cost no more experiments below a whole band",
          "[lines]") {
  auto plan = std::make_unique<Plan>(), random = std::make_unique<Plan>();
  for (const int P : {3, 4, 5, 8, 15, 16, 33, 64}) {
    for (const int last : {1, P / 2, P - 1, P, P + 2, 3 * P + P / 3, 7 * P - 1, 7 * P}) {
      if (last < 1) continue;
      INFO(P << " cycles, lines up to " << last);
      REQUIRE(optimal_partition(last, P, *plan, true));
      REQUIRE(random_partition(last, P, plan->bound.size, 5, *random, true));
      CHECK(plan->subsets == plan->bound.size);
      for (const Plan* p : {plan.get(), random.get()}) {
        std::map<int, int> played;
        bool cycle_alone = false;
        for (int s = 0; s < p->subsets; ++s) {
          std::vector<int> lines(capacity);
          lines.resize(static_cast<std::size_t>(p->collect(s, lines)));
          bool pumped = false;
          for (std::size_t i = 0; i < lines.size(); ++i) {
            ++played[lines[i]];
            pumped = pumped || lines[i] % P == 0;
            for (std::size_t j = 0; j < i; ++j) CHECK(allowed_together(lines[i], lines[j], P));
          }
          cycle_alone = cycle_alone || !pumped;
        }
        CHECK(cycle_alone);
        CHECK(static_cast<int>(played.size()) == last + 1);
        for (const auto& [q, times] : played) CHECK(times == (q == 0 || allowed_alone(q, P) ? 1 : 2));
      }
      // The certificate: unknowns on the output lines of a class, against one equation an experiment.
      int most = 0;
      for (int r = 0; r <= P / 2; ++r) {
        int unknowns = r == 0 ? 1 : 0;  // the machine's own cycle
        for (int q = 0; q <= last; ++q) {
          if ((q - r) % P != 0 && (q + r) % P != 0) continue;
          unknowns += q != 0 && (2 * q) % P == 0 ? 2 : 1;
        }
        most = std::max(most, unknowns);
      }
      CHECK(plan->bound.size == most);
      if ((last + 1) % P == 0) CHECK(plan->bound.size == largest_class(last, P).size);
    }
  }
  CHECK_FALSE(random_partition(639, 64, 19, 3, *plan, true));
  CHECK_FALSE(optimal_partition(0, 64, *plan, true));
}

TEST_CASE("any band and any period, even or odd, whole or not", "[lines]") {
  auto plan = std::make_unique<Plan>();
  for (const int P : {3, 4, 5, 8, 15, 16, 33, 64}) {
    for (const int last : {1, P / 2, P - 1, P, P + 2, 3 * P + P / 3, 7 * P}) {
      const bool any = last >= 1;
      REQUIRE(optimal_partition(last, P, *plan) == any);
      if (!any) continue;
      check_rules(*plan, last, P);
      CHECK(plan->subsets == largest_class(last, P).size);
      REQUIRE(random_partition(last, P, plan->bound.size, 9, *plan));
      check_rules(*plan, last, P);
    }
  }
  CHECK_FALSE(optimal_partition(100, 2, *plan));  // every line is a multiple of half the pumping frequency
  CHECK_FALSE(optimal_partition(100, 1, *plan));
  CHECK_FALSE(optimal_partition(0, 64, *plan));
}
