// The same work on many segments, on all cores. Each call writes what is its own, and sums are made afterwards in
// order, so that the number of cores changes nothing.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <thread>
#include <vector>

namespace saltus::diagnosis {

// Calls work(0) ... work(count - 1), each once, in any order. `work` must not throw.
template <class Work>
void side_by_side(std::size_t count, const Work& work) {
  const std::size_t cores = std::min<std::size_t>(count, std::max(1u, std::thread::hardware_concurrency()));
  std::atomic<std::size_t> next{0};
  const auto some = [&] {
    for (std::size_t i = next++; i < count; i = next++) work(i);
  };
  std::vector<std::thread> others;
  for (std::size_t i = 1; i < cores; ++i) others.emplace_back(some);
  some();
  for (std::thread& t : others) t.join();
}

}  // namespace saltus::diagnosis
