// saltus control MODEL --realised FILE: a controller from an identified state-space model, on the emulated machine.
#include "../control_loop.hpp"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>

#include "program.hpp"
#include "sections.hpp"

namespace saltus::program {
namespace {

struct Options {
  ModelChoice model;
  SectionChoice sections;
  ControlOptions control;
  double noise_share = 0.1;  // of the deviation, where --noise is not given
  std::string realised, csv, json;
};

// What the linear model promises and what the machine did, under control or without.
struct Way {
  std::vector<Complex> multipliers, of_machine;  // of the model; with the machine's own linearisation in its place
  ControlRun run;
  std::vector<double> measured, predicted;  // [-] deviation of each cycle, in units of --deviation
  double decay = 0.0, decay_predicted = 0.0;
};

std::string list(const std::vector<Complex>& z) {
  std::string s;
  int shown = 0;
  for (const Complex& x : z) {
    if (x.imag() < 0.0 || shown++ == 4) continue;
    s += (s.empty() ? "" : ", ") + number(x.real(), "%.4f");
    if (x.imag() > 0.0) s += " +- " + number(x.imag(), "%.4f") + " i";
  }
  return s.empty() ? "none" : s;
}

PeriodicModel read_model(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw RunError(file + ": cannot be read; name a file that identify or htf wrote with --realise");
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  try {
    return periodic_model_of(text);
  } catch (const std::invalid_argument& e) {
    throw RunError(file + ": " + e.what() + "; write it with --realise FILE.json of identify or htf");
  }
}

template <class M>
void complete(ControlOptions& c, const Orbit<M, campaign_sections>& orbit, double noise_share) {
  constexpr auto ny = static_cast<std::size_t>(output_count<M>);
  if (c.deviation.empty()) {
    for (int i = 0; i < output_count<M>; ++i) {
      double mean = 0.0, square = 0.0;
      for (const auto& y : orbit.output) mean += y[i] / campaign_sections;
      for (const auto& y : orbit.output) square += (y[i] - mean) * (y[i] - mean) / campaign_sections;
      if (!(square > 0.0)) {
        throw UsageError("--deviation: an output stands still on the cycle; say how far each may deviate");
      }
      c.deviation.push_back(0.05 * std::sqrt(square));
    }
  }
  if (c.noise.empty()) {
    for (const double d : c.deviation) c.noise.push_back(noise_share * d);
  }
  if (c.deviation.size() != ny || c.noise.size() != ny) {
    throw UsageError("--deviation, --noise: " + std::string(M::name) + " has " + std::to_string(ny) +
                     " outputs; give one number for each");
  }
}

nlohmann::json matrices(const std::vector<Eigen::MatrixXd>& all) {
  nlohmann::json j = nlohmann::json::array();
  for (const Eigen::MatrixXd& m : all) {
    nlohmann::json rows = nlohmann::json::array();
    for (Eigen::Index i = 0; i < m.rows(); ++i) {
      rows.push_back(nlohmann::json::array());
      for (Eigen::Index k = 0; k < m.cols(); ++k) rows.back().push_back(m(i, k));
    }
    j.push_back(rows);
  }
  return j;
}

nlohmann::json json_of(const Way& w) {
  const auto complex = [](const std::vector<Complex>& all) {
    nlohmann::json j = nlohmann::json::array();
    for (const Complex& z : all) j.push_back({{"re", z.real()}, {"im", z.imag()}});
    return j;
  };
  const auto finite = [](double x) { return std::isfinite(x) ? nlohmann::json(x) : nlohmann::json(nullptr); };
  return {{"multipliers", complex(w.multipliers)},
          {"multipliers_of_machine", complex(w.of_machine)},
          {"decay", finite(w.decay)},
          {"decay_predicted", finite(w.decay_predicted)},
          {"deviation", w.measured},
          {"deviation_predicted", w.predicted},
          {"status", name(w.run.status)}};
}

template <class M>
std::string csv_of(const Way& none, const Way& held) {
  std::string csv = "control,cycle,section,u";
  for (const Quantity& q : M::outputs) csv += "," + std::string(q.name);
  csv += "\n";
  for (const Way* w : {&none, &held}) {
    for (std::size_t n = 0; n < w->run.input.size(); ++n) {
      csv += std::string(w == &held ? "1," : "0,") + std::to_string(n / campaign_sections) + "," +
             std::to_string(n % campaign_sections) + "," + number(w->run.input[n], "%.9g");
      for (const double y : w->run.deviation[n]) csv += "," + number(y, "%.9g");
      csv += "\n";
    }
  }
  return csv;
}

void print(const Way& none, const Way& held, const ControlOptions& o) {
  std::printf("  multipliers          of the state-space model            of the machine, linearised\n");
  std::printf("    without control    %-36s%s\n", list(none.multipliers).c_str(), list(none.of_machine).c_str());
  std::printf("    with control       %-36s%s\n", list(held.multipliers).c_str(), list(held.of_machine).c_str());
  std::printf("  deviation of a cycle, root of the mean square over --deviation\n");
  std::printf("    %-8s%28s%28s\n    %-8s%14s%14s%14s%14s\n", "", "without control", "with control", "cycle", "machine",
              "predicted", "machine", "predicted");
  const auto cell = [](const std::vector<double>& v, std::size_t k) {
    return k < v.size() ? number(v[k], "%.3e") : std::string("-");
  };
  for (std::size_t k = 0; k < static_cast<std::size_t>(o.cycles); ++k) {
    std::printf("    %-8zu%14s%14s%14s%14s\n", k, cell(none.measured, k).c_str(), cell(none.predicted, k).c_str(),
                cell(held.measured, k).c_str(), cell(held.predicted, k).c_str());
  }
  const auto decay = [](double x) { return std::isfinite(x) ? number(x, "%.4f") : std::string("too few cycles"); };
  std::printf("    %-8s%14s%14s%14s%14s\n", "a cycle", decay(none.decay).c_str(), decay(none.decay_predicted).c_str(),
              decay(held.decay).c_str(), decay(held.decay_predicted).c_str());
}

template <class M, class Family>
void run(const M& m, const Family& family, const Options& given) {
  const bool quiet = check_outputs({{"--csv", given.csv}, {"--json", given.json}});
  const PeriodicModel model = read_model(given.realised);
  const auto system = std::make_unique<LdtpOf<M, campaign_sections>>();
  const auto orbit = find_orbit<campaign_sections>(m, timebase_of(m, given.model.ticks), family, *system);
  if (orbit.status != Status::ok) throw RunError(no_orbit(M::name, orbit.status, Family::on_grid));
  ControlOptions o = given.control;
  complete<M>(o, orbit, given.noise_share);
  if (model.sections != campaign_sections || model.outputs != output_count<M>) {
    throw RunError(given.realised + ": it has " + std::to_string(model.sections) + " sections and " +
                   std::to_string(model.outputs) + " outputs, " + std::string(M::name) + " has " +
                   std::to_string(campaign_sections) + " and " + std::to_string(output_count<M>) +
                   "; identify this machine");
  }
  int most = 0;
  for (int n = 0; n < model.sections; ++n) most = std::max(most, model.dim(n));
  if (most > controller_states) {
    throw RunError(given.realised + ": a section has " + std::to_string(most) + " states, the loop has room for " +
                   std::to_string(controller_states) + "; identify with more --harmonics, or less noise");
  }
  const auto controller = std::make_unique<Controller<output_count<M>>>();
  if (design(*controller, model, o) != Status::ok) {
    throw RunError(given.realised + ": no controller: its Riccati equations do not settle, for what the model cannot " +
                   "reach or see does not decay; change --input, --noise, or identify anew");
  }
  const ControlGains gains = gains_of(*controller, model);
  const PeriodicModel machine = model_of(*system);
  Way none, held;
  for (Way* w : {&none, &held}) {
    const bool closed = w == &held;
    w->multipliers =
        closed ? loop_multipliers(model, model, gains) : nonzero_multipliers(model.monodromy(model.smallest_section()));
    w->of_machine = closed ? loop_multipliers(machine, model, gains) : nonzero_multipliers(system->monodromy(0));
    w->run = run_under(closed ? controller.get() : nullptr, m, family, given.model.ticks, orbit, o);
    w->predicted = deviation_of_cycles(loop_response(model, model, closed ? gains : ControlGains{}, o.kick, o.cycles),
                                       campaign_sections, o.deviation);
    w->measured = deviation_of_cycles(w->run.deviation, campaign_sections, o.deviation);
    w->decay = decay_of(w->measured, w->predicted);
    w->decay_predicted = decay_of(w->predicted, w->predicted);
  }
  if (!quiet) {
    std::printf("%s, %s: controller of %d to %d states from %s, kicked with %g %s over one section\n",
                std::string(M::name).c_str(), title_of(family), model.dim(model.smallest_section()), most,
                given.realised.c_str(), o.kick, std::string(M::inputs[0].unit).c_str());
    std::printf("  as bad as one another:");
    for (int c = 0; c < output_count<M>; ++c) {
      const Quantity& q = M::outputs[static_cast<std::size_t>(c)];
      std::printf(" %s off by %.3g %s,", std::string(q.name).c_str(), o.deviation[static_cast<std::size_t>(c)],
                  std::string(q.unit).c_str());
    }
    std::printf(" an input of %.3g %s\n", o.input, std::string(M::inputs[0].unit).c_str());
    print(none, held, o);
  }
  if (!given.csv.empty()) write_text(given.csv, csv_of<M>(none, held));
  if (!given.json.empty()) {
    write_json(given.json, {{"model", M::name},
                            {"sections", name_of(family)},
                            {"sections_per_cycle", campaign_sections},
                            {"realised", given.realised},
                            {"kick", o.kick},
                            {"deviation_scale", o.deviation},
                            {"noise", o.noise},
                            {"without_control", json_of(none)},
                            {"with_control", json_of(held)},
                            {"regulator", matrices(gains.regulator)},
                            {"filter", matrices(gains.filter)}});
  }
  for (const Way* w : {&none, &held}) {
    if (usable(w->run.status)) continue;
    throw RunError(std::string(M::name) + (w == &held ? " under control" : " without control") + " left its cycle (" +
                   std::string(name(w->run.status)) + ") after " +
                   std::to_string(w->run.input.size() / campaign_sections) +
                   " cycles; lower --kick, or raise --input " + "and --deviation together");
  }
}

}  // namespace

void add_control(CLI::App& app) {
  auto* command = app.add_subcommand("control", "A controller from an identified model, on the emulated machine");
  command->footer(
      "A periodic linear-quadratic regulator with a Kalman filter, one gain of each a section, from A[n], B[n], C[n]. "
      "The\n"
      "machine is kicked off its cycle; what is left of that, cycle by cycle, stands beside what the model promised. "
      "The\n"
      "gains are in the JSON file: u = -regulator[n] (z + filter[n] (y - C[n] z)), y off the cycle, z predicted by\n"
      "z[n+1] = A[n] (z + filter[n] (y - C[n] z)) + B[n] u. core/spectrum/periodic_control.hpp is that loop.\n"
      "The kick has all frequencies: identify up to --band 15.9, near half the sections a cycle.\n"
      "Example: saltus identify hopper --harmonics 8 --band 15.9 --realise model.json\n"
      "         saltus control hopper --realised model.json --json loop.json");
  auto o = std::make_shared<Options>();
  o->model.add_to(*command);
  command
      ->add_option("--realised", o->realised,
                   "the state-space model that identify or htf wrote with --realise FILE.json")
      ->type_name("FILE")
      ->required();
  o->sections.add_to(*command, false);
  ControlOptions& c = o->control;
  command
      ->add_option("--deviation", c.deviation,
                   "of each output, in its unit, as bad as --input: weights are inverse squares (default: 5 % of the "
                   "cycle's own, root of the mean square)")
      ->delimiter(',')
      ->check(CLI::PositiveNumber);
  command->add_option("--input", c.input, "input, in its unit, as bad as --deviation")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command
      ->add_option("--noise", c.noise,
                   "standard deviation of each output's noise, in its unit, that the filter expects (default: a tenth "
                   "of --deviation)")
      ->delimiter(',')
      ->check(CLI::PositiveNumber);
  command
      ->add_option("--disturbance", c.disturbance,
                   "standard deviation of a random force where the input acts, in its unit, that the filter expects")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--kick", c.kick, "force over one section, in the unit of the input, that starts the deviation")
      ->capture_default_str();
  command->add_option("--cycles", c.cycles, "cycles after the kick, its own included")
      ->check(CLI::Range(3, 10000))
      ->capture_default_str();
  command->add_flag("--noisy", c.noisy, "the machine's outputs have the noise that the filter expects");
  command->add_option("--seed", c.seed, "of that noise")->capture_default_str();
  command
      ->add_option("--csv", o->csv,
                   "write control,cycle,section,u and the outputs off the cycle to FILE, - for "
                   "standard output")
      ->type_name("FILE");
  command->add_option("--json", o->json, "write JSON with the gains to FILE, - for standard output")->type_name("FILE");
  command->callback([o] {
    with_model(o->model, [&](auto m) {
      using M = decltype(m);
      if constexpr (input_count<M> == 1) {
        o->sections.visit<M>([&](const auto& family) { run(m, family, *o); });
      } else {
        throw RunError(std::string(M::name) + " has no input to control it by; choose a model that has one");
      }
    });
  });
}

}  // namespace saltus::program
