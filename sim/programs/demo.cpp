// saltus demo: the whole story on embedded defaults, no network and no hardware.
#include "identify.hpp"

namespace saltus::program {
namespace {

void run(const std::string& folder) {
  const Hopper<> m;
  std::printf("A vertical hopper: %g kg on a spring over %g kg, driven by a clock of one turn per second.\n", m.M, m.m);
  IdentifyOptions o;
  o.plan.opposed = true;
  const Plan plan = make_plan(o.plan);
  std::printf(
      "Its limit cycle is found, and %zu experiments of %lld cycles excite it around that cycle: %d frequencies.\n",
      plan.experiments.size(), static_cast<long long>(o.campaign.settle + o.plan.period), plan.lines());
  std::vector<HtfPanel> panels;
  const auto identify = [&](const auto& family) {
    const Identified r = identify_rig(m, family, o, plan, nullptr);
    std::printf("\nPoincare sections at 32 values of the %s\n",
                r.sections == "clock" ? "clock phase (isochrons)" : "kinematic phase");
    print_errors(r);
    print_multipliers(r);
    for (const HtfPanel& p : panels_of(r)) panels.push_back(p);
  };
  identify(ClockPhases{sections_per_cycle});
  identify(KinematicPhases{sections_per_cycle});
  std::printf("\n");
  write_pictures(folder, panels);
}

}  // namespace

void add_demo(CLI::App& app) {
  auto* command = app.add_subcommand("demo", "The whole story on an emulated hopper, in under a minute");
  command->footer("Example: saltus demo --pictures saltus-demo");
  auto folder = std::make_shared<std::string>("saltus-demo");
  command->add_option("--pictures", *folder, "draw into FOLDER")->type_name("FOLDER")->capture_default_str();
  command->callback([folder] { run(*folder); });
}

}  // namespace saltus::program
