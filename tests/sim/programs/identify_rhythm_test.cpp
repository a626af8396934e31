// Records of machines that pace themselves, from the command line.
#include "tests/support/catch.hpp"
#include "tests/support/program.hpp"
#include "tests/support/walks.hpp"

#include <nlohmann/json.hpp>

using nlohmann::json;
using namespace saltus::test;

namespace {
const std::string walking = std::string(SALTUS_TEST_DATA) + "/measured/compass-gait-walking.csv";
}

TEST_CASE(
    "a walk is identified from the command line: sections, multipliers, and why there are no transfer functions") {
  const Folder folder;
  const auto done = folder.run({"identify", "compass_gait_robot", "--record", walking, "--json", "x.json"});
  CAPTURE(done.out, done.err);
  REQUIRE(done.status == 0);
  CHECK(done.out.find("multipliers of a cycle") != std::string::npos);
  CHECK(done.out.find("no harmonic transfer functions") != std::string::npos);
  CHECK(done.out.find("multipliers of the model's own limit cycle: none") != std::string::npos);
  const json j = json::parse(text_of(folder.path() / "x.json"));
  CHECK(j["model"] == "compass_gait_robot");
  CHECK(j["places"].size() == 8);
  REQUIRE(!j["multipliers"].empty());
  for (const json& m : j["multipliers"]) CHECK(m["sigma"].get<double>() > 0.0);
  CHECK(j["htf"].empty());
  CHECK(j["htf_refused"].get<std::string>().size() > 20);
}

TEST_CASE("the model runs beside the walk from section to section, with what a verdict declares of it") {
  const Folder folder;
  folder.write("bench.json", R"({"effects": [{"name": "coulomb_friction@hip", "value": 0.0067}]})");
  const auto done =
      folder.run({"identify", "compass_gait_robot", "--record", walking, "--set", "bench.json", "--json", "x.json"});
  CAPTURE(done.out, done.err);
  REQUIRE(done.status == 0);
  CHECK(done.out.find("From bench.json: coulomb_friction@hip = 0.0067") != std::string::npos);
  CHECK(done.out.find("one step ahead: error rms") != std::string::npos);
  const json j = json::parse(text_of(folder.path() / "x.json"))["model_maps"];
  REQUIRE(j["sections"].size() == 8);
  for (const json& s : j["sections"]) {
    CHECK(s["runs"].get<int>() > 20);
    REQUIRE(s["prediction"].size() == 3);
    for (const json& c : s["prediction"]) CHECK(c["rms"].get<double>() > 0.0);
    for (const char* map : {"A_measured", "A_model", "A_difference_sigma"}) {
      REQUIRE(s[map].size() == 3);
      CHECK(s[map][0].size() == 3);
    }
  }
  const auto unknown = folder.run({"identify", "compass_gait_robot", "--record", walking, "--set", "friction=1"});
  CHECK(unknown.status == 2);
  CHECK(unknown.err.find("it has leg_mass") != std::string::npos);
}

TEST_CASE("sections by a phase that the walk does not have are refused, and nothing but a clock's by a clock") {
  const Folder folder;
  const auto both =
      folder.run({"identify", "compass_gait_robot", "--record", walking, "--sections", "both", "--json", "x.json"});
  CAPTURE(both.out, both.err);
  REQUIRE(both.status == 0);
  CHECK(both.out.find("turns of hip it falls back in") != std::string::npos);
  const json j = json::parse(text_of(folder.path() / "x.json"));
  REQUIRE(j.size() == 2);
  CHECK(j[0]["sections"] == "events");
  CHECK(j[1]["refused"].get<std::string>().find("falls back") != std::string::npos);
  const auto one = folder.run({"identify", "compass_gait_robot", "--record", walking, "--sections", "kinematic"});
  CHECK(one.status == 1);
  CHECK(one.err.find("falls back") != std::string::npos);
  const auto clock = folder.run({"identify", "compass_gait_robot", "--record", walking, "--sections", "clock"});
  CHECK(clock.status == 2);
  CHECK(clock.err.find("no clock paces") != std::string::npos);
}

TEST_CASE("a walker with a cycle of its own: its record, its model run beside it and its limit cycle agree") {
  const Folder folder;
  saltus::write_record(folder.path() / "walks.csv", walks_of(saltus::CompassGait<>{}, {}));
  const auto done = folder.run({"identify", "compass_gait", "--record", "walks.csv", "--json", "x.json"});
  CAPTURE(done.out, done.err);
  REQUIRE(done.status == 0);
  CHECK(done.out.find("multipliers of the model's own limit cycle: -0.1997 + 0.5445 i") != std::string::npos);
  const json j = json::parse(text_of(folder.path() / "x.json"));
  REQUIRE(j["model_maps"]["multipliers"].size() == 3);
  for (const json& m : j["model_maps"]["multipliers"]) CHECK(m["off"].get<double>() < 3.0);
  CHECK(std::abs(j["model_maps"]["multipliers"][0]["model"]["re"].get<double>() + 0.1997) < 0.02);
  const auto rubbed =
      folder.run({"identify", "compass_gait", "--record", "walks.csv", "--set", "viscous_damper@hip=0.5"});
  CAPTURE(rubbed.out, rubbed.err);
  CHECK(rubbed.status == 0);
  CHECK(rubbed.out.find("the model's decays are not the machine's") != std::string::npos);
}

TEST_CASE("a record of another machine, or of none that is known, is refused by name") {
  const Folder folder;
  const auto other = folder.run({"identify", "compass_gait", "--record", walking});
  CHECK(other.status == 1);
  CHECK(other.err.find("compass_gait_robot") != std::string::npos);
  const auto pendulum = folder.run(
      {"identify", "pendulum", "--record", std::string(SALTUS_TEST_DATA) + "/measured/pendulum-swing-up.csv"});
  CHECK(pendulum.status == 1);
  CHECK(pendulum.err.find(";") != std::string::npos);  // what to do about it
}
