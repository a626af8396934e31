// What every subcommand shares: help, wrong usage, model, parameters, output files, exit status.
#include "tests/support/program.hpp"
#include "tests/support/catch.hpp"

#include <sstream>

using saltus::test::Folder;
using Arguments = std::vector<std::string>;

namespace {

bool says(const std::string& text, const std::string& what) { return text.find(what) != text.npos; }

// As `saltus --help` lists them.
Arguments subcommands(const Folder& folder) {
  Arguments names;
  std::istringstream help(folder.run({"--help"}).out);
  std::string line;
  while (std::getline(help, line) && line != "Subcommands:") {
  }
  while (std::getline(help, line)) {
    if (line.size() > 3 && line.compare(0, 2, "  ") == 0 && line[2] != ' ') {
      names.push_back(line.substr(2, line.find(' ', 2) - 2));
    }
  }
  return names;
}

}  // namespace

TEST_CASE("Every subcommand explains itself with an example") {
  const Folder folder;
  const Arguments names = subcommands(folder);
  CHECK(names.size() >= 5);
  for (const char* known : {"models", "htf", "design", "identify", "demo"}) {
    CHECK(std::count(names.begin(), names.end(), known) == 1);
  }
  for (const std::string& name : names) {
    INFO(name);
    const auto help = folder.run({name, "--help"});
    CHECK(help.status == 0);
    CHECK(help.err.empty());
    CHECK(says(help.out, "Example"));
    CHECK(says(help.out, "saltus " + name));
    const auto wrong = folder.run({name, "--no-such-option"});
    CHECK(wrong.status == 2);
    CHECK(wrong.out.empty());
    CHECK((says(wrong.err, "--no-such-option") || says(wrong.err, "is required")));
  }
  CHECK(folder.files().empty());
}

TEST_CASE("Wrong usage is told from a failed run by the exit status, and named") {
  struct Case {
    Arguments arguments;
    int status;
    std::string says;
  };
  const std::vector<Case> cases{
      {{}, 2, "subcommand is required"},
      {{"frobnicate"}, 2, "there is no command 'frobnicate'"},
      {{"models", "extra"}, 2, "extra"},
      {{"htf"}, 2, "MODEL is required"},
      {{"htf", "unicycle"}, 2, "there is no model 'unicycle'; there are hopper"},
      {{"identify", "unicycle"}, 2, "there is no model 'unicycle'"},
      {{"htf", "hopper", "--set", "wings=2"}, 2, "hopper has no parameter 'wings'; it has m, M, k, b, l0, a, omega, g"},
      {{"htf", "hopper", "--set", "k"}, 2, "--set k: there is no NAME= in it; write NAME=VALUE"},
      {{"htf", "hopper", "--set", "=1"}, 2, "--set =1: there is no NAME= in it"},
      {{"htf", "hopper", "--set", "k="}, 2, "--set k=: the value is not a finite number"},
      {{"htf", "hopper", "--set", "k=ten"}, 2, "the value is not a finite number"},
      {{"htf", "hopper", "--set", "k=10N"}, 2, "the value is not a finite number"},
      {{"htf", "hopper", "--set", "k=nan"}, 2, "the value is not a finite number"},
      {{"htf", "hopper", "--set", "k=-inf"}, 2, "the value is not a finite number"},
      {{"htf", "hopper", "--set", "k=1e999"}, 2, "the value is not a finite number"},
      {{"htf", "hopper", "--ticks", "-32"}, 2, "--ticks"},
      {{"htf", "hopper", "--ticks", "0"}, 2, "--ticks"},
      {{"htf", "hopper", "--ticks", "500"}, 2, "--ticks: 500 is not a multiple of 32"},
      {{"htf", "hopper", "--ticks", "64.5"}, 2, "--ticks"},
      {{"htf", "hopper", "--ticks", "99999999999999999999"}, 2, "--ticks"},
      {{"identify", "hopper", "--ticks", "33"}, 2, "--ticks: 33 is not a multiple of 32"},
  };
  const Folder folder;
  for (const Case& c : cases) {
    std::string line = "saltus";
    for (const std::string& a : c.arguments) line += " " + a;
    INFO(line);
    const auto done = folder.run(c.arguments);
    CHECK(done.status == c.status);
    INFO(done.err);
    CHECK(says(done.err, c.says));
    CHECK(done.out.empty());
  }
  CHECK(folder.files().empty());
}

