// Counts every allocation of the whole process, whichever thread or library makes it: a kernel or a loop that allocates
// fails its test. Linked into every test program.
//
//   const saltus::test::AllocationCount allocated;
//   loop.step();
//   CHECK(allocated() == 0);
#pragma once

#include <cstdint>

namespace saltus::test {

// False under a sanitizer and where the C library cannot be counted; every count is then zero.
bool counting() noexcept;

// Calls of malloc, calloc, realloc, aligned_alloc, posix_memalign, memalign, valloc and pvalloc (operator new makes one
// of them) by all threads since the process began [-].
std::int64_t allocations() noexcept;

// Allocations since construction.
class AllocationCount {
 public:
  AllocationCount() noexcept : start_(allocations()) {}
  std::int64_t operator()() const noexcept { return allocations() - start_; }  // [-]

 private:
  std::int64_t start_;
};

}  // namespace saltus::test
