// How often a diagnosis is right: the small version of what the README's table is made with.
#include <nlohmann/json.hpp>

#include "tests/support/catch.hpp"
#include "tests/support/program.hpp"

using namespace saltus::test;

TEST_CASE("calibrate: known effects are named or tied with their twins, none is invented, and jobs decide nothing") {
  const Folder f;
  const auto table = [&](const char* scenarios, const char* jobs) {
    const auto done = f.run({"calibrate", "hopper", "--scenarios", scenarios, "--effects", "viscous_damper@leg",
                             "--times", "10", "--trials", "2", "--experiments", "3", "--jobs", jobs, "--json", "-"});
    INFO(done.err);
    REQUIRE(done.status == 0);
    return nlohmann::json::parse(done.out);
  };
  const auto rows = table("none,single", "2");
  REQUIRE(rows.size() == 2);
  for (const auto& row : rows) {
    INFO(row.dump());
    CHECK(row.at("trials") == 2);
    CHECK(row.at("right").get<int>() + row.at("tie").get<int>() == 2);
    CHECK(row.at("refused") == 0);
  }
  CHECK(table("none", "1").at(0) == rows.at(0));

  // What no candidate is, is not named.
  const auto outside = f.run({"calibrate", "bouncing_ball", "--scenarios", "outside", "--times", "3", "--trials", "1",
                              "--keep", "kept", "--json", "-"});
  REQUIRE(outside.status == 0);
  const auto foreign = nlohmann::json::parse(outside.out);
  REQUIRE(foreign.size() == 2);
  for (const auto& row : foreign) CHECK(row.at("unexplained").get<int>() + row.at("tie").get<int>() == 1);
  CHECK(!f.read("kept/outside_ force_profile@body_5 1001.csv").empty());

  const auto unseen = f.run({"calibrate", "hopper", "--effects", "sensor_bias@y_M", "--trials", "1"});
  CHECK(unseen.status == 2);
  CHECK(unseen.err.find("sensor_bias@y_M") != std::string::npos);
}
