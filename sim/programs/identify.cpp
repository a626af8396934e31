// saltus identify MODEL: drives a machine, or reads a record of one, and identifies its harmonic transfer functions.
#include "identify.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <thread>

#include "../record_identification.hpp"
#include "any_record.hpp"
#include "identify_rhythm.hpp"

namespace saltus::program {
namespace {

// The channels of a record must be the model's, by name: a swapped or foreign column is not guessed at.
template <class M>
void match_channels(const Record& record) {
  const auto names = [](const auto& channels) {
    std::string s;
    for (const auto& c : channels) s += (s.empty() ? "" : ", ") + std::string(c.name);
    return s;
  };
  if (!record.model.empty() && record.model != M::name) {
    throw RecordError(record.name, "it is a record of the model '" + record.model + "', not of " + std::string(M::name),
                      "name that model on the command line");
  }
  const auto same = [&](const auto& a, const auto& b) {
    if (a.size() != b.size()) return false;
    for (std::size_t i = 0; i < a.size(); ++i) {
      if (std::string_view(a[i].name) != b[i].name) return false;
      if (a[i].unit.empty() || std::string_view(a[i].unit) == b[i].unit) continue;
      throw RecordError(
          record.name,
          a[i].name + " is in " + a[i].unit + "; " + std::string(M::name) + " has it in " + std::string(b[i].unit),
          "convert the column and correct its unit in the header");
    }
    return true;
  };
  if (!same(record.inputs, M::inputs)) {
    throw RecordError(
        record.name,
        "its inputs are " + names(record.inputs) + "; those of " + std::string(M::name) + " are " + names(M::inputs),
        "correct the line `# inputs`");
  }
  if (!same(record.outputs, M::outputs)) {
    throw RecordError(
        record.name,
        "its outputs are " + names(record.outputs) + "; those of " + std::string(M::name) + " are " + names(M::outputs),
        "correct the line `# outputs`");
  }
}

// A clock that turns in another time than the model's is another machine's.
void match_period(const Record& record, double period) {
  if (!record.cycle_period || std::abs(*record.cycle_period - period) <= 1e-3 * period) return;
  throw RecordError(
      record.name, "its clock turns in " + number(*record.cycle_period) + " s, the model's in " + number(period) + " s",
      "set the model's clock rate, --set omega=" + number(2.0 * std::numbers::pi / *record.cycle_period) +
          ", or correct `# cycle-period-s`");
}

// Drives a machine over LCM, or replays the log of one.
template <class M, class Family>
Identified identify_far(const M& m, const Family& family, const IdentifyOptions& o, const Plan& plan, Record* record) {
  constexpr int nu = input_count<M>, ny = output_count<M>;
  Presence me = presence_of(Role::experimenter, "identify", M::name, o.link);
  me.sections = plan.options.sections;
  me.cycle_period = timebase_of(m, o.model.ticks).period;
  me.stimulus_period = plan.options.period;
  me.settle = static_cast<std::int32_t>(o.campaign.settle);
  const auto drive = [&](auto& machine) {
    const auto play = [&](std::int32_t e, auto&, auto&&... how) { return machine.play(e, how...); };
    Identified r = identify_rig(m, family, o, plan, record, play);
    machine.finish();
    for (std::string& note : machine.notes()) r.id.notes.push_back(std::move(note));
    return r;
  };
  if (o.link.replay()) {
    MachineOfLog<nu, ny> machine(o.link, me);
    return drive(machine);
  }
  const StopSignal signals;
  o.link.set_up();
  const auto machine = std::make_unique<MachineOverLink<nu, ny>>(o.link, me);
  return drive(*machine);
}

// FNV-1a over the bits of every H_m: equal where two runs agree to the last bit.
std::string hash_of(const Identification& id) {
  std::uint64_t hash = 0xcbf29ce484222325;
  const auto add = [&](double x) {
    for (auto bits = std::bit_cast<std::uint64_t>(x), i = std::uint64_t{0}; i < 8; ++i, bits >>= 8) {
      hash = (hash ^ (bits & 0xff)) * 0x100000001b3;
    }
  };
  for (const HtfEstimate& h : id.htf) {
    add(h.value.real());
    add(h.value.imag());
  }
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
  return text;
}

// A record of a machine, beside what the model says.
template <class M>
Identified identify_beside(const M& m, const Record& record, const IdentifyOptions& o) {
  Identified r;
  r.sections = "clock";
  r.title = "isochrons";
  describe_channels<M>(r);
  if (o.any || o.stimulus != "multisine") {
    r.any = identify_any_stimulus(record, {o.multipliers, o.plan.period, o.plan.band, o.campaign.harmonics});
    r.id = std::move(r.any->id);
    if (!usable(r.any->status)) {
      throw RecordError(record.name, "least squares found no multipliers that explain it",
                        "seek another number of them, --count, or record a stronger stimulus");
    }
  } else {
    r.id = identify_record(record, o.campaign.harmonics);
  }
  std::unique_ptr<LdtpOf<M, sections_per_cycle>> system;
  if constexpr (clocked<M>) {
    system = std::make_unique<LdtpOf<M, sections_per_cycle>>();
    const auto orbit =
        find_orbit<sections_per_cycle>(m, timebase_of(m, o.model.ticks), ClockPhases{sections_per_cycle}, *system);
    if (orbit.status == Status::ok) {
      r.model_multipliers = nonzero_multipliers(system->monodromy(0));
    } else {
      r.id.notes.push_back("the model has no limit cycle to compare with (" + std::string(name(orbit.status)) + ")");
      system.reset();
    }
  }
  const std::vector<Complex> unknown(2, 1.0);  // nothing has settled for sure
  if (!r.any) refine(r, record, o, system ? r.model_multipliers : unknown);
  if (system) compare<M>(r, *system);
  if (r.any) {
    r.best.multipliers = r.any->multipliers;
    r.best.sigma = r.any->sigma;
    r.fits.clear();  // their lines are not independent of one another
  }
  return r;
}

template <class M>
void run_record(const M& m, const Record& record, const IdentifyOptions& o, bool quiet) {
  match_channels<M>(record);
  if constexpr (clocked<M>) match_period(record, timebase_of(m, o.model.ticks).period);
  const Identified r = identify_beside(m, record, o);
  if (!quiet) {
    const std::string from = o.record.empty() ? std::string(M::name) + ", " + o.stimulus : o.record;
    std::printf("%s: %zu rows, %d sections a cycle, %s %d cycles; %lld samples used, %lld missing\n", from.c_str(),
                record.rows(), r.id.sections, r.any ? "any stimulus, lines of" : "stimulus period", r.id.period,
                static_cast<long long>(r.id.samples), static_cast<long long>(r.id.missing));
    print_notes(r);
    print_standard_errors(r);
    print_multipliers(r);
  }
  nlohmann::json json = json_of(r);
  json["model"] = M::name;
  json["record"] = o.record.empty() ? o.save : o.record;
  if (o.confidence.wanted()) report_confidence(r, o.confidence, quiet, json);
  if (!o.pictures.empty()) write_pictures(o.pictures, panels_of(r), quiet);
  if (!o.csv.empty()) write_text(o.csv, csv_of(r, o.coherence));
  if (!o.json.empty()) write_json(o.json, json);
}

template <class M>
void run_rig(const M& m, const IdentifyOptions& o, bool quiet) {
  const bool paper = o.protocol == "paper";
  const Plan plan = plan_of(o.plan, o.design);
  if (!quiet) {
    std::printf("%s: %zu experiments of %lld + %lld cycles, %d lines below f = %g, %g %s a tone%s\n",
                std::string(M::name).c_str(), plan.experiments.size(), static_cast<long long>(o.campaign.settle),
                static_cast<long long>(o.campaign.periods * o.plan.period), plan.lines(),
                o.plan.band, o.plan.amplitude, std::string(M::inputs[0].unit).c_str(),
                o.plan.opposed ? ", each also with its sign reversed" : "");
  }
  std::vector<Identified> families;
  std::vector<HtfPanel> panels;
  std::vector<MultiplierRegion> regions;
  nlohmann::json json = nlohmann::json::array();
  Record record = blank_record<M>(plan, o.campaign.settle, timebase_of(m, o.model.ticks).period);
  o.sections.visit<M>([&](const auto& family) {
    IdentifyOptions own = o;  // noise of its own: what both families tell is to be compared
    own.campaign.seed += std::uint64_t{families.size()} << 32;
    Record* const saved = o.save.empty() ? nullptr : &record;
    const Identified r =
        o.link.inproc() ? identify_rig(m, family, own, plan, saved) : identify_far(m, family, own, plan, saved);
    if (!quiet) {
      std::printf("%s\n", r.title.c_str());
      print_notes(r);
      print_errors(r);
      if (!o.campaign.noise.empty()) print_standard_errors(r);
      print_multipliers(r);
    }
    nlohmann::json j = json_of(r);
    j["htf_hash"] = hash_of(r.id);
    j["model"] = M::name;
    if (o.confidence.wanted()) {
      ConfidenceOptions confidence = o.confidence;
      if (!families.empty() && !confidence.realise.empty()) confidence.realise = beside(confidence.realise, r.sections);
      regions.push_back(report_confidence(r, confidence, quiet, j));
    }
    json.push_back(j);
    for (const HtfPanel& p : panels_of(r)) panels.push_back(p);
    families.push_back(r);
  });
  if (regions.size() == 2) report_agreement(regions[0], regions[1], quiet, json);
  if (!quiet && paper) print_paper_table(families);
  // Nothing is written before everything is known.
  if (!o.pictures.empty()) write_pictures(o.pictures, panels, quiet);
  if (!o.save.empty()) write_record(std::filesystem::path(o.save), record);
  for (const Identified& r : families) {
    if (o.csv.empty()) break;
    write_text(&r == &families.front() ? o.csv : beside(o.csv, r.sections), csv_of(r, o.coherence));
  }
  if (!o.json.empty()) write_json(o.json, json.size() == 1 ? json[0] : json);
}

// With --record the machine has been driven already: what would drive it does not apply.
void check_record_options(const CLI::App& command, bool any, bool self_paced) {
  for (const char* option :
       {"--link",         "--log",         "--rate", "--protocol", "--sections",       "--kinematic", "--period",
        "--band",         "--amplitude",   "--seed", "--subsets",  "--tones",          "--odd",       "--detection",
        "--realisations", "--crest",       "--peak", "--ladder",   "--half-multiples", "--share",     "--distortion",
        "--stimulus",     "--cycles",      "--ramp", "--settle",   "--periods",        "--noise",     "--jitter",
        "--watch",        "--false-alarm", "--save"}) {
    if (command.count(option) == 0) continue;
    if (any && (option == std::string_view("--period") || option == std::string_view("--band"))) continue;
    if (self_paced && (option == std::string_view("--sections") || option == std::string_view("--kinematic"))) continue;
    throw UsageError(std::string(option) + ": it says how to drive a machine, and --record reads what was driven; " +
                     "leave out one of the two");
  }
}

void check_ladder(const IdentifyOptions& o) {
  if (o.ladder.empty()) return;
  if (o.ladder.size() < 2) throw UsageError("--ladder: give two amplitudes or more");
  for (const double a : o.ladder) {
    if (!(a > 0.0) || !std::isfinite(a)) throw UsageError("--ladder " + number(a) + ": give positive numbers");
  }
  if (!o.link.inproc() || !o.save.empty()) {
    throw UsageError(
        "--ladder: it is one campaign after the other on an emulated machine; leave out --link and --save");
  }
}

void run(const IdentifyOptions& given, const CLI::App& command) {
  IdentifyOptions o = given;
  // What the protocol stands for, unless said otherwise.
  const auto untouched = [&](const char* option) { return command.count(option) == 0; };
  if (o.protocol == "paper") {
    if (untouched("--sections")) o.sections.family = "both";
    if (untouched("--subsets")) o.plan.subsets = 80;
    if (untouched("--settle")) o.campaign.settle = 20;
  } else if (untouched("--subsets")) {
    o.plan.opposed = true;
  }
  if (!o.record.empty()) check_record_options(command, o.any, true);
  if (!o.record.empty() && !is_event_log(o.record)) {
    const Record record = read_record(std::filesystem::path(o.record));
    if (!record.clock_paced() && record.sections != "clock") {
      if (!untouched("--sections") && o.sections.family == "clock")
        throw UsageError("--sections clock: no clock paces " + o.record + "; use kinematic, both, or leave it out");
      identify_rhythm(o, record);
      return;
    }
  }
  if (!o.record.empty()) check_record_options(command, o.any, false);
  const bool quiet = check_outputs({{"--csv", o.csv}, {"--json", o.json}, {"--save", o.save}});
  if (o.csv == "-" && o.sections.family == "both") {
    throw UsageError("--csv -: there is one table for each family of sections; name a file, or choose --sections");
  }
  if (!o.save.empty() && (o.save == "-" || o.sections.family != "clock")) {
    throw UsageError("--save: name a file, and use --sections clock, for a record is paced by the clock");
  }
  for (const double sigma : o.campaign.noise) {
    if (!(sigma >= 0.0) || !std::isfinite(sigma)) {
      throw UsageError("--noise " + number(sigma) + ": a standard deviation is a finite number, 0 or above");
    }
  }
  for (const double sigma : o.campaign.watch) {
    if (!(sigma > 0.0) || !std::isfinite(sigma)) {
      throw UsageError("--watch " + number(sigma) + ": the noise of an output is a finite number above 0");
    }
  }
  const bool noisy = std::all_of(o.campaign.noise.begin(), o.campaign.noise.end(), [](double x) { return x > 0.0; });
  if (untouched("--watch") && o.link.inproc() && noisy) o.campaign.watch = o.campaign.noise;
  if (!(o.campaign.jitter >= 0.0) || !std::isfinite(o.campaign.jitter)) {
    throw UsageError("--jitter: a standard deviation is a finite number of seconds, 0 or above");
  }
  if (o.campaign.ramp > o.campaign.settle) {
    throw UsageError("--ramp: the stimulus grows while the machine settles; give no more than --settle cycles");
  }
  check_ladder(o);
  // The paper drops what has not settled.
  if (untouched("--transient") && o.protocol == "paper") o.transient = "drop";
  const bool played = o.stimulus != "multisine";
  if ((played || o.distortion) && (!o.link.inproc() || o.sections.family == "both")) {
    throw UsageError(
        "--stimulus, --distortion: they are for an emulated machine and one family of sections; leave out "
        "--link and --sections both");
  }
  if (played && (o.distortion || !o.ladder.empty() || o.sections.family != "clock")) {
    throw UsageError("--stimulus " + o.stimulus +
                     ": it is one experiment paced by the clock; leave out --distortion, " + "--ladder and --sections");
  }
  if ((played || o.distortion) && o.plan.half_multiples) {
    throw UsageError("--half-multiples: it takes several experiments; leave out --stimulus and --distortion");
  }
  o.campaign.on_drift = [](const Drift& d) { std::fprintf(stderr, "saltus: drift: %s\n", d.story().c_str()); };
  o.campaign.ticks = o.model.ticks;
  o.campaign.seed = o.plan.seed;
  if (untouched("--periods") && (!o.campaign.noise.empty() || o.campaign.jitter > 0.0)) o.campaign.periods = 4;
  if (!o.link.inproc() && o.sections.family == "both") {
    throw UsageError("--link " + o.link.url + ": the machine keeps one family of sections; add --sections clock");
  }
  with_model(o.model, [&](auto m) {
    using M = decltype(m);
    if constexpr (input_count < M >> 0) {
      o.plan.inputs = input_count<M>;
      if (!o.campaign.noise.empty() && o.campaign.noise.size() != static_cast<std::size_t>(output_count<M>)) {
        throw UsageError("--noise: " + std::string(M::name) + " has " + std::to_string(output_count<M>) +
                         " outputs; give one number for each");
      }
      if (!o.campaign.watch.empty() && o.campaign.watch.size() != static_cast<std::size_t>(output_count<M>)) {
        throw UsageError("--watch: " + std::string(M::name) + " has " + std::to_string(output_count<M>) +
                         " outputs; give the noise of each");
      }
      if (o.distortion) {
        identify_distortion(o, quiet);
      } else if (played) {
        const Record record = play_any_stimulus(o);
        run_record(m, record, o, quiet);
        if (!o.save.empty()) write_record(std::filesystem::path(o.save), record);
      } else if (o.record.empty()) {
        run_rig(m, o, quiet);
      } else {
        run_record(m, read_any_record(o.record, M::name), o, quiet);
      }
    } else {
      throw RunError(std::string(M::name) + " has no input to drive; choose a model that has one");
    }
  });
}

}  // namespace

Identified identify_hopper(const Hopper<>& m, const ClockPhases& family, const IdentifyOptions& o, const Plan& plan) {
  return identify_rig(m, family, o, plan, nullptr);
}
Identified identify_hopper(const Hopper<>& m, const KinematicPhases& family, const IdentifyOptions& o,
                           const Plan& plan) {
  return identify_rig(m, family, o, plan, nullptr);
}
Identified identify_hopper(const Hopper<>& m, const Record& record, const IdentifyOptions& o) {
  return identify_beside(m, record, o);
}

void add_identify(CLI::App& app) {
  auto* command =
      app.add_subcommand("identify", "Drive a machine or read its record; identify its harmonic transfer functions");
  command->footer(
      "sigma in the CSV file is sqrt(E|error|^2) of the complex value; its real and imaginary parts each have sigma / "
      "sqrt(2).\n"
      "Examples: saltus identify hopper --protocol paper --pictures out\n"
      "          saltus identify hopper --noise 0.001,0.006 --save run.csv\n"
      "          saltus identify hopper --record run.csv --csv htf.csv\n"
      "          saltus identify hopper --link udpm:// --log run.lcm\n"
      "          saltus identify compass_gait_robot --record walk.csv --set bench.json\n"
      "No clock paces the last: sections lie between its own events, or where its kinematic phase passes a value "
      "(--sections kinematic or both; --kinematic is of the first output and its rate). The model runs under the "
      "recorded input from section to section; --set takes its effects, too, or what saltus diagnose --json found.");
  auto o = std::make_shared<IdentifyOptions>();
  o->model.add_to(*command);
  command->add_option("--record", o->record, "read a measured record instead of driving a machine")->type_name("FILE");
  command
      ->add_option("--link", o->link.url,
                   "the machine: inproc, an emulated one in this process; udpm://[GROUP:PORT][?ttl=N], one over LCM; "
                   "file://LOG, the log of one")
      ->capture_default_str();
  o->link.add_to(*command);
  command->add_option("--patience", o->link.patience, "seconds to wait for the machine")
      ->check(CLI::Range(0.1, 86400.0))
      ->capture_default_str();
  command
      ->add_option("--protocol", o->protocol,
                   "optimal: the fewest experiments, each played with both signs; paper: 80 random subsets, 20 of 84 "
                   "cycles dropped, "
                   "both phases")
      ->check(CLI::IsMember({"optimal", "paper"}))
      ->capture_default_str();
  o->sections.add_to(*command, true);
  add_plan_options(*command, o->plan);
  add_share_option(*command, o->plan);
  command->add_option("--subsets", o->plan.subsets, "deal the lines at random into so many experiments")
      ->check(CLI::Range(1, 4096));
  add_design_options(*command, o->plan, o->design);
  command
      ->add_option(
          "--ladder", o->ladder,
          "amplitudes of a tone, in the unit of the input: one campaign at each, every H_m extrapolated to zero")
      ->delimiter(',');
  command->add_flag("--distortion", o->distortion,
                    "play one odd stimulus, and tell distortion of even and odd order and noise on its silent lines");
  command
      ->add_option("--stimulus", o->stimulus,
                   "chirp, prbs: one long experiment with a sweep or a random binary sequence of --amplitude")
      ->check(CLI::IsMember({"multisine", "chirp", "prbs"}))
      ->capture_default_str();
  command->add_option("--cycles", o->cycles, "length of the experiment of --stimulus chirp or prbs")
      ->check(CLI::Range(20, 100000))
      ->capture_default_str();
  command->add_flag(
      "--any", o->any,
      "with --record: identify from any stimulus by least squares, repeats or not; --period and --band choose the "
      "lines");
  command->add_option("--count", o->multipliers, "with --any: non-zero multipliers to seek")
      ->check(CLI::Range(1, 4))
      ->capture_default_str();
  command
      ->add_option("--transient", o->transient,
                   "drop the settling cycles, or model the decay too; auto: what is expected to be more accurate")
      ->check(CLI::IsMember({"auto", "drop", "model"}))
      ->capture_default_str();
  command->add_option("--ramp", o->campaign.ramp, "cycles over which the stimulus grows, while the machine settles")
      ->check(CLI::Range(0, 100000))
      ->capture_default_str();
  command
      ->add_option("--jitter", o->campaign.jitter,
                   "seconds by which the emulated machine's instants of measurement scatter, standard deviation")
      ->capture_default_str();
  command->add_option("--settle", o->campaign.settle, "cycles played before listening")
      ->check(CLI::Range(0, 100000))
      ->capture_default_str();
  command
      ->add_option("--periods", o->campaign.periods,
                   "stimulus periods listened to; with noise at least 2 (default then: 4)")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  o->campaign.jobs = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  command
      ->add_option("--jobs", o->campaign.jobs,
                   "experiments with the emulated machine played at a time; what is found does not depend on it")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  command->add_option("--harmonics", o->campaign.harmonics, "H_-K ... H_K")
      ->type_name("K")
      ->check(CLI::Range(0, max_harmonics))
      ->capture_default_str();
  command
      ->add_option("--noise", o->campaign.noise,
                   "standard deviation of each output of the emulated machine, in its unit")
      ->delimiter(',');
  command
      ->add_option(
          "--watch", o->campaign.watch,
          "hold the residual against the model, cycle by cycle, against this noise of each output, in its unit, "
          "and cry out where and when it leaves it (default: the noise of --noise)")
      ->delimiter(',');
  command
      ->add_option("--false-alarm", o->campaign.false_alarm,
                   "how likely the watch is to cry out in a cycle for nothing")
      ->check(CLI::Range(1e-12, 0.4))
      ->capture_default_str();
  o->confidence.add_to(*command);
  command->add_option("--save", o->save, "write the experiment as a record")->type_name("FILE");
  command
      ->add_option(
          "--csv", o->csv,
          "write m,f,output,re,im,sigma,cycles, with several inputs also input, to FILE, - for standard output")
      ->type_name("FILE");
  command->add_flag("--correct-jitter", o->correct_jitter,
                    "undo what instants that scatter do to smooth outputs, where they are found: see --jitter");
  command->add_flag("--coherence", o->coherence, "add a column coherence to the CSV file");
  command->add_option("--json", o->json, "write JSON to FILE, - for standard output")->type_name("FILE");
  command->add_option("--pictures", o->pictures, "draw htf.svg and fit.svg into FOLDER")->type_name("FOLDER");
  command->callback([o, command] { run(*o, *command); });
}

}  // namespace saltus::program
