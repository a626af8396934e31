// saltus diagnose: given a measured record and a declared model, what does the model lack?
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "../diagnosis/json.hpp"
#include "../report/diagnosis_page.hpp"
#include "../report/self_paced_section.hpp"
#include "any_record.hpp"
#include "calibrate.hpp"
#include "declared.hpp"
#include "hal/record.hpp"
#include "program.hpp"

namespace saltus::program {
namespace {

struct Arguments {
  std::string record, model, json, report, picture;
  std::vector<std::string> settings, tolerances, candidates;
  double holdout = -1.0, stretch = 0.0, horizon = 0.0;
  std::uint64_t seed = 1;
};

// The free runs of the first output, measured, refitted and with what was found.
void write_picture(const std::string& path, const diagnosis::Diagnosis& d) {
  const auto figures = free_run_figures(d);
  if (figures.empty()) {
    throw UsageError(
        "--picture " + path + ": there are no free runs to draw of " + d.record +
        (d.self_paced.is ? "; choose a shorter --horizon" : ", which a clock paces; --report draws what there is"));
  }
  write_text(path, figures.front().svg());
}

void run(const Arguments& a) {
  const Record record = read_any_record(a.record, a.model);
  const std::string model = a.model.empty() ? record.model : a.model;
  if (model.empty()) throw UsageError("--model is missing, and the record names none; models: " + known_models());
  auto machine = diagnosis::make_machine(model);
  if (!machine)
    throw UsageError("--model " + model +
                     ": no records of such a model are diagnosed; there are hopper, bouncing_ball, kneed_biped, "
                     "compass_gait, simplest_walker, " +
                     machine_models());
  if (!record.model.empty() && record.model != model) {
    throw RunError(a.record + ": it says it is of the model " + record.model + ", not " + model + "; choose --model " +
                   record.model + ", or correct its header");
  }
  diagnosis::Options options;
  options.set = declared(a.settings, *machine, a.json != "-" && a.picture != "-");
  for (const std::string& text : a.tolerances) {
    const bool percent = !text.empty() && text.back() == '%';
    const Setting s = parse_setting(percent ? text.substr(0, text.size() - 1) : text, "--tolerance");
    double nominal = declared_value(*machine, s.name, "--tolerance " + text);
    for (const auto& [name, value] : options.set) {
      if (name == s.name) nominal = value;
    }
    if (s.value < 0.0)
      throw UsageError("--tolerance " + text + ": a standard deviation is not negative; 0 means exactly known");
    options.tolerance.emplace_back(s.name, percent ? 0.01 * s.value * std::abs(nominal) : s.value);
  }
  options.candidates = a.candidates;
  if (a.holdout > 0.0 && a.holdout < 1.0) {
    options.holdout_share = a.holdout;
  } else {
    if (a.holdout != std::floor(a.holdout)) {
      throw UsageError("--holdout " + std::to_string(a.holdout) +
                       ": a number of experiments, or a share between 0 and 1");
    }
    options.holdout = static_cast<int>(a.holdout);
  }
  options.stretch = a.stretch;
  options.horizon = a.horizon;
  options.seed = a.seed;
  Progress progress("diagnosing");
  options.progress = [&](double fraction, const char*) { progress.at(fraction); };
  const diagnosis::Diagnosis d = diagnosis::diagnose(record, *machine, options);
  if (!a.json.empty()) write_json(a.json, diagnosis::to_json(d));
  if (!a.picture.empty()) write_picture(a.picture, d);
  const std::string page = a.report.empty() ? "" : write_diagnosis_page(d, a.report);
  if (a.json == "-" || a.picture == "-") return;
  for (const std::string& line : d.story) std::printf("%s\n", line.c_str());
  for (const std::string& note : d.notes) std::printf("Note: %s\n", note.c_str());
  if (!page.empty()) std::printf("Report: %s\n", page.c_str());
}

}  // namespace

void add_diagnose(CLI::App& app) {
  auto* command = app.add_subcommand(
      "diagnose", "What a model lacks, from a measured record: the cause of the residual, before and after");
  command->footer(
      "Example: saltus diagnose record.csv --model hopper --tolerance k=1% --report report --json verdict.json");
  auto a = std::make_shared<Arguments>();
  command->add_option("RECORD", a->record, "the record: a CSV file, or an LCM event log")
      ->required()
      ->check(CLI::ExistingFile);
  command->add_option("--model", a->model, "the declared model; where missing, the one the record names");
  command
      ->add_option(
          "--set", a->settings,
          "NAME=VALUE: declare a parameter's value, or an effect's size, in its SI unit; or FILE: what an earlier "
          "verdict (--json) found on another record; may be repeated")
      ->type_name("NAME=VALUE|FILE")
      ->allow_extra_args(false);
  command
      ->add_option("--tolerance", a->tolerances,
                   "NAME=SIGMA: how well a parameter is known, one standard deviation, absolute or in percent (b=5%), "
                   "0 = exactly; "
                   "2% where not given; may be repeated")
      ->type_name("NAME=SIGMA")
      ->allow_extra_args(false);
  command->add_option("--candidates", a->candidates, "consider only these effects: names, or beginnings ending in *")
      ->delimiter(',');
  command
      ->add_option(
          "--holdout", a->holdout,
          "how many experiments, the last ones, are predicted and not fitted, or what share of a record that no "
          "clock paces (0.5); default a third")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--stretch", a->stretch, "[s] length of the stretches a record that no clock paces is cut into")
      ->check(CLI::PositiveNumber);
  command->add_option("--horizon", a->horizon, "[s] length of the free runs by which such a record is predicted")
      ->check(CLI::PositiveNumber);
  command->add_option("--seed", a->seed, "seed of everything random")->capture_default_str();
  command->add_option("--report", a->report, "write a page about it into the folder DIR")->type_name("DIR");
  command
      ->add_option("--picture", a->picture,
                   "draw the free runs of a record that no clock paces into FILE.svg, - for standard output")
      ->type_name("FILE");
  command->add_option("--json", a->json, "write JSON to FILE, - for standard output")->type_name("FILE");
  command->callback([a] { run(*a); });
  add_calibrate(app);
}

}  // namespace saltus::program
