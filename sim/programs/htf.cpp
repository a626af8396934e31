// saltus htf MODEL: the exact harmonic transfer functions of a model around its limit cycle.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>

#include "../../core/orbit/orbit.hpp"
#include "../../core/spectrum/htf.hpp"
#include "../report/htf_figures.hpp"
#include "confidence.hpp"
#include "program.hpp"
#include "sections.hpp"

namespace saltus::program {
namespace {

struct Options {
  ModelChoice model;
  SectionChoice sections;
  int harmonics = 3;
  int resolution = 64;
  double band = 10.0;
  std::string csv, json, picture, realise;
};

template <class M, class Family>
void run(const M& m, const Family& family, const Options& o) {
  static_assert(input_count<M> == 1);
  constexpr int ny = output_count<M>;
  const bool quiet =
      check_outputs({{"--csv", o.csv}, {"--json", o.json}, {"--picture", o.picture}, {"--realise", o.realise}});
  const auto system = std::make_unique<LdtpOf<M, sections_per_cycle>>();
  const auto orbit = find_orbit<sections_per_cycle>(m, timebase_of(m, o.model.ticks), family, *system);
  if (orbit.status != Status::ok) {
    throw RunError(no_orbit(M::name, orbit.status, Family::on_grid));
  }
  std::string csv = "m,f,output,re,im\n";
  nlohmann::json values = nlohmann::json::array();
  std::vector<HtfPanel> panels(static_cast<std::size_t>(ny));
  std::vector<double> norm(static_cast<std::size_t>(ny * (2 * o.harmonics + 1)), 0.0);
  for (int i = 0; i < ny; ++i) {
    const Quantity& q = M::outputs[static_cast<std::size_t>(i)];
    auto& p = panels[static_cast<std::size_t>(i)];
    p.output = q.name;
    p.unit = std::string(q.unit) + "/" + std::string(M::inputs[0].unit);
    p.sections = title_of(family);
    for (int k = -o.harmonics; k <= o.harmonics; ++k) p.exact.push_back({k, {}});
  }
  const double reach = std::floor(o.band * o.resolution + 1e-9);
  if (!(reach >= 1.0)) throw UsageError("--band, --resolution: no line lies in the band; raise one of them");
  const int last = static_cast<int>(reach);
  for (int q = 1; q <= last; ++q) {
    const double f = static_cast<double>(q) / o.resolution;
    const auto h = htf(*system, 2.0 * std::numbers::pi * f / sections_per_cycle);
    for (int k = -o.harmonics; k <= o.harmonics; ++k) {
      for (int i = 0; i < ny; ++i) {
        const Complex z = h(k)(i, 0);
        if (!std::isfinite(std::abs(z))) {
          throw RunError(std::string(M::name) + ": H_" + std::to_string(k) + " is not finite at f = " + number(f) +
                         ", for a multiplier lies on the unit circle; change --set");
        }
        const auto& q_out = M::outputs[static_cast<std::size_t>(i)];
        csv += std::to_string(k) + "," + number(f, "%.9g") + "," + std::string(q_out.name) + "," +
               number(z.real(), "%.15e") + "," + number(z.imag(), "%.15e") + "\n";
        if (!o.json.empty())
          values.push_back({{"m", k}, {"f", f}, {"output", q_out.name}, {"re", z.real()}, {"im", z.imag()}});
        panels[static_cast<std::size_t>(i)].exact[static_cast<std::size_t>(k + o.harmonics)].points.emplace_back(f, z);
        norm[static_cast<std::size_t>(i * (2 * o.harmonics + 1) + k + o.harmonics)] += std::norm(z);
      }
    }
  }
  if (!quiet) {
    std::printf(
        "%s, %s: exact HTFs at %d lines f = 1/%d ... %g cycles per cycle, input held over each of %d sections\n",
        std::string(M::name).c_str(), title_of(family), last, o.resolution, static_cast<double>(last) / o.resolution,
        sections_per_cycle);
    std::printf("  norm of H_m over that of H_0 (root of the sum over the lines)\n  %-8s", "m");
    for (int k = -o.harmonics; k <= o.harmonics; ++k) std::printf("%10d", k);
    for (int i = 0; i < ny; ++i) {
      std::printf("\n  %-8s", std::string(M::outputs[static_cast<std::size_t>(i)].name).c_str());
      const auto at = [&](int k) {
        return norm[static_cast<std::size_t>(i * (2 * o.harmonics + 1) + k + o.harmonics)];
      };
      for (int k = -o.harmonics; k <= o.harmonics; ++k) {
        std::printf("%10.5f", at(0) > 0.0 ? std::sqrt(at(k) / at(0)) : 0.0);  // squares may underflow
      }
    }
    std::printf("\n  largest abs(H_0):");
    for (int i = 0; i < ny; ++i) {
      double best = 0.0, where = 0.0;
      for (const auto& [f, z] :
           panels[static_cast<std::size_t>(i)].exact[static_cast<std::size_t>(o.harmonics)].points) {
        if (std::abs(z) > best) best = std::abs(z), where = f;
      }
      const auto& p = panels[static_cast<std::size_t>(i)];
      std::printf("  %s %.6f %s at f = %g", p.output.c_str(), best, p.unit.c_str(), where);
    }
    std::printf("\n");
  }
  const std::string picture = o.picture.empty() ? "" : magnitude_figure(panels).svg();
  if (!o.csv.empty()) write_text(o.csv, csv);
  if (!o.json.empty()) {
    write_json(o.json, {{"model", M::name},
                        {"sections", name_of(family)},
                        {"sections_per_cycle", sections_per_cycle},
                        {"period", orbit.period},
                        {"htf", values}});
  }
  if (!o.picture.empty()) write_text(o.picture, picture);
  if (o.realise.empty()) return;
  Realisation model;
  try {
    model = realise(exact_table(*system, o.resolution, o.band));
  } catch (const std::invalid_argument& e) {
    throw RunError(std::string("--realise: ") + e.what() + "; raise --band or --resolution");
  }
  model.bounds = rank_bounds(*system);
  write_model(model, o.realise, quiet);
}

}  // namespace

void add_htf(CLI::App& app) {
  auto* command = app.add_subcommand("htf", "Exact harmonic transfer functions of a model");
  command->footer(
      "The input is held over each section interval; f is in cycles per cycle; H_m pairs the input at f with the "
      "output at f + m.\n"
      "Example: saltus htf hopper --sections kinematic --csv htf.csv --picture htf.svg");
  auto o = std::make_shared<Options>();
  o->model.add_to(*command);
  o->sections.add_to(*command, false);
  command->add_option("--harmonics", o->harmonics, "H_-K ... H_K")
      ->type_name("K")
      ->check(CLI::Range(0, 15))
      ->capture_default_str();
  command->add_option("--resolution", o->resolution, "lines per unit of f")
      ->check(CLI::Range(1, 4096))
      ->capture_default_str();
  command->add_option("--band", o->band, "largest f, cycles per cycle")
      ->check(CLI::Range(1e-3, 16.0))
      ->capture_default_str();
  command->add_option("--csv", o->csv, "write m,f,output,re,im to FILE, - for standard output")->type_name("FILE");
  command->add_option("--json", o->json, "write JSON to FILE, - for standard output")->type_name("FILE");
  command->add_option("--picture", o->picture, "draw the magnitudes of H_0 and H_+-1 into FILE.svg")->type_name("FILE");
  command
      ->add_option("--realise", o->realise,
                   "write the state-space model A[n], B[n], C[n] that all harmonics make to FILE.json or FILE.csv")
      ->type_name("FILE");
  command->callback([o] {
    with_model(o->model, [&](auto m) {
      using M = decltype(m);
      if constexpr (input_count<M> == 1) {
        o->sections.visit<M>([&](const auto& family) { run(m, family, *o); });
      } else {
        throw RunError(std::string(M::name) +
                       " has no input, so it has no harmonic transfer functions; choose a model that has one");
      }
    });
  });
}

}  // namespace saltus::program
