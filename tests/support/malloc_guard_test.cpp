#include "malloc_guard.hpp"

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>
#include <thread>
#include <vector>

#include "catch.hpp"

namespace {

using saltus::test::AllocationCount;
using saltus::test::counting;

// Lets the pointer escape, so that the optimiser cannot remove the allocation behind it.
void keep(const void* p) { asm volatile("" : : "r"(p) : "memory"); }

struct alignas(64) Line {
  std::array<double, 8> values;
};

}  // namespace

TEST_CASE("malloc guard: every way to allocate is counted once") {
  if (!counting()) {
    WARN("allocations are not counted in this build");
    return;
  }
  const auto cost = [](auto allocate) {
    const AllocationCount allocated;
    allocate();
    return allocated();
  };

  CHECK(cost([] {}) == 0);
  CHECK(cost([] {
          const auto p = std::make_unique<int>(1);
          keep(p.get());
        }) == 1);
  CHECK(cost([] {
          const auto p = std::make_unique<Line>();  // over-aligned
          keep(p.get());
        }) == 1);
  CHECK(cost([] {
          const std::vector<double> v(1000);
          keep(v.data());
        }) == 1);
  CHECK(cost([] {
          void* p = std::malloc(10);
          keep(p);
          p = std::realloc(p, 10000);
          keep(p);
          std::free(p);
        }) == 2);
  CHECK(cost([] {
          void* const p = std::calloc(10, 10);
          keep(p);
          std::free(p);
        }) == 1);
  CHECK(cost([] {
          void* const p = std::aligned_alloc(64, 640);
          keep(p);
          std::free(p);
        }) == 1);
  CHECK(cost([] {
          void* p = nullptr;
          const int failed = posix_memalign(&p, 64, 640);
          keep(p);
          if (failed == 0) std::free(p);
        }) == 1);
}

TEST_CASE("malloc guard: memory on the stack is free") {
  const AllocationCount allocated;
  std::array<double, 1000> a{};
  keep(a.data());
  CHECK(allocated() == 0);
}

TEST_CASE("malloc guard: another thread's allocation is counted") {
  if (!counting()) {
    WARN("allocations are not counted in this build");
    return;
  }
  std::int64_t seen = 0;
  std::thread([&seen] {
    const AllocationCount allocated;
    for (int i = 0; i < 100; ++i) {
      const auto p = std::make_unique<int>(i);
      keep(p.get());
    }
    seen = allocated();
  }).join();
  CHECK(seen == 100);

  const AllocationCount outside;
  std::thread([] { keep(std::make_unique<int>(1).get()); }).join();
  CHECK(outside() >= 1);
}

TEST_CASE("malloc guard: posix_memalign refuses what the standard refuses") {
  if (!counting()) {
    WARN("a sanitizer stops the process here");
    return;
  }
  void* p = nullptr;
  CHECK(posix_memalign(&p, 3, 10) == EINVAL);
  CHECK(posix_memalign(&p, 1, 10) == EINVAL);
  CHECK(p == nullptr);
}