TEST_CASE("Parameters that no machine can have end in a message, never in a hang, a crash or numbers that are none") {
  const Folder folder;
  const Arguments impossible{"m=0",      "m=-1",         "k=-1",    "k=0", "M=0",   "M=-2", "omega=0",
                             "omega=-1", "omega=1e-300", "k=1e300", "b=0", "b=1e9", "g=-2"};
  for (const std::string& setting : impossible) {
    INFO(setting);
    for (const char* command : {"htf", "identify"}) {
      INFO(command);
      const auto done = folder.run({command, "hopper", "--set", setting, "--csv", "x.csv", "--json", "x.json"});
      CHECK(done.status == 1);
      CHECK(says(done.err, "saltus: hopper: "));
      CHECK(says(done.err, "change --set"));
      CHECK_FALSE(says(done.out, "nan"));
    }
  }
  // These have a cycle, if not one that attracts: a mass at rest, or hanging on its spring, or gone for good.
  for (const std::string setting : {"a=0", "l0=1e300", "a=1e9", "g=1e300", "b=-5", "m=1e300", "omega=1e300"}) {
    INFO(setting);
    const auto exact = folder.run({"htf", "hopper", "--set", setting});
    CHECK((exact.status == 0 || exact.status == 1));
    CHECK_FALSE(says(exact.out, "nan"));
    const auto driven = folder.run({"identify", "hopper", "--set", setting});
    CHECK(driven.status == 1);
    CHECK(says(driven.err, "does not attract"));
  }
  CHECK(folder.files().empty());
}

TEST_CASE("A path that cannot be written is refused before the work, and nothing is left behind") {
  const Folder folder;
  folder.write("a_file", "kept\n");
  std::filesystem::create_directory(folder.path("a_folder"));
  const Arguments before = folder.files();
  for (const std::string path : {"missing/x.csv", "a_folder", "a_file/x.csv", "."}) {
    INFO(path);
    for (const Arguments& command :
         {Arguments{"models", "--json"}, Arguments{"htf", "hopper", "--csv"}, Arguments{"htf", "hopper", "--json"},
          Arguments{"htf", "hopper", "--csv", "good.csv", "--picture"}, Arguments{"design", "--csv"},
          Arguments{"design", "--json", "good.json", "--samples"}, Arguments{"identify", "hopper", "--csv"},
          Arguments{"identify", "hopper", "--csv", "good.csv", "--json"},
          Arguments{"identify", "hopper", "--csv", "good.csv", "--save"}}) {
      Arguments arguments = command;
      arguments.push_back(path);
      INFO(command.front() << " " << command.back());
      const auto done = folder.run(arguments);
      CHECK(done.status == 1);
      CHECK(says(done.err, "saltus: " + path + ": the file cannot be written"));
      CHECK(says(done.err, "choose a folder that exists"));
      CHECK(done.out.empty());
      CHECK(folder.files() == before);
    }
  }
  CHECK(folder.read("a_file") == "kept\n");
}

TEST_CASE("Only one file can go to standard output, alone, and it has to arrive") {
  const Folder folder;
  CHECK(folder.run({"htf", "hopper", "--csv", "-"}).out.compare(0, 17, "m,f,output,re,im\n") == 0);
  CHECK(folder.run({"models", "--json", "-"}).out[0] == '[');
  for (const Arguments& command :
       {Arguments{"htf", "hopper", "--csv", "-", "--json", "-"}, Arguments{"design", "--csv", "-", "--samples", "-"},
        Arguments{"identify", "hopper", "--csv", "-", "--json", "-"}}) {
    INFO(command.front());
    const auto done = folder.run(command);
    CHECK(done.status == 2);
    CHECK(says(done.err, "--csv goes to standard output already"));
    CHECK(done.out.empty());
  }
  if (std::filesystem::is_character_file("/dev/full")) {
    for (const Arguments& command : {Arguments{"models"}, Arguments{"design", "--csv", "-"}}) {
      const auto done = folder.run(command, nullptr, "/dev/full");
      CHECK(done.status == 1);
      CHECK(says(done.err, "standard output cannot be written"));
    }
  }
  CHECK(folder.files().empty());
}
