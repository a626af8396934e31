// saltus calibrate: how often is a diagnosis right? Machines with known effects are measured and diagnosed, seed by
// seed.
#include "calibrate.hpp"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <set>

#include "../diagnosis/diagnosis.hpp"
#include "../diagnosis/side_by_side.hpp"
#include "../diagnosis/synthetic.hpp"
#include "../format.hpp"
#include "core/random.hpp"

namespace saltus::program {
namespace {

using namespace diagnosis;

struct Arguments {
  std::string model = "hopper", json, keep;
  std::vector<std::string> effects;
  std::vector<std::string> scenarios{"none", "parameters", "single", "pair", "outside"};
  int trials = 20;
  int experiments = 4, period = 32, jobs = 1;
  std::uint64_t seed = 1;
  double times = 3.0, process = 0.0, colour = 0.0;
};

using Sizes = std::vector<std::pair<std::string, double>>;  // of effects, by name

struct Truth {
  std::string label;
  Sizes limits;  // in detection limits of the experiment
  std::set<std::string> effects;
  bool parameters_off = false;
  bool outside = false;  // the cause is no candidate
};

// What became of one record, or of many.
struct Score {
  int trials = 0, right = 0, tie = 0, wrong = 0, nothing = 0, unexplained = 0, refused = 0, covered = 0, intervals = 0;
  std::map<std::string, int> named;  // what was said, where it was not the truth alone

  void add(const Score& s) {
    trials += s.trials;
    right += s.right;
    tie += s.tie;
    wrong += s.wrong;
    nothing += s.nothing;
    unexplained += s.unexplained;
    refused += s.refused;
    covered += s.covered;
    intervals += s.intervals;
    for (const auto& [said, count] : s.named) named[said] += count;
  }
  std::string said() const {
    std::string all;
    for (const auto& [what, count] : named)
      all += (all.empty() ? "" : ", ") + what + (count > 1 ? " x" + std::to_string(count) : "");
    return all;
  }
};

bool same(const Diagnosis& d, const std::set<std::string>& truth) {
  if (d.effects.size() != truth.size()) return false;
  for (const Finding& f : d.effects) {
    if (truth.count(f.name) == 0) return false;
  }
  return true;
}
// Whether an answer says that it may be no law of the library, but some force that repeats with the cycle.
bool no_law(const Diagnosis& d) {
  const auto any_force = [](const std::string& name) { return name.starts_with("periodic_force"); };
  return std::all_of(d.effects.begin(), d.effects.end(), [&](const Finding& f) {
    return any_force(f.name) || std::any_of(f.ties.begin(), f.ties.end(), any_force);
  });
}
// The truth is the answer, or among what the answer calls equally good.
bool tied(const Diagnosis& d, const std::set<std::string>& truth) {
  std::set<std::string> left = truth;
  for (const Finding& f : d.effects) {
    if (left.erase(f.name) > 0) continue;
    for (const auto& t : f.ties) {
      if (left.erase(t) > 0) break;
    }
  }
  if (left.empty() && d.effects.size() == truth.size()) return true;
  for (const Rival& r : d.rivals) {
    if (r.bic <= no_telling && std::set<std::string>(r.names.begin(), r.names.end()) == truth) return true;
  }
  return false;
}

std::string words_of(const Diagnosis& d) {
  if (d.effects.empty()) return std::string(name(d.verdict));
  std::vector<std::string> effects, sets;
  for (const Finding& f : d.effects) {
    effects.push_back(f.name);
    for (const std::string& t : f.ties) effects.back() += " or " + t;
  }
  sets.push_back(together(effects));
  for (const Rival& r : d.rivals) {
    const bool is_tie = r.names.size() == 1 && d.effects.size() == 1;  // said beside the effect already
    if (d.verdict != Verdict::ambiguous || r.bic > no_telling || is_tie) continue;
    sets.push_back(together(r.names));
  }
  return listed(sets, " or ");
}

Score judge(const Diagnosis& d, const Truth& truth, const Sizes& sizes) {
  Score s;
  s.trials = 1;
  if (truth.effects.empty()) {
    (d.effects.empty() && d.verdict != Verdict::unexplained ? s.right : s.wrong) = 1;
  } else if (d.verdict == Verdict::unexplained) {
    s.unexplained = 1;
  } else if (d.effects.empty()) {
    s.nothing = 1;
  } else if (same(d, truth.effects) && d.verdict == Verdict::effect_found) {
    s.right = 1;
  } else if (truth.outside ? no_law(d) : tied(d, truth.effects)) {
    s.tie = 1;
  } else {
    s.wrong = 1;
  }
  if (s.right == 0) s.named[words_of(d)] = 1;
  for (const Finding& f : d.effects) {
    for (const auto& [effect, value] : sizes) {
      if (f.name != effect) continue;
      ++s.intervals;
      s.covered += value >= f.low && value <= f.high;
    }
  }
  return s;
}

// An experiment with stimuli of its own, and from a record of it without any effect what would be seen in it.
struct Experiment {
  Campaign campaign;
  std::map<std::string, CandidateRow> seen;
  std::map<std::string, double> bumps;  // limits of forces at one phase, which no candidate is
  double limit_z = 0.0;                 // [-] what is at its limit is off by, in standard errors

