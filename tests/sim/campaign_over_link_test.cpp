// A campaign on the hopper with its machine at the other end of LCM's own queue: the HTFs of the one without a wire.
#include <atomic>
#include <thread>

#include "hal/lcm/bus.hpp"
#include "hal/lockstep.hpp"
#include "sim/campaign.hpp"
#include "sim/models/hopper_orbit.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

TEST_CASE("over memq, a campaign gives every harmonic to the bit") {
  PlanOptions plan_options;
  plan_options.period = 8;
  plan_options.band = 1.5;
  const Plan plan = make_plan(plan_options);
  CampaignOptions o;
  o.settle = 20;
  o.periods = 2;
  o.noise = {1e-3, 6e-3};
  o.seed = 5;
  const Hopper<> m;
  const ClockPhases family{};
  const auto here = run_campaign(m, family, plan, o, nullptr, {});
  REQUIRE(here->id.worst == Status::ok);

  Bus bus("memq://");
  BusEnd<Stimulus<1>, Measurement<2>> experimenter(bus, stimulus_channel, measurement_channel);
  BusEnd<Measurement<2>, Stimulus<1>> machine(bus, measurement_channel, stimulus_channel);
  bus.start();
  Run<Hopper<>> start;
  start.at = here->orbit.point[0];
  Rig<Hopper<>, ClockPhases> rig(m, timebase_of(m, o.ticks), family, start, {o.noise[0], o.noise[1]}, o.seed);
  std::int64_t asked = 0;
  const auto there = run_campaign(
      m, family, plan, o, nullptr, {},
      [&](std::int32_t e, auto&, std::span<const double> stimulus, std::span<const Complex>, std::int64_t samples,
          std::int64_t settle, auto& estimator, const auto& on_sample) {
        std::atomic<bool> done{false};
        std::thread far([&] {
          MachineSession<1, 2> session(draw_id(), {}, machine.faults());
          while (!done.load()) {
            if (serve(machine, session, rig, steady_ns()) == 0) machine.await(1'000'000);
          }
        });
        Lockstep<decltype(experimenter), 1, 2> link(experimenter, experimenter.faults(), {});
        Outcome outcome = Outcome::answered;
        const Status s = play_experiment<2>(link, e, stimulus, samples, settle, estimator, on_sample, outcome);
        CHECK(outcome == Outcome::answered);
        CHECK(link.stop() == Outcome::answered);
        done = true;
        far.join();
        asked += samples;
        return s;
      });
  REQUIRE(there->id.worst == Status::ok);
  CHECK(asked == static_cast<std::int64_t>(plan.experiments.size()) * 36 * 32);
  REQUIRE(there->id.htf.size() == here->id.htf.size());
  REQUIRE(here->id.htf.size() > 100);
  for (std::size_t i = 0; i < here->id.htf.size(); ++i) {
    CHECK(there->id.htf[i].value == here->id.htf[i].value);
    CHECK(there->id.htf[i].line == here->id.htf[i].line);
  }
}
