// A controller from a model that was identified, from the command line.
#include "tests/support/catch.hpp"
#include "tests/support/program.hpp"

#include <nlohmann/json.hpp>

#include <cmath>
#include <sstream>

using namespace saltus::test;

TEST_CASE("control: what was realised from HTFs holds the hopper, and says so beforehand") {
  const Folder folder;
  REQUIRE(folder.run({"htf", "hopper", "--realise", "model.json", "--resolution", "16"}).status == 0);
  const auto done =
      folder.run({"control", "hopper", "--realised", "model.json", "--json", "loop.json", "--csv", "loop.csv"});
  INFO(done.err);
  REQUIRE(done.status == 0);
  CHECK(done.out.find("with control") != std::string::npos);
  const auto j = nlohmann::json::parse(folder.read("loop.json"));
  const auto& held = j.at("with_control");
  const auto& none = j.at("without_control");
  const double free_decay = none.at("decay"), decay = held.at("decay"), promised = held.at("decay_predicted");
  CHECK(std::abs(free_decay - 0.742) < 0.05);
  CHECK(decay < 0.5);
  CHECK(std::abs(decay / promised - 1.0) < 0.05);
  CHECK(j.at("regulator").size() == 32);
  CHECK(j.at("filter").at(0).at(0).size() == 2);
  std::istringstream csv(folder.read("loop.csv"));
  std::string line;
  std::getline(csv, line);
  CHECK(line == "control,cycle,section,u,y_M,v_M");
  int rows = 0;
  while (std::getline(csv, line)) ++rows;
  CHECK(rows == 2 * 12 * 32);
}

TEST_CASE("control: a model that is missing, foreign or none is refused with the mend") {
  const Folder folder;
  CHECK(folder.run({"control", "hopper"}).status == 2);
  const auto missing = folder.run({"control", "hopper", "--realised", "model.json"});
  CHECK(missing.status == 1);
  CHECK(missing.err.find("--realise") != std::string::npos);
  folder.write("model.json", "{}");
  CHECK(folder.run({"control", "hopper", "--realised", "model.json"}).status == 1);
  folder.write("model.json", R"({"sections_per_cycle":1,"outputs":1,"dim":[1],"A":[[[0.5]]],"B":[[[1]]],"C":[[[1]]]})");
  const auto foreign = folder.run({"control", "hopper", "--realised", "model.json"});
  CHECK(foreign.status == 1);
  CHECK(foreign.err.find("32") != std::string::npos);
  CHECK(folder.run({"control", "hopper", "--realised", "model.json", "--deviation", "0.1"}).status == 2);
}
