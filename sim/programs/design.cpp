// saltus design: the stimuli of a campaign, obeying the rules under which every line can be told apart.
#include <cstdio>

#include "plan_options.hpp"

namespace saltus::program {
namespace {

struct Options {
  PlanOptions plan;
  DesignOptions design;
  std::string csv, samples, json;
};

void run(const Options& o) {
  const bool quiet = check_outputs({{"--csv", o.csv}, {"--samples", o.samples}, {"--json", o.json}});
  const Plan plan = plan_of(o.plan, o.design);
  const bool several = o.plan.inputs > 1;
  std::string csv = std::string("experiment,line,f,amplitude,phase") + (several ? ",input\n" : "\n");
  std::string series = "experiment,sample";
  for (int j = 0; j < o.plan.inputs; ++j) series += several ? ",u" + std::to_string(j + 1) : ",u";
  series += "\n";
  nlohmann::json json{{"sections_per_cycle", o.plan.sections},
                      {"stimulus_period_cycles", o.plan.period},
                      {"lines", plan.lines()},
                      {"least_experiments", plan.least_experiments()},
                      {"experiments", nlohmann::json::array()}};
  const int length = o.plan.sections * o.plan.period;
  double crest_low = 1e300, crest_high = 0.0, peak = 0.0;
  int fewest = max_tones, most = 0;
  for (std::size_t e = 0; e < plan.experiments.size(); ++e) {
    std::vector<Multisine<max_tones>> inputs;
    for (int j = 0; j < o.plan.inputs; ++j) inputs.push_back(plan.stimulus(e, j));
    for (int n = 0; n < length; ++n) {
      std::string row = std::to_string(e) + "," + std::to_string(n);
      for (const auto& s : inputs) {
        const double u = s(n);
        peak = std::max(peak, std::abs(u));
        if (!o.samples.empty()) row += "," + number(u, "%.17g");
      }
      if (!o.samples.empty()) series += row + "\n";
    }
    nlohmann::json tones = nlohmann::json::array();
    double crest = 0.0;
    for (std::size_t j = 0; j < inputs.size(); ++j) {
      const auto& s = inputs[j];
      for (int k = 0; k < s.tones(); ++k) {
        const Tone& t = s.tone(k);
        const double f = static_cast<double>(t.line) / o.plan.period;
        csv += std::to_string(e) + "," + std::to_string(t.line) + "," + number(f, "%.9g") + "," +
               number(t.amplitude, "%.17g") + "," + number(t.phase, "%.17g") +
               (several ? "," + std::to_string(j + 1) : "") + "\n";
        tones.push_back({{"line", t.line}, {"f", f}, {"amplitude", t.amplitude}, {"phase", t.phase}});
        if (several) tones.back()["input"] = j + 1;
      }
      crest = std::max(crest, crest_between_samples(s));
      fewest = std::min(fewest, s.tones());
      most = std::max(most, s.tones());
    }
    json["experiments"].push_back({{"crest_factor", crest}, {"tones", tones}});
    crest_low = std::min(crest_low, crest);
    crest_high = std::max(crest_high, crest);
  }
  if (!quiet) {
    std::printf("%d lines f = q/%d below %g cycles per cycle, %s\n", plan.lines(), o.plan.period, o.plan.band,
                !o.plan.half_multiples ? "without the multiples of 1/2"
                : o.design.odd         ? "odd multiples of 1/2 in two experiments each"
                                       : "the multiples of 1/2 in two experiments each, 0 in one");
    std::printf(
        "%zu experiments of %d to %d tones; no plan has fewer than %d: that many %s exclude one another (class %d "
        "of %d)\n",
        plan.experiments.size(), fewest, most, plan.least_experiments(),
        o.plan.half_multiples || several ? "plays" : "lines", plan.bound.residue, o.plan.period);
    std::printf("amplitude %g a tone, crest factor between samples too %.2f to %.2f, largest sample %.4g\n", o.plan.amplitude, crest_low,
                crest_high, peak);
  }
  if (!o.csv.empty()) write_text(o.csv, csv);
  if (!o.samples.empty()) write_text(o.samples, series);
  if (!o.json.empty()) write_json(o.json, json);
}

}  // namespace

void add_design(CLI::App& app) {
  auto* command = app.add_subcommand("design", "A set of stimuli whose lines can all be told apart");
  command->footer("Without --subsets: the fewest experiments possible. Example: saltus design --csv tones.csv");
  auto o = std::make_shared<Options>();
  add_plan_options(*command, o->plan);
  command
      ->add_option("--inputs", o->plan.inputs,
                   "of the machine: each experiment is played so many times, with amplitudes that are orthogonal")
      ->check(CLI::Range(1, most_inputs));
  add_share_option(*command, o->plan);
  command->add_option("--sections-per-cycle", o->plan.sections, "samples a cycle")
      ->check(CLI::Range(2, 4096))
      ->capture_default_str();
  command
      ->add_option("--subsets", o->plan.subsets,
                   "deal the lines at random into so many experiments, as the paper does into 80")
      ->check(CLI::Range(1, 4096));
  command->add_flag("--opposed", o->plan.opposed,
                    "add each stimulus with its sign reversed: even-order distortion cancels");
  add_design_options(*command, o->plan, o->design);
  command
      ->add_option(
          "--csv", o->csv,
          "write experiment,line,f,amplitude,phase, with several inputs also input, to FILE, - for standard output")
      ->type_name("FILE");
  command->add_option("--samples", o->samples, "write experiment,sample,u over one period to FILE")->type_name("FILE");
  command->add_option("--json", o->json, "write JSON to FILE, - for standard output")->type_name("FILE");
  command->callback([o] { run(*o); });
}

}  // namespace saltus::program
