#include "declared.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "program.hpp"

namespace saltus::program {
namespace {

// What a verdict file says was found on another machine: the effects, and the parameters beside them where `own` knows
// them by the same name.
std::vector<Setting> carried(const std::string& path, const diagnosis::Machine& own) {
  std::ifstream in(path);
  nlohmann::json j;
  try {
    j = nlohmann::json::parse(in);
  } catch (const nlohmann::json::exception& e) {
    throw RunError(path + ": it is no verdict: " + e.what() + "; give the file that saltus diagnose --json wrote");
  }
  const auto here = [&](const std::string& name) {
    return std::any_of(own.coefficients.begin(), own.coefficients.end(), [&](const auto& c) { return c.name == name; });
  };
  std::vector<Setting> r;
  if (!j.is_object() || !j.contains("effects") || !j["effects"].is_array()) {
    throw RunError(path + ": it has no list of effects; give the file that saltus diagnose --json wrote");
  }
  std::string missing;
  for (const auto& e : j["effects"]) {
    const auto name = e.value("name", std::string());
    if (here(name) && e.contains("value") && e["value"].is_number()) {
      const double value = e["value"].get<double>(), angle = 2.0 * std::numbers::pi * e.value("phase", 0.0);
      r.push_back({name, value * std::cos(angle)});
      for (const auto& c : own.coefficients) {
        if (c.sine_of == name) r.push_back({c.name, value * std::sin(angle)});
      }
    } else {
      missing += (missing.empty() ? "" : ", ") + name;
    }
  }
  if (j.contains("parameters") && j["parameters"].is_array()) {
    for (const auto& p : j["parameters"]) {
      const auto name = p.value("name", std::string());
      if (here(name) && p.contains("with_effect") && p["with_effect"].is_number())
        r.push_back({name, p["with_effect"].get<double>()});
    }
  }
  if (r.empty())
    throw RunError(path + ": nothing in it fits " + own.name +
                   (missing.empty() ? "" : " (it speaks of " + missing + ")"));
  return r;
}

}  // namespace

double declared_value(const diagnosis::Machine& m, const std::string& name, const std::string& option, Sized sized) {
  const bool effects = sized == Sized::effects_too || !m.has_clock;
  std::string names;
  for (std::size_t i = 0; i < m.coefficients.size(); ++i) {
    const auto& c = m.coefficients[i];
    if (c.name == name && (effects || i < m.declared) && c.profile_of.empty()) return c.nominal;
    if (!c.candidate && i < m.declared) names += (names.empty() ? "" : ", ") + c.name;
  }
  throw UsageError(option + ": " + m.name + " has no parameter " + (effects ? "or effect " : "") + "'" + name +
                   "'; it has " + names + (effects ? ", and the effects that diagnose --json lists" : ""));
}

std::vector<std::pair<std::string, double>> declared(const std::vector<std::string>& settings,
                                                     const diagnosis::Machine& machine, bool told) {
  std::vector<std::pair<std::string, double>> r;
  for (const std::string& text : settings) {
    if (text.find('=') == std::string::npos && std::filesystem::exists(text)) {
      for (const Setting& s : carried(text, machine)) {
        r.emplace_back(s.name, s.value);
        if (told) std::printf("From %s: %s = %.6g\n", text.c_str(), s.name.c_str(), s.value);
      }
      continue;
    }
    const Setting s = parse_setting(text, "--set");
    declared_value(machine, s.name, "--set " + text, Sized::effects_too);
    r.emplace_back(s.name, s.value);
  }
  return r;
}

}  // namespace saltus::program
