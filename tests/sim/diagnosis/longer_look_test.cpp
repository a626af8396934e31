// Laws that differ little within a short stretch, and much along a swing.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/random.hpp"
#include "tests/support/records.hpp"

using namespace saltus;
using namespace saltus::diagnosis;
using namespace saltus::test;

namespace {

// Five seconds of a pendulum that a chirp of torque drives, 0.5 mrad and 10 mrad/s of noise.
Record swings(const Values& truth, std::uint64_t seed) {
  constexpr double spacing = 0.004, slowest = 0.3, fastest = 2.5, length = 5.0;  // [s], [Hz], [Hz], [s]
  std::vector<double> t, u;
  for (int i = 0; i < static_cast<int>(length / spacing); ++i) {
    const double now = spacing * i;
    t.push_back(now);
    u.push_back(1.4 * std::sin(2.0 * std::numbers::pi * (slowest + 0.5 * (fastest - slowest) * now / length) * now));
  }
  const auto y = outputs_of("pendulum", truth, t, u, 0.5 * spacing, Start{0, {0.1, -1.7}});
  Record r;
  r.name = "swings";
  r.model = "pendulum";
  r.inputs = {{"tau", "N m", {}}};
  r.outputs = {{"angle", "rad", {}}, {"rate", "rad/s", {}}};
  Random random(seed);
  for (std::size_t i = 0; i < t.size(); ++i) {
    r.experiment.push_back(0);
    r.t.push_back(t[i]);
    r.inputs[0].values.push_back(u[i]);
    r.outputs[0].values.push_back(y[2 * i] + 5e-4 * random.normal());
    r.outputs[1].values.push_back(y[2 * i + 1] + 1e-2 * random.normal());
  }
  return r;
}
// Both of these and nothing else, each within the wider half of an interval of 99.9 %.
void both(const Diagnosis& d, const std::string& one, double size, const std::string& other, double other_size) {
  CHECK(d.verdict == Verdict::effect_found);
  REQUIRE(d.effects.size() == 2);
  for (const auto& [name, truth] : {std::pair(one, size), std::pair(other, other_size)}) {
    CAPTURE(name);
    const auto f =
        std::find_if(d.effects.begin(), d.effects.end(), [&, n = name](const Finding& x) { return x.name == n; });
    REQUIRE(f != d.effects.end());
    CHECK(std::abs(f->value - truth) < 3.3 / 1.96 * (f->high - f->value));
    CHECK(std::abs(f->value - truth) < 0.1 * truth);
  }
  CHECK(d.heldout.after < 1.05);
}

}  // namespace

TEST_CASE("dry friction and a quadratic drag are not called a viscous one, which does much the same", "[self-paced]") {
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    CAPTURE(seed);
    const Diagnosis d = judged(swings({{"coulomb_friction@joint", 0.01}, {"quadratic_drag@joint", 0.001}}, seed));
    both(d, "coulomb_friction@joint", 0.01, "quadratic_drag@joint", 0.001);
  }
}

TEST_CASE("a viscous drag and a quadratic one are told apart along longer stretches", "[self-paced]") {
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    CAPTURE(seed);
    const Diagnosis d = judged(swings({{"viscous_drag@joint", 0.004}, {"quadratic_drag@joint", 0.001}}, seed));
    both(d, "viscous_drag@joint", 0.004, "quadratic_drag@joint", 0.001);
  }
}

TEST_CASE("along longer stretches nothing is invented either", "[self-paced]") {
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    CAPTURE(seed);
    const Diagnosis d = judged(swings({}, seed));
    CHECK(d.effects.empty());
    CHECK(d.verdict != Verdict::unexplained);
  }
}
