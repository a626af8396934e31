#include "confidence.hpp"

#include <algorithm>
#include <cmath>

#include "../significance.hpp"
#include "identify.hpp"

namespace saltus::program {
namespace {

void report_harmonics(const Identified& r, bool quiet, nlohmann::json& json) {
  const auto tests = test_harmonics(r.id);
  json["significant_harmonics"] = nlohmann::json::array();
  if (!quiet) {
    std::printf(tests.empty()
                    ? "  no repeats, so no noise to test harmonics against: record 2 stimulus periods or more\n"
                    : "  harmonics against the noise (H_m is there: chance below 0.001 over all tests)\n");
  }
  for (const HarmonicTest& t : tests) {
    const std::string& output = r.outputs[static_cast<std::size_t>(t.output)];
    json["significant_harmonics"].push_back({{"m", t.m},
                                             {"output", output},
                                             {"rms", t.norm},
                                             {"over_noise", t.mean_square},
                                             {"chance", t.chance},
                                             {"significant", t.significant}});
    if (quiet) continue;
    std::printf("    H_%-3d %-6s rms %-11s power over noise %-10s %s\n", t.m, output.c_str(),
                number(t.norm, "%.3g").c_str(), number(t.mean_square, "%.4g").c_str(),
                t.significant ? "there" : "not seen");
  }
}

MultiplierRegion report_regions(const Identified& r, const ConfidenceOptions& o, bool quiet, nlohmann::json& json) {
  RegionOptions options;
  options.count = std::max<int>(1, static_cast<int>(r.model_multipliers.size()));
  options.replicates = o.replicates;
  const MultiplierRegion region = multiplier_region(r.id, static_cast<int>(r.outputs.size()), options);
  json["multiplier_regions"] = nlohmann::json::array();
  if (!usable(region.status)) {
    if (!quiet) std::printf("  too few lines for confidence regions of the multipliers\n");
    return region;
  }
  if (!quiet) {
    std::printf("  multipliers, %g %% regions (chi^2 / freedom %.3f, %d responses share the poles)\n", 100.0 * o.level,
                region.chi_square / region.freedom, region.series);
  }
  // Half axes of the ellipse along the real and the imaginary direction.
  const double reach = region.reach(o.level);
  for (std::size_t i = 0; i < region.multipliers.size(); ++i) {
    const Complex z = region.multipliers[i];
    const auto& c = region.covariance[i];
    nlohmann::json one{{"re", z.real()},
                       {"im", z.imag()},
                       {"sigma", region.sigma(i)},
                       {"level", o.level},
                       {"covariance", {c(0, 0), c(0, 1), c(1, 1)}},
                       {"freedom", std::isfinite(region.known) ? nlohmann::json(region.known) : nullptr}};
    double scatter = 0.0;
    for (const auto& b : region.replicates)
      scatter += std::norm(b[i] - z) / static_cast<double>(region.replicates.size());
    if (!region.replicates.empty()) one["sigma_bootstrap"] = std::sqrt(scatter);
    json["multiplier_regions"].push_back(one);
    if (quiet || z.imag() < 0.0) continue;
    std::printf("    %.6f +- %.2g %s %.6f +- %.2g i, standard error %.2g", z.real(), reach * std::sqrt(c(0, 0)), "and",
                z.imag(), reach * std::sqrt(c(1, 1)), region.sigma(i));
    if (!region.replicates.empty()) std::printf(" (bootstrap %.2g)", std::sqrt(scatter));
    std::printf("\n");
  }
  return region;
}

void write_realisation(const Identified& r, const ConfidenceOptions& o, bool quiet) {
  RealisationOptions options;
  options.replicates = o.replicates;
  Realisation model;
  try {
    model = realise(r.id, static_cast<int>(r.outputs.size()), options);
  } catch (const std::invalid_argument& e) {
    throw RunError(std::string("--realise: ") + e.what() + "; raise --band or --period");
  }
  model.bounds = r.rank_bounds;
  write_model(model, o.realise, quiet);
}

}  // namespace

void ConfidenceOptions::add_to(CLI::App& command) {
  command
      .add_option("--confidence", level,
                  "regions of this probability for the multipliers, and which harmonics are there, e.g. 0.95")
      ->check(CLI::Range(0.01, 0.9999));
  command.add_option("--bootstrap", replicates, "replicates of the parametric bootstrap, beside the delta method")
      ->check(CLI::Range(2, 10000));
  command
      .add_option("--realise", realise,
                  "write a state-space model A[n], B[n], C[n] to FILE.json or FILE.csv; harmonics left out limit it, "
                  "so raise --harmonics")
      ->type_name("FILE");
}

MultiplierRegion report_confidence(const Identified& r, const ConfidenceOptions& o, bool quiet, nlohmann::json& json) {
  MultiplierRegion region;
  if (o.level > 0.0) {
    report_harmonics(r, quiet, json);
    region = report_regions(r, o, quiet, json);
  }
  if (!o.realise.empty()) write_realisation(r, o, quiet);
  return region;
}

void report_agreement(const MultiplierRegion& a, const MultiplierRegion& b, bool quiet, nlohmann::json& families) {
  if (a.status != Status::ok || b.status != Status::ok || a.multipliers.size() != b.multipliers.size()) return;
  double least = 1.0;
  int compared = 0;
  for (std::size_t i = 0; i < a.multipliers.size(); ++i) {
    if (a.multipliers[i].imag() < 0.0) continue;
    least = std::min(least, agreement(a, b, i));
    ++compared;
  }
  const double chance = -std::expm1(compared * std::log1p(-least));  // of the least of so many
  for (nlohmann::json& one : families) one["cross_phase_chance"] = chance;
  if (quiet) return;
  std::printf("multipliers of both families of sections differ as they do by a chance of %.3g%s\n", chance,
              chance < 0.001 ? ": a section or a clock is off" : "");
}

void write_model(const Realisation& model, const std::string& file, bool quiet) {
  write_text(file, file.ends_with(".csv") ? realisation_csv(model) : realisation_json(model));
  if (!model.stable()) {
    std::fprintf(stderr,
                 "saltus: --realise: the model is unstable (a multiplier of modulus %.3f): it does not describe the "
                 "machine; identify more harmonics, with less noise\n",
                 std::abs(model.multipliers[0]));
  }
  if (quiet) return;
  int most = 0;
  for (int n = 0; n < model.model.sections; ++n) most = std::max(most, model.model.dim(n));
  std::printf("  state-space model: %d to %d states, return map of rank %d, HTFs within %.1e of the largest H_0\n",
              model.model.dim(model.model.smallest_section()), most, model.rank, model.error);
  if (model.limit > 0.0) {
    std::printf("    harmonics that were not identified hide states below %.1e of the largest singular value\n",
                model.limit / model.singular[0]);
  }
  if (model.bounds) {
    const bool within = model.rank >= model.bounds->lower && model.rank <= model.bounds->upper;
    std::printf("    the maps between sections allow a rank of %d to %d%s\n", model.bounds->lower, model.bounds->upper,
                within ? "" : ": the model has another");
  }
  for (std::size_t i = 0; i < model.multipliers.size(); ++i) {
    const Complex z = model.multipliers[i];
    if (z.imag() < 0.0) continue;
    std::printf("    multiplier %.6f %+.6f i", z.real(), z.imag());
    if (i < model.sigma.size()) std::printf(", standard error %.2g", model.sigma[i]);
    std::printf("\n");
  }
}

}  // namespace saltus::program
