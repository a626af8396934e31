// The same work on many segments, on all cores. Each call writes what is its own, and sums are made afterwards in
// order, so that the number of cores changes nothing.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <thread>
#include <vector>

namespace saltus::diagnosis {

// Calls work(0) ... work(count - 1), each once, in any order, `workers` at a time. Throws the first, by number, of what
// they threw.
template <class Work>
void side_by_side(std::size_t count, const Work& work,
                  std::size_t workers = std::max(1u, std::thread::hardware_concurrency())) {
  std::vector<std::exception_ptr> thrown(count);
  std::atomic<std::size_t> next{0};
  const auto some = [&] {
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        work(i);
      } catch (...) {
        thrown[i] = std::current_exception();
      }
    }
  };
  {
    std::vector<std::jthread> others;
    for (std::size_t i = 1; i < std::min(count, workers); ++i) others.emplace_back(some);
    some();
  }
  for (const std::exception_ptr& e : thrown) {
    if (e) std::rethrow_exception(e);
  }
}

}  // namespace saltus::diagnosis
