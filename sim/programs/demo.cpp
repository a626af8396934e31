// saltus demo: the whole story on embedded defaults, no network and no hardware.
#include <cstdio>

#include "../diagnosis/diagnosis.hpp"
#include "../diagnosis/machines.hpp"
#include "../diagnosis/synthetic.hpp"
#include "../report/diagnosis_page.hpp"
#include "identify.hpp"

namespace saltus::program {
namespace {

constexpr const char* undeclared = "quadratic_drag@body";
constexpr double drag = 0.03;  // [N s^2/m^2]

// The declared model alone: its limit cycle, excited and identified in both families of sections.
void identify_model(const Hopper<>& m, const std::string& folder) {
  IdentifyOptions o;
  o.plan.opposed = true;
  const Plan plan = make_plan(o.plan);
  std::printf(
      "1. The model. Its limit cycle is found, and %zu experiments of %lld cycles excite it around that cycle: %d "
      "frequencies.\n",
      plan.experiments.size(), static_cast<long long>(o.campaign.settle + o.plan.period), plan.lines());
  std::vector<HtfPanel> panels;
  const auto identify = [&](const auto& family) {
    const Identified r = identify_hopper(m, family, o, plan);
    std::printf("\nPoincare sections at 32 values of the %s\n",
                r.sections == "clock" ? "clock phase (isochrons)" : "kinematic phase");
    print_errors(r);
    print_multipliers(r);
    for (const HtfPanel& p : panels_of(r)) panels.push_back(p);
  };
  identify(ClockPhases{sections_per_cycle});
  identify(KinematicPhases{sections_per_cycle});
  write_pictures(folder, panels);
}

// A machine that has what the model lacks, measured as hardware would be.
Record measure() {
  const auto machine = diagnosis::make_machine("hopper");
  diagnosis::Campaign campaign;
  campaign.noise = {1e-3, 6e-3};  // [m], [m/s]
  std::vector<double> values;
  if (!diagnosis::values_with(*machine, {{undeclared, drag}}, values)) throw RunError("demo: no such effect");
  std::printf(
      "\n2. The machine. It looks like the model, but has %s = %g N s^2/m^2, which nobody declared.\n   %d experiments "
      "of "
      "%d cycles are measured with 1 mm and 6 mm/s of noise.\n",
      undeclared, drag, campaign.experiments, campaign.settle + campaign.repeats * campaign.period);
  return diagnosis::synthesise(*machine, values, campaign, 1);
}

void identify_machine(const Hopper<>& m, const Record& record) {
  const Identified r = identify_hopper(m, record, IdentifyOptions{});
  std::printf("   Its harmonic transfer functions, identified from that record:\n");
  print_standard_errors(r);
  print_multipliers(r);
}

void close_the_loop(const Record& record, const std::string& folder) {
  std::printf("\n3. Closing the loop: the record against the model, which knows of no drag.\n");
  const auto model = diagnosis::make_machine("hopper");
  Progress progress("diagnosing");
  diagnosis::Options options;
  options.progress = [&](double fraction, const char*) { progress.at(fraction); };
  const diagnosis::Diagnosis d = diagnosis::diagnose(record, *model, options);
  for (const std::string& line : d.story) std::printf("   %s\n", line.c_str());
  const std::string page = write_diagnosis_page(d, folder);
  std::printf("\nThe same again: saltus diagnose %s/record.csv --model hopper --report %s\n", folder.c_str(),
              folder.c_str());
  std::printf("Error on held-out data, in units of the noise: before %.4g, after %.4g\n", d.heldout.before,
              d.heldout.after);
  std::printf("Report: %s\n", page.c_str());
}

void run(const std::string& folder) {
  const Hopper<> m;
  std::printf("A vertical hopper: %g kg on a spring over %g kg, driven by a clock of one turn per second.\n\n", m.M,
              m.m);
  identify_model(m, folder);
  Record record = measure();
  write_record(std::filesystem::path(folder) / "record.csv", record);
  record.name = folder + "/record.csv";
  identify_machine(m, record);
  close_the_loop(record, folder);
}

}  // namespace

void add_demo(CLI::App& app) {
  auto* command = app.add_subcommand(
      "demo",
      "The whole story on an emulated hopper: experiment, identification, diagnosis, report; in under a minute");
  command->footer("Example: saltus demo --pictures saltus-demo");
  auto folder = std::make_shared<std::string>("saltus-demo");
  command->add_option("--pictures", *folder, "draw, record and report into FOLDER")
      ->type_name("FOLDER")
      ->capture_default_str();
  command->callback([folder] { run(*folder); });
}

}  // namespace saltus::program
