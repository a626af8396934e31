// saltus models: what each model is made of.
#include <cstdio>

#include "../../core/hybrid/with.hpp"
#include "program.hpp"

namespace saltus::program {
namespace {

template <class L>
std::vector<std::string> names_of(L list) {
  std::vector<std::string> r;
  visit_each(list, [&](auto t) { r.emplace_back(type_name<decltype(t)>()); });
  return r;
}

template <class M>
nlohmann::json describe(M m) {
  nlohmann::json j{{"name", M::name}};
  j["edges"] = nlohmann::json::array();
  visit_each(typename M::Charts{}, [&](auto c) {
    using C = decltype(c);
    j["charts"].push_back({{"name", type_name<C>()}, {"dim", C::dim}, {"clock", HasClock<C>}});
  });
  visit_each(typename M::Edges{}, [&](auto e) {
    using E = decltype(e);
    j["edges"].push_back(
        {{"name", type_name<E>()}, {"from", type_name<typename E::from>()}, {"to", type_name<typename E::to>()}});
  });
  j["parameters"] = nlohmann::json::array();
  visit_parameters(m, [&](auto name, auto unit, double value) {
    j["parameters"].push_back({{"name", name}, {"value", value}, {"unit", unit}});
  });
  j["inputs"] = nlohmann::json::array();
  j["outputs"] = nlohmann::json::array();
  for (const Quantity& q : M::inputs) j["inputs"].push_back({{"name", q.name}, {"unit", q.unit}});
  for (const Quantity& q : M::outputs) j["outputs"].push_back({{"name", q.name}, {"unit", q.unit}});
  j["ports"] = names_of(typename PortsOf<M>::type{});
  return j;
}

void print(const nlohmann::json& j) {
  std::printf("%s\n", j["name"].get<std::string>().c_str());
  for (const auto& c : j["charts"]) {
    std::printf("  chart      %-14s dimension %d%s\n", c["name"].get<std::string>().c_str(), c["dim"].get<int>(),
                c["clock"].get<bool>() ? ", with a clock" : "");
  }
  for (const auto& e : j["edges"]) {
    std::printf("  edge       %-14s %s -> %s\n", e["name"].get<std::string>().c_str(),
                e["from"].get<std::string>().c_str(), e["to"].get<std::string>().c_str());
  }
  for (const auto& p : j["parameters"]) {
    std::printf("  parameter  %-14s %.9g %s\n", p["name"].get<std::string>().c_str(), p["value"].get<double>(),
                p["unit"].get<std::string>().c_str());
  }
  for (const char* kind : {"input", "output"}) {
    for (const auto& q : j[std::string(kind) + "s"]) {
      std::printf("  %-10s %-14s [%s]\n", kind, q["name"].get<std::string>().c_str(),
                  q["unit"].get<std::string>().c_str());
    }
  }
  for (const auto& p : j["ports"]) std::printf("  port       %s\n", p.get<std::string>().c_str());
}

}  // namespace

void add_models(CLI::App& app) {
  auto* command = app.add_subcommand("models", "The models: charts, edges, parameters, inputs, outputs, ports");
  command->footer("Example: saltus models --json -");
  auto json = std::make_shared<std::string>();
  command->add_option("--json", *json, "write JSON to FILE, - for standard output")->type_name("FILE");
  command->callback([json] {
    const bool quiet = check_outputs({{"--json", *json}});
    nlohmann::json all = nlohmann::json::array();
    visit_each(KnownModels{}, [&](auto m) { all.push_back(describe(m)); });
    visit_each(MachineModels{}, [&](auto m) { all.push_back(describe(m)); });
    if (!json->empty()) write_json(*json, all);
    if (quiet) return;
    for (const auto& j : all) print(j);
  });
}

}  // namespace saltus::program
