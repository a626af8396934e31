// Tables, files and pictures of an identification.
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>

#include "core/spectrum/noise.hpp"
#include "identify.hpp"

namespace saltus::program {
namespace {

std::size_t at(int i) { return static_cast<std::size_t>(i); }

Complex distance_to(const std::vector<Complex>& multipliers) {
  return multipliers.empty() ? Complex(std::nan(""), 0.0) : multipliers[0];
}

std::string join(const std::vector<Complex>& values, int digits) {
  std::string s;
  for (const Complex& z : values) {
    if (z.imag() < 0.0) continue;  // its conjugate stands already
    if (!s.empty()) s += ", ";
    s += number(z.real(), ("%." + std::to_string(digits) + "f").c_str());
    if (z.imag() > 0.0) s += " +- " + number(z.imag(), ("%." + std::to_string(digits) + "f").c_str()) + " i";
  }
  return s.empty() ? "none" : s;
}

// Of the periods that an estimate rests on.
double coherence_of(const HtfEstimate& h, int period) {
  const std::int64_t periods = std::max(1, h.cycles / period);
  return coherence(h.value, h.sigma * h.sigma * static_cast<double>(periods), periods);
}

const MultiplierFit* find_fit(const Identified& id, const char* form, int output) {
  for (const MultiplierFit& f : id.fits) {
    if (f.form == form && f.output == output && usable(f.status)) return &f;
  }
  return nullptr;
}

}  // namespace

Identified::Norms Identified::norms(int m, int output, int input) const {
  Norms n;
  for (std::size_t i = 0; i < id.htf.size(); ++i) {
    const HtfEstimate& h = id.htf[i];
    if (h.m != m || h.output != output || h.input != input) continue;
    n.identified += std::norm(h.value);
    if (std::abs(h.value) > n.largest) {
      n.largest = std::abs(h.value);
      n.largest_f = static_cast<double>(h.line) / id.period;
    }
    if (!has_exact) continue;
    n.exact += std::norm(exact[i]);
    n.error += std::norm(exact[i] - h.value);
    n.worst = std::max(n.worst, std::abs(exact[i] - h.value));
  }
  n.exact = std::sqrt(n.exact);
  n.identified = std::sqrt(n.identified);
  n.error = std::sqrt(n.error);
  return n;
}

std::vector<HtfPanel> panels_of(const Identified& r) {
  std::vector<HtfPanel> panels;
  // A picture shows 160 identified points a curve at most, evenly: more would only make it heavy.
  std::size_t lines = 0;
  for (const HtfEstimate& h : r.id.htf) lines += h.m == 0 && h.output == 0 && h.input == 0 ? 1 : 0;
  const std::size_t every = std::max<std::size_t>(1, lines / 155);
  for (std::size_t i = 0; i < r.outputs.size() * r.inputs.size(); ++i) {
    const std::size_t c = i / r.inputs.size(), j = i % r.inputs.size();
    HtfPanel p{r.name_of(static_cast<int>(c), static_cast<int>(j)),
               r.output_units[c] + "/" + r.input_units[j],
               r.title,
               {},
               {},
               {}};
    for (const int m : {0, 1, -1}) {
      HtfCurve identified{m, {}}, exact{m, {}};
      std::size_t seen = 0;
      for (std::size_t k = 0; k < r.id.htf.size(); ++k) {
        const HtfEstimate& h = r.id.htf[k];
        if (h.m != m || at(h.output) != c || at(h.input) != j) continue;
        const double f = static_cast<double>(h.line) / r.id.period;
        if (seen++ % every == 0) identified.points.emplace_back(f, h.value);
        if (r.has_exact) exact.points.emplace_back(f, r.exact[k]);
      }
      p.identified.push_back(identified);
      if (r.has_exact) p.exact.push_back(exact);
    }
    if (const MultiplierFit* fit = find_fit(r, "2 poles, 1 zero", static_cast<int>(c)); fit != nullptr && j == 0) {
      p.fit = fit->curve;
    }
    panels.push_back(p);
  }
  return panels;
}

std::string csv_of(const Identified& r, bool with_coherence) {
  const bool several = r.inputs.size() > 1;
  std::string csv = std::string("m,f,output,re,im,sigma,cycles") + (with_coherence ? ",coherence" : "") +
                    (several ? ",input\n" : "\n");
  for (const HtfEstimate& h : r.id.htf) {
    csv += std::to_string(h.m) + "," + number(static_cast<double>(h.line) / r.id.period, "%.9g") + "," +
           r.outputs[at(h.output)] + "," + number(h.value.real(), "%.12e") + "," + number(h.value.imag(), "%.12e") +
           "," + (std::isfinite(h.sigma) ? number(h.sigma, "%.4e") : std::string{}) + "," + std::to_string(h.cycles);
    if (with_coherence)
      csv += "," + (std::isfinite(h.sigma) ? number(coherence_of(h, r.id.period), "%.6g") : std::string{});
    csv += (several ? "," + r.inputs[at(h.input)] : "") + "\n";
  }
  return csv;
}

nlohmann::json json_of(const Identified& r) {
  const auto finite = [](double x) { return std::isfinite(x) ? nlohmann::json(x) : nlohmann::json(nullptr); };
  nlohmann::json j{{"sections", r.sections},
                   {"sections_per_cycle", r.id.sections},
                   {"stimulus_period_cycles", r.id.period},
                   {"samples", r.id.samples},
                   {"missing", r.id.missing},
                   {"status", name(r.id.worst)},
                   {"notes", r.id.notes},
                   {"multipliers", nlohmann::json::array()},
                   {"fits", nlohmann::json::array()},
                   {"harmonics", nlohmann::json::array()},
                   {"htf", nlohmann::json::array()}};
  for (std::size_t i = 0; i < r.best.multipliers.size(); ++i) {
    j["multipliers"].push_back({{"re", r.best.multipliers[i].real()},
                                {"im", r.best.multipliers[i].imag()},
                                {"sigma", r.id.noise_known() ? finite(r.best.sigma[i]) : nullptr}});
  }
  for (const Complex& z : r.model_multipliers) j["model_multipliers"].push_back({{"re", z.real()}, {"im", z.imag()}});
  if (r.id.watched) {
    j["drifts"] = nlohmann::json::array();
    for (const Drift& d : r.id.drifts) {
      nlohmann::json row{{"experiment", d.experiment}, {"cycle", d.cycle}, {"z", finite(d.z)}};
      if (!d.output.empty()) row.update({{"output", d.output}, {"chart", d.chart}, {"phase", d.phase}});
      j["drifts"].push_back(row);
    }
  }
  for (const MultiplierFit& f : r.fits) {
    if (f.multipliers.empty()) continue;
    const Complex z = f.multipliers[0];
    j["fits"].push_back({{"form", f.form},
                         {"output", r.outputs[at(f.output)]},
                         {"re", z.real()},
                         {"im", z.imag()},
                         {"sigma", r.id.noise_known() ? finite(f.sigma[0]) : nullptr},
                         {"rms", finite(f.rms)},
                         {"status", name(f.status)}});
  }
  const bool several = r.inputs.size() > 1;
  if (several) j["condition"] = r.id.condition;
  std::map<std::array<int, 3>, bool> orders;
  for (const HtfEstimate& h : r.id.htf) orders[{h.m, h.output, h.input}] = true;
  for (const auto& [key, unused] : orders) {
    const auto [m, c, input] = key;
    const auto n = r.norms(m, c, input);
    nlohmann::json row{{"m", m}, {"output", r.outputs[at(c)]}, {"norm", n.identified}};
    if (several) row["input"] = r.inputs[at(input)];
    if (r.has_exact) {
      row["norm_model"] = n.exact;
      row["error"] = n.error / r.norms(0, c, input).exact;  // in units of the norm of H_0
    }
    j["harmonics"].push_back(row);
  }
  for (const HtfEstimate& h : r.id.htf) {
    j["htf"].push_back({{"m", h.m},
                        {"f", static_cast<double>(h.line) / r.id.period},
                        {"output", r.outputs[at(h.output)]},
                        {"re", h.value.real()},
                        {"im", h.value.imag()},
                        {"sigma", finite(h.sigma)},
                        {"freedom", h.freedom},
                        {"coherence", finite(coherence_of(h, r.id.period))},
                        {"cycles", h.cycles}});
    if (several) j["htf"].back()["input"] = r.inputs[at(h.input)];
  }
  if (r.transient) {
    j["transient"] = {{"modelled", r.transient->removed},
                      {"expected_error", finite(r.transient->removed ? r.transient->modelled : r.transient->dropped)},
                      {"expected_error_dropped", finite(r.transient->dropped)},
                      {"expected_error_modelled", finite(r.transient->modelled)},
                      {"multipliers", nlohmann::json::array()}};
    for (const Complex& z : r.transient->multipliers)
      j["transient"]["multipliers"].push_back({{"re", z.real()}, {"im", z.imag()}});
  }
  if (r.jitter) {
    j["timing_jitter_s"] = {
        {"value", r.jitter->seconds}, {"sigma", finite(r.jitter->sigma)}, {"found", r.jitter->found}};
  }
  if (r.ladder) {
    j["ladder"] = {{"amplitudes", r.ladder->amplitude}, {"degrees", r.ladder->degree}, {"misfits", r.ladder->misfits}};
  }
  if (r.any) {
    j["any_stimulus"] = {{"condition", r.any->condition}, {"noise", nlohmann::json::object()}};
    for (std::size_t c = 0; c < r.outputs.size(); ++c) j["any_stimulus"]["noise"][r.outputs[c]] = r.any->noise[c];
  }
  return j;
}

void print_notes(const Identified& r) {
  for (const std::string& note : r.id.notes) std::printf("  note: %s\n", note.c_str());
  if (r.inputs.size() > 1)
    std::printf("  %zu inputs, condition of their amplitudes %.3g\n", r.inputs.size(), r.id.condition);
  if (r.transient && std::isfinite(r.transient->modelled)) {
    const TransientRemoval& t = *r.transient;
    std::printf("  transient %s: expected error of the response %.2g, %.2g had it been %s\n",
                t.removed ? "modelled" : "dropped", t.removed ? t.modelled : t.dropped,
                t.removed ? t.dropped : t.modelled, t.removed ? "dropped" : "modelled");
  } else if (r.transient) {
    std::printf("  transient dropped: the experiments are too short to model it\n");
  }
  if (r.jitter && r.jitter->found) {
    std::printf("  sections are met at instants that scatter by %.3g s +- %.1g\n", r.jitter->seconds, r.jitter->sigma);
  }
  if (r.ladder) {
    std::printf(
        "  extrapolated to amplitude zero from %zu amplitudes: %d estimates of degree 0, %d of 1, %d of 2 in its "
        "square; %d fit none\n",
        r.ladder->amplitude.size(), r.ladder->degree[0], r.ladder->degree[1], r.ladder->degree[2], r.ladder->misfits);
  }
  if (r.any) {
    std::printf("  condition of the regressors %.3g%s; noise", r.any->condition,
                r.any->condition > 1e6 ? ", the input leaves directions untold" : "");
    for (std::size_t c = 0; c < r.outputs.size(); ++c) {
      std::printf("%s %s %.3g %s", c == 0 ? "" : ",", r.outputs[c].c_str(), r.any->noise[c], r.output_units[c].c_str());
    }
    std::printf("\n");
    for (std::size_t i = 0; i < r.any->multipliers.size(); ++i) {
      std::printf("  multiplier %s, standard error %.1e\n",
                  complex_number(r.any->multipliers[i].real(), r.any->multipliers[i].imag()).c_str(), r.any->sigma[i]);
    }
  }
  if (!r.id.watched) return;
  if (r.id.drifts.empty()) {
    std::printf("  the residual against the model stayed within its noise band\n");
  } else {
    std::printf("  the residual against the model left its noise band in %zu experiments; first in %s\n",
                r.id.drifts.size(), r.id.drifts.front().story().c_str());
  }
}

void print_errors(const Identified& r) {
  if (!r.has_exact) return;
  std::printf("  identified - model, over the norm of H_0 (in brackets: worst line, over the largest H_0)\n");
  for (std::size_t i = 0; i < r.outputs.size() * r.inputs.size(); ++i) {
    const auto output = static_cast<int>(i / r.inputs.size()), input = static_cast<int>(i % r.inputs.size());
    const auto h0 = r.norms(0, output, input);
    std::printf("    %-6s", r.name_of(output, input).c_str());
    for (const int m : {-1, 0, 1}) {
      if (r.id.select(m, output, input).empty()) continue;
      const auto n = r.norms(m, output, input);
      std::printf("   H_%-2d %.2e (%.2e)", m, n.error / h0.exact, n.worst / h0.largest);
    }
    std::printf("\n");
  }
}

void print_multipliers(const Identified& r) {
  std::printf("  multipliers of the model         %s\n", join(r.model_multipliers, 10).c_str());
  const Complex truth = distance_to(r.model_multipliers);
  for (const MultiplierFit& f : r.fits) {
    if (!usable(f.status)) {
      std::printf("    %-16s %-6s         not found (%s)\n", f.form.c_str(), r.outputs[at(f.output)].c_str(),
                  std::string(name(f.status)).c_str());
      continue;
    }
    // The standard error of a form that is not exact is not that of its result: the misfit dominates.
    const bool exact_form = f.form == "image poles";
    std::printf("    %-16s %-6s         %-28s off by %.1e%s\n", f.form.c_str(), r.outputs[at(f.output)].c_str(),
                join(f.multipliers, exact_form ? 8 : 5).c_str(), std::abs(f.multipliers[0] - truth),
                exact_form && r.id.noise_known() ? (", standard error " + number(f.sigma[0], "%.1e")).c_str() : "");
  }
}

void print_standard_errors(const Identified& r) {
  std::printf("  %-8s%-6s%12s%14s%14s%14s%10s\n", "output", "m", "lines", "largest |H|", "at f", "median sigma",
              "freedom");
  for (std::size_t i = 0; i < r.outputs.size() * r.inputs.size(); ++i) {
    const auto output = static_cast<int>(i / r.inputs.size()), input = static_cast<int>(i % r.inputs.size());
    for (const int m : {-1, 0, 1}) {
      const auto list = r.id.select(m, output, input);
      if (list.empty()) continue;
      std::vector<double> sigma;
      double freedom = list.front().freedom;  // the least, complex degrees
      for (const HtfEstimate& h : list) {
        sigma.push_back(h.sigma);
        freedom = std::min(freedom, h.freedom);
      }
      std::nth_element(sigma.begin(), sigma.begin() + static_cast<std::ptrdiff_t>(sigma.size() / 2), sigma.end());
      const auto n = r.norms(m, output, input);
      const double median = sigma[sigma.size() / 2];
      std::printf("  %-8s%-6d%12zu%14.6g%14.4f%14s%10s\n", r.name_of(output, input).c_str(), m, list.size(), n.largest,
                  n.largest_f, std::isfinite(median) ? number(median, "%.3g").c_str() : "no repeats",
                  freedom > 0.0 ? number(freedom, "%.0f").c_str() : "-");
    }
  }
  if (!r.has_exact) return;
  int all = 0, inner = 0, outer = 0;
  for (std::size_t i = 0; i < r.id.htf.size(); ++i) {
    const HtfEstimate& h = r.id.htf[i];
    if (!(h.sigma > 0.0)) continue;
    const double z = std::norm(h.value - r.exact[i]) / (h.sigma * h.sigma);  // of unit mean, exponential
    ++all;
    inner += z < -std::log(0.32) ? 1 : 0;
    outer += z < -std::log(0.05) ? 1 : 0;
  }
  if (all > 0) {
    std::printf(
        "  against the model: %.1f %% of %d estimates inside their 68 %% circle, %.1f %% inside their 95 %% circle\n",
        100.0 * inner / all, all, 100.0 * outer / all);
  }
}

void write_pictures(const std::string& folder, const std::vector<HtfPanel>& panels, bool quiet) {
  const std::string magnitudes = magnitude_figure(panels).svg(), fits = fit_figure(panels).svg();
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw RunError(folder + ": the folder cannot be made; choose another for --pictures");
  write_text(folder + "/htf.svg", magnitudes);
  write_text(folder + "/fit.svg", fits);
  if (quiet) return;
  std::printf("pictures: %s/htf.svg, %s/fit.svg\n", folder.c_str(), folder.c_str());
}

void print_paper_table(const std::vector<Identified>& families) {
  // What the paper prints: Ankarali & Cowan 2014, VI. The sign of the real part is lost there.
  std::printf("\n%-44s %-22s %-26s %s\n", "Ankarali & Cowan 2014, section VI", "paper", "computed", "identified");
  const auto row = [](const std::string& what, const std::string& paper, const std::string& computed,
                      const std::string& identified) {
    std::printf("%-44s %-22s %-26s %s\n", what.c_str(), paper.c_str(), computed.c_str(), identified.c_str());
  };
  for (const Identified& r : families) {
    const bool clock = r.sections == "clock";
    row("multipliers, " + r.title, "0.25 +- 0.70 i (1)", join(r.model_multipliers, 6), join(r.best.multipliers, 6));
    for (std::size_t c = 0; c < r.outputs.size(); ++c) {
      const int output = static_cast<int>(c);
      if (const MultiplierFit* two = find_fit(r, "2 poles, 1 zero", output)) {
        row("  2 poles, 1 zero, " + r.outputs[c] + ": error", "third digit (2)", "",
            number(std::abs(two->multipliers[0] - distance_to(r.model_multipliers)), "%.1e"));
      }
      if (const MultiplierFit* image = find_fit(r, "image poles", output)) {
        row("  image poles, " + r.outputs[c] + ": error", "-", "",
            number(std::abs(image->multipliers[0] - distance_to(r.model_multipliers)), "%.1e"));
      }
      const auto h0 = r.norms(0, output);
      if (clock && c == 0) {
        double best = 0.0, where = 0.0;
        for (std::size_t i = 0; i < r.id.htf.size(); ++i) {
          const HtfEstimate& h = r.id.htf[i];
          if (h.m == 0 && h.output == output && std::abs(r.exact[i]) > best) {
            best = std::abs(r.exact[i]);
            where = static_cast<double>(h.line) / r.id.period;
          }
        }
        row("  peak of abs(H_0), " + r.outputs[c], "Fig. 3", number(best, "%.6f") + " at f = " + number(where, "%.3f"),
            number(h0.largest, "%.6f") + " at f = " + number(h0.largest_f, "%.3f"));
      }
      for (const int m : {-2, -1, 1, 2}) {
        if (r.id.select(m, output).empty()) continue;
        const auto n = r.norms(m, output);
        row("  norm of H_" + std::to_string(m) + " over H_0, " + r.outputs[c],
            std::abs(m) > 1 ? (clock ? "negligible" : "negligible (3)") : "Fig. 3", number(n.exact / h0.exact, "%.5f"),
            number(n.identified / h0.identified, "%.5f"));
      }
    }
  }
  if (families.size() == 2) {
    for (std::size_t c = 0; c < families[0].outputs.size(); ++c) {
      const int output = static_cast<int>(c);
      const auto a = families[0].norms(0, output), b = families[1].norms(0, output);
      row("gain of H_0, isochrons over kinematic, " + families[0].outputs[c], "doubled (4)",
          number(a.exact / b.exact, "%.4f"), number(a.identified / b.identified, "%.4f"));
    }
  }
  std::printf(
      "(1) the minus sign is lost in print   (2) true for the height only: the velocity is off by 1e-2\n"
      "(3) false: under the kinematic phase the height cannot deviate at sections 8 and 24, which takes H_2 and H_-2\n"
      "(4) a projection: the mean of cos^2 is 1/2\n");
}

}  // namespace saltus::program
