#include "sim/class_correlation.hpp"

#include <cmath>
#include <memory>
#include <vector>

#include "core/random.hpp"
#include "sim/campaign.hpp"
#include "sim/models/hopper_orbit.hpp"
#include "sim/record_identification.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using namespace saltus;

namespace {

Complex circular_draw(Random& random) {  // E |z|^2 = 1
  const double re = random.normal(), im = random.normal();
  return Complex{re, im} / std::sqrt(2.0);
}

}  // namespace

TEST_CASE("the estimator keeps the covariance of a class that its lines have, period by period", "[classes]") {
  constexpr int per_cycle = 8, per_period = 5, periods = 6, length = per_cycle * per_period;
  using Estimator = ClassEstimator<3, 2, 2, per_cycle, 8>;
  const auto estimator = std::make_unique<Estimator>();
  const std::vector<int> tones{1, 7};
  for (int round = 0; round < 2; ++round) {  // the second time nothing of the first is left
    REQUIRE(estimator->configure(per_cycle, per_period, tones, 1) == Status::ok);
    Random random(5 + static_cast<std::uint64_t>(round));
    std::vector<std::array<double, 2>> y;
    for (int n = 0; n < periods * length; ++n) {
      const double a = random.normal(), b = random.normal();
      y.push_back({a, 0.3 * a + b});
      const test::AllocationCount allocated;
      REQUIRE(estimator->push(n, y.back()) == Status::ok);
      CHECK(allocated() == 0);
    }
    // By definition: Y = (1/L) sum y exp(-2 pi i q n / L) of each period, then the two-pass sums.
    const auto line = [&](int r, int q, std::size_t c) {
      Complex sum{};
      for (int n = 0; n < length; ++n) {
        const double angle = -2.0 * std::numbers::pi * q * n / length;
        sum += y[static_cast<std::size_t>(r * length + n)][c] * std::polar(1.0, angle) / double(length);
      }
      return sum;
    };
    for (int k = 0; k < 2; ++k) {
      const int q = tones[static_cast<std::size_t>(k)];
      for (const auto& [l, c, l2, c2] : {std::array{0, 0, 0, 0}, {-1, 0, 1, 1}, {1, 1, 0, 0}, {1, 1, 1, 1}}) {
        Complex first{}, second{}, sum{};
        for (int r = 0; r < periods; ++r) {
          first += line(r, q + l * per_period, static_cast<std::size_t>(c)) / double(periods);
          second += line(r, q + l2 * per_period, static_cast<std::size_t>(c2)) / double(periods);
        }
        for (int r = 0; r < periods; ++r) {
          sum += (line(r, q + l * per_period, static_cast<std::size_t>(c)) - first) *
                 std::conj(line(r, q + l2 * per_period, static_cast<std::size_t>(c2)) - second) / double(periods - 1);
        }
        CHECK(std::abs(estimator->covariance(k, l, c, l2, c2) - sum) < 1e-12);
      }
      CHECK(std::abs(estimator->covariance(k, 1, 0, 1, 0) - estimator->variance(k, 1, 0)) < 1e-12);
    }
  }
}

TEST_CASE("classes are pooled with their neighbours until they are known well enough", "[classes]") {
  // Two rows, the second 0.6 i of the first and 0.8 of its own: a correlation E e_0 e_1* of -0.6 i.
  Random random(11);
  ClassScatter scatter;
  for (int line = 0; line < 400; line += 2) {
    std::vector<Eigen::VectorXcd> periods;
    for (int r = 0; r < 4; ++r) {
      const Complex a = circular_draw(random), b = circular_draw(random);
      Eigen::VectorXcd y(2);
      y << 5.0 + a, 3.0 * (Complex(0.0, 0.6) * a + 0.8 * b);
      periods.push_back(y);
    }
    scatter.add(line, 0, periods);
  }
  Complex mean{};
  for (int line = 40; line < 360; line += 16) {
    const ClassCorrelation c = scatter.correlation(line);
    CHECK(c.line == line);
    CHECK(c.harmonics == 0);
    CHECK(c.freedom == 15.0);  // itself, and two on either side
    CHECK(c.own == 3.0);
    CHECK(std::abs(c.matrix(0, 0) - 1.0) < 1e-15);
    CHECK(std::abs(c.matrix(0, 1) - std::conj(c.matrix(1, 0))) < 1e-15);
    mean += c.matrix(0, 1) / 20.0;
  }
  // 20 x 15 degrees of freedom: a correlation of 0.6 is known to about 0.8 / sqrt(300), and biased by less.
  CHECK(std::abs(mean - Complex(0.0, -0.6)) < 0.12);
  CHECK(scatter.correlation(41).freedom == 12.0);  // between two lines: two on either side
  CHECK(scatter.correlation(-5).freedom == 12.0);  // beyond the last: the nearest four
  CHECK(scatter.correlation(-5).own == 0.0);
  CHECK(ClassScatter{}.correlation(3).freedom == 0.0);

  ClassScatter twice = scatter;
  twice.append(scatter);
  CHECK(twice.correlation(100).freedom == 18.0);             // itself and one on either side, each told twice
  twice.add(100, 0, Eigen::MatrixXcd::Identity(3, 3), 5.0);  // another number of rows: not this class
  CHECK(twice.correlation(100).freedom == 18.0);
}

TEST_CASE("a record tells the same correlation of classes as the campaign that it was taken from", "[classes]") {
  PlanOptions p;
  p.period = 16;
  p.band = 2.0;
  const Plan plan = make_plan(p);
  CampaignOptions o;
  o.periods = 3;
  o.harmonics = 1;
  o.noise = {1e-3, 6e-3};
  Record record;
  record.sections = "clock";
  record.sections_per_cycle = 32;
  record.stimulus_period_cycles = p.period;
  record.settle_cycles = static_cast<int>(o.settle);
  record.inputs.push_back({"u", "N", {}});
  record.outputs = {{"y_M", "m", {}}, {"v_M", "m/s", {}}};
  const auto campaign = run_campaign(Hopper<>{}, ClockPhases{32}, plan, o, &record, {});
  REQUIRE(usable(campaign->id.worst));
  const Identification again = identify_record(record, o.harmonics);
  REQUIRE(again.classes.size() == campaign->id.classes.size());
  REQUIRE(again.classes.size() == static_cast<std::size_t>(plan.lines()));
  for (const ClassCorrelation& c : campaign->id.classes) {
    const ClassCorrelation* const other = again.correlation(c.line);
    REQUIRE(other != nullptr);
    CHECK(c.freedom >= 12.0);
    CHECK(c.own == 2.0);
    CHECK(other->freedom == c.freedom);
    CHECK(other->harmonics == 1);
    CHECK(c.matrix.rows() == 6);
    CHECK((other->matrix - c.matrix).cwiseAbs().maxCoeff() < 1e-6);
  }
  CHECK(campaign->id.correlation(p.period) == nullptr);  // no line of it was played
  for (const HtfEstimate& h : again.htf) CHECK(h.freedom >= 48.0);
}
