// Every turn of a loop timed by itself: quantiles [ns] as counters. The clock's own time is in all of them.
#pragma once

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <vector>

namespace saltus {

// Runs `work(n)`, n = 0, 1, ...
template <class Work>
void time_each(benchmark::State& state, const Work& work) {
  std::vector<std::int64_t> took;
  took.reserve(4'000'000);
  std::int64_t n = 0;
  for (auto _ : state) {
    const auto begin = std::chrono::steady_clock::now();
    work(n++);
    const auto end = std::chrono::steady_clock::now();
    if (took.size() < took.capacity()) took.push_back(std::chrono::nanoseconds(end - begin).count());
  }
  if (took.empty()) return;
  std::sort(took.begin(), took.end());
  const auto quantile = [&](double q) {
    return static_cast<double>(took[static_cast<std::size_t>(q * static_cast<double>(took.size() - 1))]);
  };
  state.counters["median"] = quantile(0.5);
  state.counters["p99"] = quantile(0.99);
  state.counters["p99.99"] = quantile(0.9999);
  state.counters["max"] = quantile(1.0);
}

}  // namespace saltus
