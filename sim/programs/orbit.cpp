// saltus orbit MODEL: its limit cycle, the multipliers and ranks of its return maps, and how far each can be trusted.
#include "../report/orbit_figures.hpp"
#include "orbit_multipliers.hpp"
#include "orbit_output.hpp"
#include "orbit_search.hpp"

namespace saltus::program {

namespace {

constexpr std::int64_t most_ticks = 65536;  // a cycle, whose search then takes a minute at most

std::unique_ptr<OrbitReport> orbit_of(const OrbitOptions& options) {
  std::unique_ptr<OrbitReport> report;
  const std::int64_t most = most_ticks / options.returns / 32 * 32;
  if (options.model.ticks > most) {
    throw UsageError("--ticks " + std::to_string(options.model.ticks) + ": at most " + std::to_string(most) +
                     (options.returns > 1 ? " with so many --returns" : "") + "; finer steps only add rounding");
  }
  with_model(options.model, [&](const auto& m) {
    report = std::make_unique<OrbitReport>(OrbitSearch<std::remove_cvref_t<decltype(m)>>(m, options).report());
  });
  return report;
}

}  // namespace

std::vector<Complex> orbit_multipliers(const ModelChoice& model) {
  OrbitOptions options;
  options.model = model;
  const WideMultipliers m = orbit_of(options)->multipliers;
  return {m.value.begin(), m.value.begin() + m.nonzero};
}

void add_orbit(CLI::App& app) {
  auto* command =
      app.add_subcommand("orbit", "The limit cycle of a model: multipliers, ranks, bounds, assumptions, stability");
  command->footer(
      "Finds stable and unstable cycles by Newton's method; with --set it follows the cycle from the default "
      "parameters.\n"
      "Every number comes from twice --ticks steps a return, its error from the comparison with --ticks.\n"
      "Example: saltus orbit kneed_biped --set slope=0.055 --json orbit.json --picture orbit.svg");
  struct Options : OrbitOptions {
    std::string json, picture;
  };
  auto o = std::make_shared<Options>();
  o->model.add_to(*command);
  command
      ->add_option(
          "--sections", o->sections,
          "where the return map is taken: clock, kinematic, or the name of an edge (default: clock for a model "
          "with a clock, else its first edge)")
      ->type_name("NAME");
  command->add_option("--count", o->count, "sections a cycle of clock or kinematic")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command
      ->add_option(
          "--kinematic", o->kinematic,
          "origin and scale of the kinematic phase: o_p,o_v,s_p,s_v (default: the orbit's own; 1.9,0,0.3,1.9 for "
          "the hopper)")
      ->delimiter(',')
      ->expected(4);
  command
      ->add_option("--start", o->start, "x1,x2,...: start the search here, in the first chart of the model's own start")
      ->delimiter(',');
  command
      ->add_option("--returns", o->returns, "passages of the first event that make a cycle; 2 finds a doubled period")
      ->check(CLI::Range(1, max_cycle_events))
      ->capture_default_str();
  command->add_option("--json", o->json, "write JSON to FILE, - for standard output")->type_name("FILE");
  command
      ->add_option("--picture", o->picture,
                   "draw phase portrait, multipliers and ranks into FILE, as SVG; - for standard output")
      ->type_name("FILE");
  command->callback([o] {
    o->portrait = !o->picture.empty();
    const bool quiet = check_outputs({{"--json", o->json}, {"--picture", o->picture}});
    const auto report = orbit_of(*o);
    const std::string picture = o->picture.empty() ? "" : orbit_figure(*report).svg();
    if (!o->json.empty()) write_json(o->json, orbit_json(*report));
    if (!o->picture.empty()) write_text(o->picture, picture);
    if (!quiet) print_orbit(*report);
    if (const std::string doubt = explain(*report); !doubt.empty()) throw RunError(report->model + ": " + doubt);
  });
}

}  // namespace saltus::program
