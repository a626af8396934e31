// saltus coverage MODEL: do the intervals of `saltus identify` hold the truth as often as they promise?
#include "../coverage.hpp"

#include <cstdio>

#include "plan_options.hpp"
#include "sections.hpp"

namespace saltus::program {
namespace {

struct Options {
  ModelChoice model;
  SectionChoice sections;
  PlanOptions plan;
  CoverageOptions coverage;
  int experiments = 1000;
  std::vector<std::string> kinds = {"white", "coloured", "process"};
  std::string json;
};

template <class M>
void run(const M& m, const Options& given) {
  Options o = given;
  if (o.coverage.noise.size() != static_cast<std::size_t>(output_count<M>)) {
    throw UsageError("--noise: " + std::string(M::name) + " has " + std::to_string(output_count<M>) +
                     " outputs; give one number for each");
  }
  Plan plan;
  try {
    plan = make_plan(o.plan);
  } catch (const std::invalid_argument& e) {
    throw UsageError(e.what());
  }
  const double process = o.coverage.process;
  const int cases = (o.sections.family == "both" ? 2 : 1) * static_cast<int>(o.kinds.size());
  o.coverage.trials = std::max(1, o.experiments / cases);
  nlohmann::json json = nlohmann::json::array();
  const bool quiet = o.json == "-";
  if (!quiet) {
    std::printf("%s: %d campaigns of %zu experiments, %lld stimulus periods each; %g %% intervals\n",
                std::string(M::name).c_str(), cases * o.coverage.trials, plan.experiments.size(),
                static_cast<long long>(o.coverage.periods), 100.0 * o.coverage.level);
    std::printf("  %-18s%-10s%14s%24s%16s%16s\n", "sections", "noise", "lines inside", "multipliers inside",
                "rms error", "standard error");
  }
  o.sections.visit<M>([&](const auto& family) {
    for (const std::string& kind : o.kinds) {
      CoverageOptions c = o.coverage;
      c.colour = kind == "coloured" ? 0.8 : 0.0;
      c.process = kind == "process" ? process : 0.0;
      c.seed = o.plan.seed + (static_cast<std::uint64_t>(json.size()) << 32);  // no two cases share their draws
      Progress progress(std::string(title_of(family)) + ", " + kind + " noise");
      const Coverage r = cover(m, family, plan, c, [&](double fraction) { progress.at(fraction); });
      if (r.lines == 0) throw RunError(std::string(M::name) + ": no limit cycle to experiment on; change --set");
      json.push_back({{"model", M::name},
                      {"sections", name_of(family)},
                      {"noise", kind},
                      {"trials", c.trials},
                      {"failed", r.failed},
                      {"lines", r.lines},
                      {"lines_inside", r.line_rate()},
                      {"multipliers", r.multipliers},
                      {"multipliers_inside", r.multiplier_rate()},
                      {"multipliers_inside_sigma", r.multiplier_rate_sigma(c.level)},
                      {"multiplier_rms_error", r.error},
                      {"multiplier_sigma", r.sigma}});
      if (!quiet) {
        std::printf("  %-18s%-10s%12.2f %%%14.1f +- %3.1f %%%16.2e%16.2e\n", title_of(family), kind.c_str(),
                    100.0 * r.line_rate(), 100.0 * r.multiplier_rate(), 100.0 * r.multiplier_rate_sigma(c.level),
                    r.error, r.sigma);
      }
    }
  });
  if (!o.json.empty()) write_json(o.json, json);
}

}  // namespace

void add_coverage(CLI::App& app) {
  auto* command = app.add_subcommand("coverage", "How often intervals hold the truth, over many noisy campaigns");
  command->footer(
      "Noise of the outputs, white, and coloured by a pole of 0.8 at the same standard deviation; and process noise: "
      "a\n"
      "random force where the input acts, held from section to section, which goes through the machine, beside white\n"
      "noise of the outputs. Beside the rate of the multipliers stands the standard error that so many campaigns "
      "leave.\n"
      "Example: saltus coverage hopper --experiments 1000");
  auto o = std::make_shared<Options>();
  o->coverage.noise = {1e-3, 6e-3};
  o->coverage.process = 0.03;
  o->sections.family = "both";
  o->model.add_to(*command);
  o->sections.add_to(*command, true);
  add_plan_options(*command, o->plan);
  command->add_option("--experiments", o->experiments, "simulated campaigns, shared among the cases")
      ->check(CLI::Range(4, 1000000))
      ->capture_default_str();
  command->add_option("--periods", o->coverage.periods, "stimulus periods of each experiment")
      ->check(CLI::Range(2, 100))
      ->capture_default_str();
  command->add_option("--level", o->coverage.level, "probability of the intervals")
      ->check(CLI::Range(0.5, 0.999))
      ->capture_default_str();
  command->add_option("--noise", o->coverage.noise, "standard deviation of each output, in its unit")
      ->delimiter(',')
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command
      ->add_option("--process", o->coverage.process,
                   "standard deviation of the random force of process noise, in the unit of the input")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--kinds", o->kinds, "kinds of noise: white, coloured, process")
      ->delimiter(',')
      ->check(CLI::IsMember({"white", "coloured", "process"}))
      ->capture_default_str();
  command->add_option("--json", o->json, "write JSON to FILE, - for standard output")->type_name("FILE");
  command->callback([o] {
    with_model(o->model, [&](auto m) {
      using M = decltype(m);
      if constexpr (input_count<M> == 1) {
        run(m, *o);
      } else {
        throw RunError(std::string(M::name) + " has no input to drive; choose a model that has one");
      }
    });
  });
}

}  // namespace saltus::program
