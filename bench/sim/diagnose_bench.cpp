// Where the time of a diagnosis goes: the hopper's record of 7 experiments of 296 cycles with a drag that the model
// lacks, all candidates. One run; each row is one of the stages that `saltus diagnose --json` lists under "seconds".
#include <benchmark/benchmark.h>

#include <algorithm>

#include "sim/diagnosis/diagnosis.hpp"
#include "sim/diagnosis/synthetic.hpp"

namespace {

using namespace saltus;
using namespace saltus::diagnosis;

using Stages = std::vector<std::pair<std::string, double>>;

// [s]; empty where it failed.
const Stages& stages() {
  static const Stages all = [] {
    const auto machine = make_machine("hopper");
    Campaign c;
    c.noise = {1e-3, 6e-3};
    std::vector<double> values;
    if (!values_with(*machine, {{"quadratic_drag@body", 0.1}}, values)) return Stages{};
    const Record record = synthesise(*machine, values, c, 1);
    const Diagnosis d = diagnose(record, *make_machine("hopper"), {});
    Stages s{{"all", 0.0}};
    for (const auto& [what, seconds] : d.seconds) {
      s.emplace_back(what, seconds);
      s.front().second += seconds;
    }
    return d.verdict == Verdict::effect_found ? s : Stages{};
  }();
  return all;
}

[[maybe_unused]] const bool added = [] {
  for (const char* const stage :
       {"all", "reading the record", "refitting the declared parameters", "searching for effects", "looking for twins",
        "how sure it is", "predicting held-out data", "locating and drawing"}) {
    const auto row = [stage](benchmark::State& state) {
      const Stages& s = stages();
      const auto found = std::find_if(s.begin(), s.end(), [&](const auto& p) { return p.first == stage; });
      if (found == s.end()) return state.SkipWithError("there was no such stage");
      for (auto _ : state) state.SetIterationTime(found->second);
    };
    benchmark::RegisterBenchmark((std::string("diagnose, 7 x 296 cycles | ") + stage).c_str(), row)
        ->Iterations(1)
        ->UseManualTime()
        ->Unit(benchmark::kMillisecond);
  }
  return true;
}();

}  // namespace
