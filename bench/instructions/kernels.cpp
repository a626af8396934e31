// kernels NAME COUNT: runs a kernel so many times. bench/instructions/run counts what one more costs.
#include <array>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "core/orbit/orbit.hpp"
#include "core/spectrum/estimator.hpp"
#include "core/spectrum/htf.hpp"
#include "sim/models/hopper.hpp"
#include "sim/models/kneed_biped.hpp"

namespace {

using namespace saltus;

template <class M>
double ticks(int count) {
  const M m;
  const Timebase base = timebase_of(m, 512);
  Run<M> run;
  run.at = start_of(m);
  for (int i = 0; i < count; ++i) step(m, run, Input<M>::Zero(), base);
  return run.at.x[0];
}

double linearised(int count) {
  static LdtpOf<Hopper<>, 32> system;
  static Orbit<Hopper<>, 32> orbit;
  const Hopper<> m;
  const Timebase base = timebase_of(m, 64);
  for (int i = 0; i < count; ++i) {
    Run<Hopper<>> run;
    run.at = start_of(m);
    trace_cycle(m, base, ClockPhases{32}, run, orbit, &system);
  }
  return system.A[0](0, 0);
}

double exact(int count) {
  static LdtpOf<Hopper<>, 32> system;
  for (std::size_t n = 0; n < 32; ++n) {
    system.A[n].setIdentity();
    system.A[n] *= 0.9;
    system.B[n].setOnes();
    system.C[n].setOnes();
    system.D[n].setZero();
  }
  double sum = 0.0;
  for (int i = 0; i < count; ++i) sum += htf(system, 0.01 * (i + 1))(1)(0, 0).real();
  return sum;
}

template <class T>
double samples(int count) {
  static HtfEstimator<31, 1, 2, 32, 64, T> estimator;
  std::array<int, 31> lines{};
  for (int k = 0; k < 31; ++k) lines[static_cast<std::size_t>(k)] = k + 1;
  if (estimator.configure(32, 64, lines, 1) != Status::ok) return -1.0;
  for (int n = 0; n < 2048 + count; ++n) estimator.push(n, {1.0 * (n % 7), 1.0 * (n % 5)});
  return estimator.line(0, 0, 0).real();
}

double sines(int count) {
  double sum = 0.0;
  for (int i = 0; i < count; ++i) sum += saltus::sin(0.01 * i);
  return sum;
}

template <class T>
double stimulus(int count) {
  static Multisine<31, T> u(2048);
  for (int k = 0; k < 31; ++k) {
    if (!u.add({k + 1, 0.01, 0.1 * k * k})) break;  // was in
  }
  double sum = 0.0;
  for (int n = 0; n < count; ++n) sum += static_cast<double>(u(n));
  return sum;
}

struct Kernel {
  std::string_view name;
  double (*run)(int);
};
constexpr std::array kernels{Kernel{"sine", sines},
                             Kernel{"stimulus-sample", stimulus<double>},
                             Kernel{"stimulus-sample-float", stimulus<float>},
                             Kernel{"hopper-tick", ticks<Hopper<>>},
                             Kernel{"kneed-biped-tick", ticks<KneedBiped<>>},
                             Kernel{"hopper-linearised-cycle", linearised},
                             Kernel{"hopper-exact-htf", exact},
                             Kernel{"estimator-sample", samples<double>},
                             Kernel{"estimator-sample-float", samples<float>}};

}  // namespace

int main(int argc, char** argv) {
  for (const Kernel& k : kernels) {
    if (argc == 1) std::printf("%s\n", k.name.data());
    if (argc == 3 && k.name == argv[1]) std::printf("%g\n", k.run(std::atoi(argv[2])));
  }
}
