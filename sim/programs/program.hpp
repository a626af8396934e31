// What the subcommands share: their registration, the choice of a model, and the two ways to fail. Exit status: 0 done,
// 1 bad input or a failed run, 2 wrong usage.
#pragma once

#include <CLI/CLI.hpp>

#include <nlohmann/json.hpp>

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "../models/registry.hpp"

namespace saltus::program {

// Wrong usage: names the option and the mend. Exit status 2.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// A run that failed: says what and what to do. Exit status 1.
struct RunError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// One function a subcommand.
void add_models(CLI::App& app);
void add_orbit(CLI::App& app);
void add_htf(CLI::App& app);
void add_design(CLI::App& app);
void add_identify(CLI::App& app);
void add_coverage(CLI::App& app);
void add_control(CLI::App& app);
void add_diagnose(CLI::App& app);
void add_rig(CLI::App& app);
void add_log(CLI::App& app);
void add_link_test(CLI::App& app);
void add_demo(CLI::App& app);

// MODEL, --set NAME=VALUE ... and how finely to integrate.
struct ModelChoice {
  std::string name;
  std::vector<std::string> settings;
  std::int64_t ticks = 512;  // [tick] a turn

  void add_to(CLI::App& command);
};

// NAME=VALUE, or UsageError.
struct Setting {
  std::string name;
  double value;
};
Setting parse_setting(const std::string& text, const char* option);

template <class M>
void set_parameters(M& m, const std::vector<std::string>& settings) {
  for (const std::string& text : settings) {
    const Setting s = parse_setting(text, "--set");
    bool known = false;
    std::string names;
    visit_parameters(m, [&](auto name, auto, double& value) {
      if (name == s.name) {
        value = s.value;
        known = true;
      }
      names += (names.empty() ? "" : ", ") + std::string(name);
    });
    if (!known) {
      throw UsageError("--set " + text + ": " + std::string(M::name) + " has no parameter '" + s.name + "'; it has " +
                       (names.empty() ? "none" : names));
    }
  }
}

// Calls f(m) with the chosen model, its parameters set.
template <class F>
void with_model(const ModelChoice& choice, F&& f) {
  const bool found = visit_model(choice.name, [&](auto m) {
    set_parameters(m, choice.settings);
    f(m);
  });
  if (found) return;
  bool recorded = false;
  visit_each(MachineModels{}, [&](auto m) { recorded = recorded || decltype(m)::name == choice.name; });
  if (recorded) throw UsageError("'" + choice.name + "' is known from records only: see saltus diagnose --help");
  throw UsageError("there is no model '" + choice.name + "'; there are " + known_models());
}

// Where a command writes: an option and its path, empty where it is not given.
struct OutputFile {
  const char* option;
  const std::string& path;
};
// Before the work begins: refuses a path that cannot be written and a second "-". True when one is "-", so that tables
// have to keep off standard output.
bool check_outputs(std::initializer_list<OutputFile> files);
// Writes text to a file, whole or not at all, or to standard output when path is "-".
void write_text(const std::string& path, const std::string& text);
void write_json(const std::string& path, const nlohmann::json& j);

// One line on a terminal, rewritten as work goes on; silent elsewhere.
class Progress {
 public:
  explicit Progress(std::string what);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  void at(double fraction);

 private:
  std::string what_;
  bool shown_ = false;
  int last_ = -1;
  bool terminal_;
};

// "%.6g" and friends, as a string.
std::string number(double x, const char* format = "%.6g");
std::string complex_number(double re, double im, int digits = 6);

}  // namespace saltus::program
