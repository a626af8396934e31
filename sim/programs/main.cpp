// saltus: one program, its subcommands one file each.
#include <cstdio>
#include <exception>

#include "program.hpp"

int main(int argc, char** argv) {
  using namespace saltus::program;
  CLI::App app{"Identifies rhythmic machines that hop, walk, juggle or bounce, and says what their model lacks.",
               "saltus"};
  app.require_subcommand(1);
  app.set_help_all_flag("--help-all", "the help of every subcommand");
  app.get_formatter()->column_width(34);
  add_models(app);
  add_orbit(app);
  add_htf(app);
  add_design(app);
  add_identify(app);
  add_control(app);
  add_coverage(app);
  add_diagnose(app);
  add_rig(app);
  add_log(app);
  add_link_test(app);
  add_demo(app);
  try {
    const std::string first = argc > 1 ? argv[1] : "-";
    if (first[0] != '-' && app.get_subcommands([&](const CLI::App* c) { return c->get_name() == first; }).empty()) {
      throw UsageError("there is no command '" + first + "'; see saltus --help");
    }
    app.parse(argc, argv);
    if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
      throw RunError("standard output cannot be written; see that there is room and that something reads it");
    }
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  } catch (const UsageError& e) {
    std::fprintf(stderr, "saltus: %s\n", e.what());
    return 2;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "saltus: %s\n", e.what());
    return 1;
  }
  return 0;
}
