#include "sim/control_loop.hpp"

#include <cmath>
#include <memory>
#include <stdexcept>

#include "sim/models/hopper_orbit.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

ControlOptions hopper_control() {
  ControlOptions o;
  o.deviation = {0.01, 0.1};
  o.noise = {1e-3, 6e-3};
  o.kick = 0.1;
  return o;
}

// The hopper under a controller from its own exact model, as HTFs realised it.
template <class Family>
void keeps_its_promise(const Family& family) {
  const Hopper<> m;
  const auto system = std::make_unique<LdtpOf<Hopper<>, campaign_sections>>();
  const auto orbit = find_orbit<campaign_sections>(m, timebase_of(m, 512), family, *system);
  REQUIRE(orbit.status == Status::ok);
  const PeriodicModel model = periodic_model_of(realisation_json(realise(exact_table(*system, 16, 15.9))));
  const ControlOptions o = hopper_control();
  const auto controller = std::make_unique<Controller<2>>();
  REQUIRE(design(*controller, model, o) == Status::ok);
  const ControlGains gains = gains_of(*controller, model);

  // The machine's own linearisation under that controller: the multipliers that the model promises, to the 1e-5 that it
  // is good to; and the half of them that are the regulator's.
  const auto promised = loop_multipliers(model, model, gains);
  const auto kept = loop_multipliers(model_of(*system), model, gains);
  REQUIRE(!promised.empty());
  CHECK(std::abs(std::abs(kept[0]) - std::abs(promised[0])) < 1e-3);
  CHECK(std::abs(promised[0]) < 0.5);  // 0.742 without

  for (const bool closed : {false, true}) {
    const ControlGains none;
    const ControlRun run = run_under(closed ? controller.get() : nullptr, m, family, 512, orbit, o);
    REQUIRE(usable(run.status));
    const auto measured = deviation_of_cycles(run.deviation, campaign_sections, o.deviation);
    const auto predicted = deviation_of_cycles(loop_response(model, model, closed ? gains : none, o.kick, o.cycles),
                                               campaign_sections, o.deviation);
    REQUIRE(measured.size() == static_cast<std::size_t>(o.cycles));
    // A kick of 0.1 N leaves 1.6 mm/s: what the curvature of the machine adds is less than a hundredth of it. Lines up
    // to half the sections a cycle, for the kick has them all.
    for (std::size_t k = 0; k < 3; ++k) {
      CHECK(std::abs(measured[k] - predicted[k]) < 0.01 * predicted[k] + 1e-4 * predicted[0]);
    }
    const double decay = decay_of(measured, predicted), expected = decay_of(predicted, predicted);
    CHECK(std::abs(decay / expected - 1.0) < 0.015);
    if (!closed) CHECK(std::abs(expected - 0.742) < 0.05);  // |multiplier|, but for its turns within eleven cycles
  }
}

}  // namespace

TEST_CASE("a machine under control decays as the state-space model promises, isochrons", "[control]") {
  keeps_its_promise(ClockPhases{32});
}

TEST_CASE("a machine under control decays as the state-space model promises, kinematic", "[control]") {
  keeps_its_promise(KinematicPhases{32});
}

TEST_CASE("the loop of a scalar machine, in closed form", "[control]") {
  // Three sections of x+ = 0.9 x + u, y = x; gain k, filter l: the error of the estimate falls by 0.9 (1 - l), the
  // state by 0.9 - k.
  constexpr double k = 0.4, l = 0.5;
  PeriodicModel m;
  m.sections = 3;
  m.outputs = 1;
  ControlGains gains;
  for (int n = 0; n < 3; ++n) {
    m.A.push_back(Eigen::MatrixXd::Constant(1, 1, 0.9));
    m.B.push_back(Eigen::MatrixXd::Constant(1, 1, 1.0));
    m.C.push_back(Eigen::MatrixXd::Constant(1, 1, 1.0));
    gains.regulator.push_back(Eigen::MatrixXd::Constant(1, 1, k));
    gains.filter.push_back(Eigen::MatrixXd::Constant(1, 1, l));
  }
  const auto z = loop_multipliers(m, m, gains);
  REQUIRE(z.size() == 2);
  CHECK(std::abs(z[0] - std::pow(0.9 - k, 3)) < 1e-12);
  CHECK(std::abs(z[1] - std::pow(0.9 * (1.0 - l), 3)) < 1e-12);

  const auto y = loop_response(m, m, {}, 2.0, 4);
  REQUIRE(y.size() == 12);
  for (std::size_t n = 0; n < 12; ++n) {
    CHECK(std::abs(y[n][0] - (n == 0 ? 0.0 : 2.0 * std::pow(0.9, double(n - 1)))) < 1e-12);
  }
  const auto d = deviation_of_cycles(y, 3, {0.5});
  REQUIRE(d.size() == 4);
  CHECK(std::abs(d[0] - 4.0 * std::sqrt((1.0 + 0.81) / 3.0)) < 1e-12);
  CHECK(std::abs(decay_of(d, d) - std::pow(0.9, 3)) < 1e-12);
  CHECK(std::abs(decay_of(d, {1.0, 1.0, 0.5, 1e-6}) - d[2] / d[1]) < 1e-12);  // the third is below the floor
  CHECK(std::isnan(decay_of({1.0, 0.5}, {1.0, 0.5})));
}

TEST_CASE("a file that is no state-space model is refused, and says where", "[control]") {
  const auto why = [](const std::string& json) {
    try {
      (void)periodic_model_of(json);
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string{};
  };
  const std::string good = R"({"sections_per_cycle":1,"outputs":1,"dim":[1],"A":[[[0.5]]],"B":[[[1]]],"C":[[[1]]]})";
  CHECK(why(good).empty());
  const auto changed = [&](const std::string& from, const std::string& to) {
    std::string s = good;
    return s.replace(s.find(from), from.size(), to);
  };
  CHECK(why("nonsense").find("no state-space model") != std::string::npos);
  CHECK(why("[1]").find("no state-space model") != std::string::npos);
  CHECK(why(changed("\"B\"", "\"b\"")).find("'B'") != std::string::npos);
  CHECK(why(changed("\"dim\":[1]", "\"dim\":[1,1]")).find("'dim'") != std::string::npos);
  CHECK(why(changed("\"dim\":[1]", "\"dim\":[-1]")).find("'dim'") != std::string::npos);
  CHECK(why(changed("[[[0.5]]]", "[[[0.5,1]]]")).find("A of section 0 is not 1 x 1") != std::string::npos);
  CHECK(!why(changed("[[[0.5]]]", "[[[\"x\"]]]")).empty());
  CHECK(!why(changed("[[[0.5]]]", "[]")).empty());
}
