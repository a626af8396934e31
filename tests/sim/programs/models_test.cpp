#include "tests/support/catch.hpp"
#include "tests/support/program.hpp"

#include <nlohmann/json.hpp>

#include "core/hybrid/with.hpp"
#include "sim/models/registry.hpp"

using nlohmann::json;
using saltus::test::Folder;

namespace {

const json& named(const json& list, const std::string& name) {
  for (const json& item : list) {
    if (item.at("name") == name) return item;
  }
  throw std::runtime_error("nothing is named " + name);
}

}  // namespace

TEST_CASE("The hopper is listed with all it is made of") {
  const Folder folder;
  const auto done = folder.run({"models", "--json", "-"});
  REQUIRE(done.status == 0);
  const json all = json::parse(done.out);
  const json& hopper = named(all, "hopper");
  CHECK(hopper.at("charts") == json::parse(R"([{"name": "Flight", "dim": 5, "clock": true},
                                               {"name": "Stance", "dim": 3, "clock": true}])"));
  CHECK(hopper.at("edges") == json::parse(R"([{"name": "Touchdown", "from": "Flight", "to": "Stance"},
                                              {"name": "Liftoff", "from": "Stance", "to": "Flight"}])"));
  CHECK(hopper.at("inputs") == json::parse(R"([{"name": "u", "unit": "N"}])"));
  CHECK(hopper.at("outputs") == json::parse(R"([{"name": "y_M", "unit": "m"}, {"name": "v_M", "unit": "m/s"}])"));
  CHECK(hopper.at("ports").size() == 3);
  const std::vector<std::tuple<std::string, double, std::string>> parameters{{"m", 1.0, "kg"},
                                                                             {"M", 2.0, "kg"},
                                                                             {"k", 10.0, "N/m"},
                                                                             {"b", 5.0, "N s/m"},
                                                                             {"l0", 2.0, "m"},
                                                                             {"a", 20.0, "N"},
                                                                             {"omega", 6.283185307179586, "rad/s"},
                                                                             {"g", 2.0, "m/s^2"}};
  CHECK(hopper.at("parameters").size() == parameters.size());
  for (const auto& [name, value, unit] : parameters) {
    INFO(name);
    CHECK(named(hopper.at("parameters"), name).at("value") == value);
    CHECK(named(hopper.at("parameters"), name).at("unit") == unit);
  }
}

TEST_CASE("Every model of the registry is listed, in the table and in the file") {
  const Folder folder;
  const auto done = folder.run({"models", "--json", "models.json"});
  REQUIRE(done.status == 0);
  CHECK(folder.files() == std::vector<std::string>{"models.json"});
  const json all = json::parse(folder.read("models.json"));
  std::size_t models = 0;
  saltus::visit_each(saltus::KnownModels{}, [&](auto m) {
    using M = decltype(m);
    ++models;
    INFO(M::name);
    CHECK(done.out.find("\n" + std::string(M::name) + "\n") + 1 <= done.out.size());
    const json& j = named(all, std::string(M::name));
    for (const char* key : {"charts", "edges", "parameters", "inputs", "outputs", "ports"}) CHECK(j.at(key).is_array());
    CHECK(j.at("charts").size() >= 1);
    CHECK(j.at("edges").size() >= 1);
    CHECK(j.at("inputs").size() == M::inputs.size());
    CHECK(j.at("outputs").size() == M::outputs.size());
    CHECK(j.at("parameters").size() == M::parameters().size());
    for (const json& edge : j.at("edges")) {  // between charts that there are
      named(j.at("charts"), edge.at("from"));
      named(j.at("charts"), edge.at("to"));
    }
  });
  CHECK(all.size() == models + saltus::MachineModels::size);
  for (const char* machine : {"pendulum", "leg_bench", "compass_gait_robot"}) {
    INFO(machine);
    CHECK(named(all, machine).at("parameters").size() >= 4);
  }
}
