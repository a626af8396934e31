// saltus rig MODEL: the emulated machine, on a link, until stopped.
#include "rig.hpp"

namespace saltus::program {
namespace {

void run(const RigOptions& o) {
  if (o.link.inproc()) throw UsageError("--link inproc: a rig of its own needs a network, for example udpm://");
  if (o.link.replay()) throw UsageError("--link " + o.link.url + ": a rig is a machine, not the log of one");
  if (o.link.url.rfind("memq", 0) == 0) {
    throw UsageError("--link " + o.link.url + ": memq stays within one process; write udpm://");
  }
  if (!o.effects.empty()) return serve_with_effects(o);
  with_model(o.model, [&](auto m) {
    using M = decltype(m);
    if constexpr (input_count < M >> 0) {
      o.sections.visit<M>([&](const auto& family) { serve_model(m, family, o); });
    } else {
      throw RunError(std::string(M::name) + " has no input to drive; choose a model that has one");
    }
  });
}

}  // namespace

void add_rig(CLI::App& app) {
  auto* command = app.add_subcommand("rig", "The emulated machine, on a link, until stopped");
  command->footer(
      "Examples: saltus rig hopper --link udpm:// --noise 0.001,0.006\n"
      "          saltus rig hopper --effect quadratic_drag@body=0.03\n"
      "          saltus rig hopper --link 'udpm://239.255.76.67:7667?ttl=1' --rate 1000 --log rig.lcm");
  auto o = std::make_shared<RigOptions>();
  o->link.url = "udpm://";
  o->model.add_to(*command);
  command->add_option("--link", o->link.url, "where it answers: udpm://[GROUP:PORT][?ttl=N]")->capture_default_str();
  o->link.add_to(*command);
  o->sections.add_to(*command, false);
  command->add_option("--noise", o->noise, "standard deviation of each output, in its unit")->delimiter(',');
  command->add_option("--quantum", o->quantum, "step of each output, in its unit")->delimiter(',');
  command
      ->add_option("--effect", o->effects,
                   "NAME=VALUE: what the machine has and its model lacks, for example quadratic_drag@body=0.03, in SI "
                   "units; may be repeated")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  command->add_option("--delay", o->delay, "sections that the input acts late")->check(CLI::Range(0, 63));
  command->add_option("--jitter", o->jitter, "seconds by which its instants of measurement scatter, standard deviation")
      ->check(CLI::Range(0.0, 1.0));
  command->add_option("--seed", o->seed, "of the noise")->capture_default_str();
  command->callback([o] { run(*o); });
}

}  // namespace saltus::program
