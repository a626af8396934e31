// What one verdict found, carried to a record of another machine, from the command line; and the picture of it.
#include <nlohmann/json.hpp>

#include <fstream>
#include <sstream>

#include "tests/support/catch.hpp"
#include "tests/support/program.hpp"

using nlohmann::json;
using namespace saltus::test;

namespace {

// Two of the seven walks.
std::string two_walks() {
  std::istringstream in(text_of(std::filesystem::path(SALTUS_TEST_DATA) / "measured/compass-gait-walking.csv"));
  std::string text;
  for (std::string line; std::getline(in, line);) {
    if (line[0] == '#' || line[0] == 'e' || line[0] == '6' || line[0] == '7') text += line + "\n";
  }
  return text;
}

}  // namespace

TEST_CASE("friction of a bench's verdict is declared on the walker by --set FILE, and no more of it is missing there") {
  const Folder folder;
  folder.write("walk.csv", two_walks());
  const json verdict{{"verdict", "effect_found"},
                     {"effects",
                      {{{"name", "viscous_damper@hip"}, {"value", 0.00116}, {"unit", "N m s/rad"}},
                       {{"name", "coulomb_friction@hip"}, {"value", 0.0064}, {"unit", "N m"}}}},
                     {"parameters",
                      {{{"name", "motor_constant"}, {"declared", 0.0182}, {"with_effect", 0.0181}},
                       {{"name", "inertia"}, {"declared", 0.00432}, {"with_effect", 0.00434}}}}};
  folder.write("bench.json", verdict.dump());
  const auto done = folder.run({"diagnose", "walk.csv", "--holdout", "1", "--candidates", "coulomb_friction@hip",
                                "--set", "bench.json", "--json", "walk.json", "--picture", "walk.svg"});
  CAPTURE(done.out, done.err);
  REQUIRE(done.status == 0);
  CHECK(done.out.find("From bench.json: coulomb_friction@hip = 0.0064") != std::string::npos);
  CHECK(done.out.find("From bench.json: motor_constant = 0.0181") != std::string::npos);
  CHECK(done.out.find("inertia =") == std::string::npos);  // the walker knows none of that name
  const json j = json::parse(folder.read("walk.json"));
  for (const json& e : j["effects"]) CHECK(e["name"] != "coulomb_friction@hip");
  double declared = 0.0;
  for (const json& p : j["parameters"]) {
    if (p["name"] == "motor_constant") declared = p["declared"];
  }
  CHECK(declared == 0.0181);
  CHECK(folder.read("walk.svg").find("<svg") != std::string::npos);

  // As declared it predicts what the machine's own declared model does not.
  const auto plain = folder.run(
      {"diagnose", "walk.csv", "--holdout", "1", "--candidates", "coulomb_friction@hip", "--json", "plain.json"});
  REQUIRE(plain.status == 0);
  const auto before = [](const json& v) { return v["self_paced"]["free_runs"][0]["end_before"].get<double>(); };
  CHECK(before(j) < 0.8 * before(json::parse(folder.read("plain.json"))));
}

TEST_CASE("an effect that was declared is taken back where the record has none, and not beyond nothing") {
  const Folder folder;
  const std::string record = std::string(SALTUS_TEST_DATA) + "/hopper/open-none.csv";
  const auto done = folder.run({"diagnose", record, "--set", "quadratic_drag@body=0.03", "--candidates",
                                "quadratic_drag@body,cubic_stiffness@leg", "--json", "v.json"});
  CAPTURE(done.out, done.err);
  REQUIRE(done.status == 0);
  CHECK(done.out.find("from the declared 0.03") != std::string::npos);
  const json j = json::parse(folder.read("v.json"));
  CHECK(j["verdict"] == "effect_found");
  REQUIRE(j["effects"].size() == 1);
  const json& e = j["effects"][0];
  CHECK(e["name"] == "quadratic_drag@body");
  CHECK(e["declared"] == 0.03);
  CHECK(e["z"] < -20.0);
  CHECK(e["value"] >= 0.0);
  CHECK(e["value"] < e["ci95"][1]);
  CHECK(e["ci95"][1] < 0.003);

  const auto wrong = folder.run({"diagnose", record, "--set", "quadratic_drag=0.03"});
  CHECK(wrong.status == 2);
  CHECK(wrong.err.find("no parameter or effect 'quadratic_drag'") != std::string::npos);
  const auto tolerance = folder.run({"diagnose", record, "--tolerance", "quadratic_drag@body=1"});
  CHECK(tolerance.status == 2);
  CHECK(tolerance.err.find("no parameter 'quadratic_drag@body'") != std::string::npos);
}

TEST_CASE("a file that is no verdict, or speaks of nothing that fits, is refused by name") {
  const Folder folder;
  folder.write("walk.csv", two_walks());
  const auto refused = [&](const std::string& text) {
    folder.write("v.json", text);
    const auto done = folder.run({"diagnose", "walk.csv", "--set", "v.json"});
    CHECK(done.status == 1);
    CHECK(done.err.find("v.json: ") != std::string::npos);
    return done.err;
  };
  CHECK(refused("friction = 3").find("no verdict") != std::string::npos);
  CHECK(refused("{\"verdict\": \"effect_found\"}").find("no list of effects") != std::string::npos);
  CHECK(refused("{\"effects\": [{\"name\": \"leg_spring\", \"value\": 1}]}").find("leg_spring") != std::string::npos);
}

TEST_CASE("a run's log is diagnosed as the record of the same run is") {
  const Folder f;
  REQUIRE(f.run({"identify", "hopper", "--period", "16", "--band", "2", "--periods", "3", "--settle", "20", "--noise",
                 "0.001,0.006", "--amplitude", "0.1", "--save", "run.csv"})
              .status == 0);
  REQUIRE(f.run({"log", "run.csv", "run.lcm"}).status == 0);
  const auto verdict = [&](const std::string& record) {
    const auto done = f.run({"diagnose", record, "--model", "hopper", "--json", "v.json"});
    CAPTURE(done.err);
    REQUIRE(done.status == 0);
    json j = json::parse(f.read("v.json"));
    j.erase("record");
    j.erase("seconds");
    j.erase("story");  // begins with the file's name
    return j;
  };
  const json csv = verdict("run.csv");
  CHECK(csv["verdict"] == "no_discrepancy");
  CHECK(verdict("run.lcm") == csv);
}
