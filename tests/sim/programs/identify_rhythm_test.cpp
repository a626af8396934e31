// Records of machines that pace themselves, from the command line.
#include "tests/support/catch.hpp"
#include "tests/support/program.hpp"

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
  CHECK(done.out.find("multipliers of the model: none") != std::string::npos);
  const json j = json::parse(text_of(folder.path() / "x.json"));
  CHECK(j["model"] == "compass_gait_robot");
  CHECK(j["places"].size() == 8);
  REQUIRE(!j["multipliers"].empty());
  for (const json& m : j["multipliers"]) CHECK(m["sigma"].get<double>() > 0.0);
  CHECK(j["htf"].empty());
  CHECK(j["htf_refused"].get<std::string>().size() > 20);
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
