#include "sim/multipliers_from_htf.hpp"

#include "core/random.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/htf_table.hpp"

using namespace saltus;

namespace {

const Complex truth{-0.248983334736, 0.699333251798};

// The reference's H_0 at the campaign's 620 lines, with noise of `sigma` over the largest of each output.
Identification exact(const test::HtfTable& table, double sigma = 0.0, std::uint64_t seed = 1) {
  Random random(seed);
  Identification id;
  for (int c = 0; c < 2; ++c) {
    const std::string output = c == 0 ? "y_M" : "v_M";
    const double scale = sigma * table.size(0, output, {19, 20}).largest;
    for (int q = 1; q < 640; ++q) {
      if (q % 32 == 0) continue;
      HtfEstimate h{0, q, c, table.at(0, q, output).value};
      if (sigma > 0.0) {
        h.value += scale / std::sqrt(2.0) * Complex(random.normal(), random.normal());
        h.sigma = scale;
      }
      h.cycles = 64;
      id.htf.push_back(h);
    }
  }
  return id;
}

double error(const MultiplierFit& fit) {
  return fit.multipliers.empty() ? 1e300 : std::abs(fit.multipliers[0] - truth);
}

}  // namespace

TEST_CASE("Image poles give the multipliers of the exact harmonics, of either output and family") {
  for (const auto* table : {&test::reference_isochrons(), &test::reference_kinematic()}) {
    const Identification id = exact(*table);
    for (const int output : {0, 1}) {
      const MultiplierFit fit = fit_image_poles(id, output, 2);
      CHECK(fit.status == Status::ok);
      CHECK(fit.form == "image poles");
      CHECK(fit.output == output);
      REQUIRE(fit.multipliers.size() == 2);
      CHECK(error(fit) < 1e-6);
      CHECK(std::abs(fit.multipliers[1] - std::conj(fit.multipliers[0])) < 1e-12);
      CHECK(fit.curve.size() == 620);
      // The curve is H_0 again, and its frequencies are cycles a cycle.
      double worst = 0.0;
      for (std::size_t i = 0; i < fit.curve.size(); ++i) {
        const auto list = id.select(0, output);
        CHECK(std::abs(fit.curve[i].first - list[i].line / 64.0) < 1e-12);
        worst = std::max(worst, std::abs(fit.curve[i].second - list[i].value));
        if (i % 100 != 0) i += 19;
      }
      CHECK(worst < 1e-7);
    }
  }
}

TEST_CASE("Two poles are off by what the form cannot hold, as in the paper") {
  const Identification id = exact(test::reference_isochrons());
  const MultiplierFit height = fit_two_poles(id, 0), speed = fit_two_poles(id, 1);
  REQUIRE(usable(height.status));
  REQUIRE(usable(speed.status));
  CHECK(height.form == "2 poles, 1 zero");
  CHECK((error(height) > 2e-3 && error(height) < 3e-3));
  CHECK(std::abs(error(speed) - 1e-2) < 2e-3);
  CHECK(height.rms > 0.0);
  CHECK(height.curve.size() == 620);
}

TEST_CASE("With noise the stated error of the image poles is the one they make") {
  double z = 0.0;
  constexpr int runs = 12;
  for (std::uint64_t seed = 1; seed <= runs; ++seed) {
    const MultiplierFit fit = fit_image_poles(exact(test::reference_isochrons(), 1e-3, seed), 0, 2);
    REQUIRE(fit.status == Status::ok);
    z += std::norm(fit.multipliers[0] - truth) / (fit.sigma[0] * fit.sigma[0]) / runs;
  }
  INFO(z);
  CHECK((z > 0.15 && z < 2.2));  // of mean 1, standard deviation 0.3
  const MultiplierFit coarse = fit_image_poles(exact(test::reference_isochrons(), 1e-3), 1, 2);
  const MultiplierFit fine = fit_image_poles(exact(test::reference_isochrons(), 1e-4), 1, 2);
  CHECK(std::abs(coarse.sigma[0] / fine.sigma[0] - 10.0) < 1.5);
}

TEST_CASE("Weights are those of the stated errors: a line that is known badly counts little") {
  Identification id = exact(test::reference_isochrons(), 1e-4);
  const double before = error(fit_image_poles(id, 0, 2));
  for (HtfEstimate& h : id.htf) {
    if (h.line % 10 != 3) continue;
    h.value += Complex(0.1, -0.1);
    h.sigma *= 1e4;
  }
  const double weighed = error(fit_image_poles(id, 0, 2));
  for (HtfEstimate& h : id.htf) h.sigma = 1.0;
  const double blind = error(fit_image_poles(id, 0, 2));
  CHECK(weighed < 3.0 * before + 1e-4);
  CHECK(blind > 10.0 * weighed);
}

TEST_CASE("The best fit is of the output that tells more") {
  Identification id = exact(test::reference_isochrons(), 1e-3);
  CHECK(error(best_multipliers(id, 2, 2)) < 1e-2);
  for (const int worse : {0, 1}) {
    Identification spoilt = id;
    Random random(4);
    for (HtfEstimate& h : spoilt.htf) {
      if (h.output != worse) continue;
      h.value += 30.0 * h.sigma / std::sqrt(2.0) * Complex(random.normal(), random.normal());
      h.sigma *= 30.0;
    }
    const MultiplierFit best = best_multipliers(spoilt, 2, 2);
    CHECK(best.form == "image poles");
    CHECK(best.output == 1 - worse);
  }
}

TEST_CASE("Fits that cannot be are failed, never nonsense") {
  const Identification id = exact(test::reference_isochrons());
  for (const int count : {-1, 0, 5}) CHECK(fit_image_poles(id, 0, count).status == Status::failed);
  CHECK(fit_image_poles(id, 2, 2).status == Status::failed);
  CHECK(fit_two_poles(id, 2).status == Status::failed);
  CHECK(fit_two_poles(Identification{}, 0).status == Status::failed);
  CHECK(best_multipliers(Identification{}, 2, 2).status == Status::failed);
  CHECK(best_multipliers(Identification{}, 2, 2).multipliers.empty());

  Identification other = id;
  other.sections = 16;
  CHECK(fit_image_poles(other, 0, 2).status == Status::failed);

  // Two equations a line; the form for two multipliers has 98 coefficients.
  Identification few = id;
  few.htf.clear();
  for (const HtfEstimate& h : id.htf) {
    if (h.line % 5 == 1) few.htf.push_back(h);
  }
  CHECK(fit_image_poles(few, 0, 2).status == Status::failed);
  const MultiplierFit best = best_multipliers(few, 2, 2);
  CHECK(best.form == "2 poles, 1 zero");
  CHECK(error(best) < 2e-2);
  CHECK(error(best) < 3.0 * best.sigma[0]);  // the outputs' disagreement says how much the form misses
  CHECK(std::isnan(best_multipliers(few, 1, 2).sigma[0]));

  for (HtfEstimate& h : few.htf) h.value = std::nan("");
  CHECK(fit_two_poles(few, 0).status == Status::failed);
}
