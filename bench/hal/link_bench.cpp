// What a message costs: an order to a machine that does nothing, and its measurement, by the conversation that
// `saltus identify` and `saltus rig` have (lockstep). Every exchange is timed; between threads it is mostly the
// operating system that is timed.
#include <benchmark/benchmark.h>

#include <atomic>
#include <memory>
#include <thread>

#include "bench/quantiles.hpp"
#include "hal/lcm/bus.hpp"
#include "hal/lockstep.hpp"
#include "hal/loopback.hpp"

namespace {

using namespace saltus;
using Command = Stimulus<1>;
using Reply = Measurement<2>;

struct Idle {
  std::int64_t tick = 0;
  Reply measure() const noexcept {
    Reply r;
    r.tick = tick;
    return r;
  }
  Reply start(std::int32_t) noexcept {
    tick = 0;
    return measure();
  }
  Reply advance(const Command&) noexcept {
    ++tick;
    return measure();
  }
  Reply rest() noexcept { return measure(); }
};

// The machine's end on a thread of its own.
template <class End>
class Far {
 public:
  explicit Far(End& end)
      : thread_([this, &end] {
          FaultCounts faults;
          MachineSession<1, 2> session(draw_id(), {}, faults);
          Idle machine;
          while (!done_.load(std::memory_order_relaxed)) {
            if (serve(end, session, machine, steady_ns()) == 0) await(end, 20'000'000);
          }
        }) {}
  ~Far() {
    done_ = true;
    thread_.join();
  }

 private:
  std::atomic<bool> done_{false};
  std::thread thread_;
};

template <class End>
void converse(benchmark::State& state, End& end) {
  FaultCounts faults;
  Lockstep<End, 1, 2> machine(end, faults, {});
  Reply y;
  if (machine.start(0, y) != Outcome::answered) return state.SkipWithError("nobody answers");
  Outcome worst = Outcome::answered;
  time_each(state, [&](std::int64_t n) {
    if (const Outcome o = machine.exchange(n, {0.5}, y); o != Outcome::answered) worst = o;
  });
  (void)machine.stop();
  if (worst != Outcome::answered) state.SkipWithError("an order was not answered");
  if (machine.repeats() > 0) state.SetLabel(std::to_string(machine.repeats()) + " orders sent again");
}

using Wire = Loopback<Command, Reply, 64>;

void ring(benchmark::State& state) {
  const auto r = std::make_unique<Ring<Command, 64>>();
  Command c;
  for (auto _ : state) {
    ++c.seq;
    benchmark::DoNotOptimize(r->try_push(c));
    benchmark::DoNotOptimize(r->try_pop(c));
  }
}
BENCHMARK(ring)->Name("a ring, push and pop of a stimulus");

// No thread, no session: two rings there and back.
void in_one_thread(benchmark::State& state) {
  const auto wire = std::make_unique<Wire>();
  auto here = wire->experimenter();
  auto there = wire->machine();
  Idle machine;
  Command c;
  Reply y;
  time_each(state, [&](std::int64_t n) {
    c.seq = c.tick = n;
    (void)here.try_send(c);
    if (there.try_receive(c)) (void)there.try_send(machine.advance(c));
    benchmark::DoNotOptimize(here.try_receive(y));
  });
}
BENCHMARK(in_one_thread)->Name("a round trip | rings, in one thread")->UseRealTime();

void loopback(benchmark::State& state) {
  const auto wire = std::make_unique<Wire>();
  auto here = wire->experimenter();
  auto there = wire->machine();
  const Far far(there);
  converse(state, here);
}
BENCHMARK(loopback)->Name("a round trip | rings, between two threads")->UseRealTime();

using Experimenter = BusEnd<Command, Reply>;
using Machine = BusEnd<Reply, Command>;

void memq(benchmark::State& state) {
  Bus bus("memq://");
  Experimenter here(bus, stimulus_channel, measurement_channel);
  Machine there(bus, measurement_channel, stimulus_channel);
  bus.start();
  const Far far(there);
  converse(state, here);
}
BENCHMARK(memq)->Name("a round trip | LCM, memq")->UseRealTime();

void udpm(benchmark::State& state) {
  const std::string url = "udpm://239.255.76.67:7693?ttl=0";  // not the port where a machine may be
  static const std::string lacks = what_the_network_lacks(MulticastAddress::parse(url));
  if (!lacks.empty()) return state.SkipWithError(lacks.c_str());
  Bus bus(url), other(url);
  Experimenter here(bus, stimulus_channel, measurement_channel);
  Machine there(other, measurement_channel, stimulus_channel);
  bus.start();
  other.start();
  const Far far(there);
  converse(state, here);
}
BENCHMARK(udpm)->Name("a round trip | LCM, udpm on this machine")->UseRealTime();

}  // namespace