  Experiment() = default;
  Experiment(const Arguments& a, Campaign c) : campaign(std::move(c)) {
    const auto machine = make_machine(a.model);
    std::vector<double> nominal;
    values_with(*machine, {}, nominal);
    const Diagnosis empty = diagnose(synthesise(*machine, nominal, campaign, a.seed), *make_machine(a.model), {});
    for (const CandidateRow& row : empty.candidates) {
      if (row.limit > 0.0) seen.emplace(row.name, row);
    }
    for (const Profile& p : empty.profiles) {
      for (std::size_t i = 0; i < p.limit.size(); ++i) {
        if (p.limit[i] > 0.0) bumps.emplace(p.knots[i], p.limit[i]);
      }
    }
    limit_z = empty.threshold + power_95;
  }
  // The size that is that many limits off: of what is no straight line, not that many times the limit's. NaN: none is.
  double size_of(const std::string& effect, double limits) const {
    const auto bump = bumps.find(effect);
    if (bump != bumps.end()) return limits * bump->second;
    const auto row = seen.find(effect);
    if (row == seen.end()) return std::numeric_limits<double>::quiet_NaN();
    const CandidateRow& c = row->second;
    return c.clarity.empty() ? limits * c.limit : size_seen(c.clarity, limits * limit_z);
  }
};

// A label as a file may be called.
std::string file_name(std::string label) {
  std::replace_if(
      label.begin(), label.end(), [](char c) { return c == '/' || c == ':'; }, '_');
  return label;
}

// One record of a machine that has what `truth` says, diagnosed.
Score try_once(const Truth& truth, const Arguments& a, const Experiment& experiment, std::uint64_t seed) {
  Score score;
  const auto refuse = [&](const std::string& why) {
    score.trials = score.refused = 1;
    score.named["refused: " + why] = 1;
  };
  const auto machine = make_machine(a.model);
  Random random(seed, 99);
  Sizes sizes;
  for (const auto& [effect, limits] : truth.limits) {
    sizes.emplace_back(effect, experiment.size_of(effect, limits));
    if (std::isfinite(sizes.back().second)) continue;
    refuse("no " + effect + " is seen so clearly");
    return score;
  }
  Sizes changes = sizes;
  if (truth.parameters_off) {
    for (std::size_t i = 0; i < machine->declared; ++i) {
      const Coefficient& c = machine->coefficients[i];
      if (static_cast<int>(i) == machine->clock || c.candidate) continue;
      changes.emplace_back(c.name, c.nominal * (1.0 + 0.02 * random.normal()));
    }
  }
  std::vector<double> values;
  values_with(*machine, changes, values);
  const Record record = synthesise(*machine, values, experiment.campaign, seed);
  if (record.rows() == 0) {
    refuse("the machine did not keep its rhythm");
    return score;
  }
  try {
    score = judge(diagnose(record, *make_machine(a.model), {}), truth, sizes);
  } catch (const RecordError& e) {
    refuse(e.what());
  }
  if (!a.keep.empty() && score.right == 0)
    write_record(std::filesystem::path(a.keep) / file_name(truth.label + " " + std::to_string(seed) + ".csv"), record);
  return score;
}

bool wanted(const Arguments& a, const char* scenario) {
  return std::find(a.scenarios.begin(), a.scenarios.end(), scenario) != a.scenarios.end();
}

Campaign campaign_of(const Arguments& a) {
  Campaign campaign;
  campaign.experiments = a.experiments;
  campaign.period = a.period;
  campaign.settle = 24;
  campaign.process = a.process;
  campaign.colour = a.colour;
  if (a.model == "hopper") {
    campaign.noise = {1e-3, 6e-3};
  } else {
    campaign.noise = {1e-4, 1e-3};
    campaign.amplitude = 1.5e-3;
  }
  return campaign;
}

// The lines of the table, of effects that are seen in an experiment.
std::vector<Truth> lines(const Arguments& a, const Experiment& first) {
  std::vector<std::string> effects = a.effects;
  if (effects.empty()) {
    for (const auto& [name, row] : first.seen) {
      if (name.compare(0, 10, "asymmetric") != 0) effects.push_back(name);
    }
  }
  std::vector<Truth> table;
  if (wanted(a, "none")) table.push_back({"no effect", {}, {}});
  if (wanted(a, "parameters")) table.push_back({"parameters off by their tolerances", {}, {}, true});
  if (wanted(a, "single")) {
    for (const std::string& e : effects) {
      if (first.seen.count(e) == 0)
        throw UsageError("--effects " + e + ": not a candidate that can be seen on this campaign");
      table.push_back({e, {{e, a.times}}, {e}});
    }
  }
  if (wanted(a, "pair")) {  // each with the one half the list further on: neighbours are near twins
    for (std::size_t i = 0; i < effects.size() / 2; ++i) {
      const auto &x = effects[i], &y = effects[i + effects.size() / 2];
      if (first.seen.count(x) == 0 || first.seen.count(y) == 0) continue;
      table.push_back({x + " + " + y, {{x, 2.0 * a.times}, {y, a.times}}, {x, y}});
    }
  }
  if (wanted(a, "outside")) {
    const auto machine = make_machine(a.model);
    for (const Coefficient& c : machine->coefficients) {
      if (c.profile_of.empty() || c.name.back() != '5') continue;
      table.push_back({"outside: " + c.name, {{c.name, a.times}}, {c.name}, false, true});
    }
  }
  return table;
}

void run(const Arguments& a) {
  if (!make_machine(a.model))
    throw UsageError("MODEL " + a.model + ": there is no such model to calibrate on; choose hopper or bouncing_ball");
  if (!a.keep.empty()) std::filesystem::create_directories(a.keep);
  Progress progress("calibrating");
  // Every trial of a line has stimuli of its own, the same ones in every line.
  const auto trials = static_cast<std::size_t>(a.trials);
  std::vector<Experiment> experiments(trials);
  const bool limits = wanted(a, "single") || wanted(a, "pair") || wanted(a, "outside");
  const auto jobs = static_cast<std::size_t>(a.jobs);
  const auto plan = [&](std::size_t n) {
    Campaign campaign = campaign_of(a);
    campaign.stimuli = a.seed + n;
    if (limits) {
      experiments[n] = Experiment(a, std::move(campaign));
    } else {
      experiments[n].campaign = std::move(campaign);
    }
  };
  side_by_side(trials, plan, jobs);
  const std::vector<Truth> table = lines(a, experiments.front());
  nlohmann::json all = nlohmann::json::array();
  if (a.json != "-") {
    std::printf(
        "| truth | trials | right | tie | wrong | nothing | unexplained | refused | interval covers | said instead |\n"
        "|---|---|---|---|---|---|---|---|---|---|\n");
  }
  for (std::size_t row = 0; row < table.size(); ++row) {
    const Truth& truth = table[row];
    // Each trial has a seed of its own, so that their number and order of ending decide nothing.
    std::vector<Score> scores(trials);
    const auto diagnosed = [&](std::size_t n) {
      scores[n] = try_once(truth, a, experiments[n], a.seed + 1000 * (row + 1) + n);
    };
    side_by_side(trials, diagnosed, jobs);
    progress.at(static_cast<double>(row + 1) / static_cast<double>(table.size()));
    Score score;
    for (const Score& s : scores) score.add(s);
    all.push_back({{"truth", truth.label},
                   {"trials", score.trials},
                   {"right", score.right},
                   {"tie", score.tie},
                   {"wrong", score.wrong},
                   {"nothing", score.nothing},
                   {"unexplained", score.unexplained},
                   {"refused", score.refused},
                   {"covered", score.covered},
                   {"intervals", score.intervals},
                   {"named", score.named}});
    if (a.json == "-") continue;
    std::printf("| %s | %d | %d | %d | %d | %d | %d | %d | %d of %d | %s |\n", truth.label.c_str(), score.trials,
                score.right, score.tie, score.wrong, score.nothing, score.unexplained, score.refused, score.covered,
                score.intervals, score.said().c_str());
    std::fflush(stdout);
  }
  if (!a.json.empty()) write_json(a.json, all);
}

}  // namespace

void add_calibrate(CLI::App& app) {
  auto* command = app.add_subcommand(
      "calibrate", "How often a diagnosis is right: emulated machines with known effects, seed by seed");
  command->footer("Example: saltus calibrate hopper --trials 50 --scenarios single --times 10");
  auto a = std::make_shared<Arguments>();
  command->add_option("MODEL", a->model, "the model: hopper or bouncing_ball")->capture_default_str();
  command->add_option("--scenarios", a->scenarios, "none, parameters, single, pair, outside")
      ->delimiter(',')
      ->check(CLI::IsMember({"none", "parameters", "single", "pair", "outside"}));
  command->add_option("--effects", a->effects, "the effects to try; all that can be seen where not given")
      ->delimiter(',');
  command->add_option("--trials", a->trials, "seeds a line of the table")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command
      ->add_option("--times", a->times,
                   "size of an effect, in detection limits of the experiment; the first of a pair is twice as large")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command
      ->add_option(
          "--process", a->process,
          "random force beside the input that no record holds, new in every section, one standard deviation in "
          "the input's unit")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command
      ->add_option("--colour", a->colour,
                   "correlation of the sensors' noise from section to section, 0 where it is white")
      ->check(CLI::Range(0.0, 0.999))
      ->capture_default_str();
  command->add_option("--experiments", a->experiments, "experiments of a campaign")
      ->check(CLI::Range(2, 64))
      ->capture_default_str();
  command->add_option("--period", a->period, "cycles of a stimulus period")
      ->check(CLI::Range(8, 64))
      ->capture_default_str();
  command->add_option("--seed", a->seed, "seed of everything random")->capture_default_str();
  command->add_option("--jobs", a->jobs, "records diagnosed at a time; the table does not depend on it")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  command->add_option("--keep", a->keep, "write the records that were not diagnosed right, and nothing else, to DIR")
      ->type_name("DIR");
  command->add_option("--json", a->json, "write JSON to FILE, - for standard output")->type_name("FILE");
  command->callback([a] { run(*a); });
}

}  // namespace saltus::program
