#include "rhythm_beside.hpp"

#include <cmath>
#include <cstdio>

#include "program.hpp"

namespace saltus::program {
namespace {

using diagnosis::MultiplierBeside;
using diagnosis::RhythmBeside;
using diagnosis::SectionBeside;

// Differences of this many standard errors chance makes once in twenty.
constexpr double usual = 1.96;

nlohmann::json rows_of(const Eigen::MatrixXd& m) {
  auto rows = nlohmann::json::array();
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    auto row = nlohmann::json::array();
    for (Eigen::Index k = 0; k < m.cols(); ++k) row.push_back(m(i, k));
    rows.push_back(row);
  }
  return rows;
}

nlohmann::json complex_of(const Complex& z) { return {{"re", z.real()}, {"im", z.imag()}}; }

}  // namespace

nlohmann::json json_of(const RhythmBeside& b, const Rhythm& r) {
  using Json = nlohmann::json;
  Json j{{"sections", Json::array()}, {"multipliers", Json::array()}};
  for (const SectionBeside& s : b.sections) {
    Json one{{"from", s.section}, {"to", s.next}, {"runs", s.runs}, {"lost", s.lost}};
    if (!s.error.empty()) {
      one["late"] = s.late;
      one["late_sigma"] = s.late_sigma;
      for (std::size_t c = 0; c < s.error.size(); ++c) {
        one["prediction"].push_back({{"name", r.coordinates[c].first},
                                     {"unit", r.coordinates[c].second},
                                     {"rms", s.error[c]},
                                     {"bias", s.bias[c]},
                                     {"bias_sigma", s.bias_sigma[c]},
                                     {"scatter", s.scatter[c]}});
      }
    }
    if (s.model.size() > 0) {
      one["A_measured"] = rows_of(s.measured);
      one["A_model"] = rows_of(s.model);
      one["A_difference_sigma"] = rows_of(s.sigma);
      one["off"] = s.off;
      one["worst"] = s.worst;
    }
    j["sections"].push_back(one);
  }
  for (const MultiplierBeside& m : b.multipliers) {
    j["multipliers"].push_back(
        {{"model", complex_of(m.model)}, {"measured", complex_of(m.measured)}, {"sigma", m.sigma}, {"off", m.off}});
  }
  if (!b.refusal.empty()) j["multipliers_refused"] = b.refusal;
  return j;
}

void print(const RhythmBeside& b, const Rhythm& r) {
  int runs = 0, lost = 0;
  for (const SectionBeside& s : b.sections) {
    runs += s.runs;
    lost += s.lost;
  }
  std::printf("  the model, run under the recorded input from each of %d passages to the next section; %d got there\n",
              runs + lost, runs);
  std::printf("  %-15s %5s %17s  one step ahead: error rms (mean +- its standard error)\n", "phase", "runs",
              "A off by (worst)");
  for (const SectionBeside& s : b.sections) {
    const auto phase = [&](int k) { return number(r.sections[static_cast<std::size_t>(k)].phase, "%.3f"); };
    std::printf("  %-15s %5d ", (phase(s.section) + " to " + phase(s.next)).c_str(), s.runs);
    std::printf("%17s ", s.model.size() > 0 ? (number(s.off, "%.1f") + " (" + number(s.worst, "%.1f") + ")").c_str()
                                            : "not told");
    for (std::size_t c = 0; c < s.error.size(); ++c) {
      std::printf("  %s %.2g (%.2g +- %.1g) %s", r.coordinates[c].first.c_str(), s.error[c], s.bias[c], s.bias_sigma[c],
                  r.coordinates[c].second.c_str());
    }
    if (!s.error.empty()) std::printf(", %.1f +- %.1f ms late", 1e3 * s.late, 1e3 * s.late_sigma);
    std::printf("\n");
  }
  std::printf("    A: the map from section to section, measured and of the model; off by so many standard errors\n");
  if (b.multipliers.empty()) {
    std::printf("  multipliers of the model: none: %s\n", b.refusal.c_str());
    return;
  }
  std::printf("  multipliers of the model under the recorded input, from the same passages\n");
  for (const MultiplierBeside& m : b.multipliers) {
    std::printf("    %-22s standard error %.2g; measured %s, %.1f standard errors off%s\n",
                complex_number(m.model.real(), m.model.imag(), 3).c_str(), m.sigma,
                complex_number(m.measured.real(), m.measured.imag(), 3).c_str(), m.off,
                m.off < usual ? "" : ": the model's decays are not the machine's");
  }
}

}  // namespace saltus::program
