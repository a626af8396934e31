#include "confidence.hpp"

#include <cmath>

#include "../multiplier_region.hpp"
#include "../realisation.hpp"
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

void report_regions(const Identified& r, const ConfidenceOptions& o, bool quiet, nlohmann::json& json) {
  RegionOptions options;
  options.count = std::max<int>(1, static_cast<int>(r.model_multipliers.size()));
  options.replicates = o.replicates;
  const MultiplierRegion region = multiplier_region(r.id, static_cast<int>(r.outputs.size()), options);
  json["multiplier_regions"] = nlohmann::json::array();
  if (!usable(region.status)) {
    if (!quiet) std::printf("  too few lines for confidence regions of the multipliers\n");
    return;
  }
  if (!quiet) {
    std::printf("  multipliers, %g %% regions (chi^2 / freedom %.3f, %d responses share the poles)\n", 100.0 * o.level,
                region.chi_square / region.freedom, region.series);
  }
  // Half axes of the ellipse along the real and the imaginary direction.
  const double reach = std::sqrt(-2.0 * std::log1p(-o.level));
  for (std::size_t i = 0; i < region.multipliers.size(); ++i) {
    const Complex z = region.multipliers[i];
    const auto& c = region.covariance[i];
    nlohmann::json one{{"re", z.real()},
                       {"im", z.imag()},
                       {"sigma", region.sigma(i)},
                       {"level", o.level},
                       {"covariance", {c(0, 0), c(0, 1), c(1, 1)}}};
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
}

void write_realisation(const Identified& r, const ConfidenceOptions& o, bool quiet) {
  RealisationOptions options;
  options.replicates = o.replicates;
  Realisation model;
  try {
    model = realise(table_of(r.id, static_cast<int>(r.outputs.size())), options);
  } catch (const std::invalid_argument& e) {
    throw RunError(std::string("--realise: ") + e.what() + "; raise --band or --period");
  }
  const bool csv = o.realise.size() > 4 && o.realise.substr(o.realise.size() - 4) == ".csv";
  write_text(o.realise, csv ? realisation_csv(model) : realisation_json(model));
  if (quiet) return;
  int most = 0;
  for (int n = 0; n < model.model.sections; ++n) most = std::max(most, model.model.dim(n));
  std::printf("  state-space model: %d to %d states, return map of rank %d, HTFs within %.1e of the largest H_0\n",
              model.model.dim(model.model.smallest_section()), most, model.rank, model.error);
  for (std::size_t i = 0; i < model.multipliers.size(); ++i) {
    const Complex z = model.multipliers[i];
    if (z.imag() < 0.0) continue;
    std::printf("    multiplier %.6f %+.6f i", z.real(), z.imag());
    if (i < model.sigma.size()) std::printf(", standard error %.2g", model.sigma[i]);
    std::printf("\n");
  }
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

void report_confidence(const Identified& r, const ConfidenceOptions& o, bool quiet, nlohmann::json& json) {
  if (o.level > 0.0) {
    report_harmonics(r, quiet, json);
    report_regions(r, o, quiet, json);
  }
  if (!o.realise.empty()) write_realisation(r, o, quiet);
}

}  // namespace saltus::program
