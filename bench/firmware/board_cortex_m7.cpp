// All that stands between reset and main() on a Cortex-M7, and puts() by semihosting: no operating system, no heap, no
// stdio. The exit status of the emulator is main()'s, 99 after a fault, 98 after a failed assertion.
#include "board.hpp"

#include <cstddef>

int program() asm("main");

extern "C" {
extern std::uint32_t data_in_flash[], data_start[], data_end[], bss_start[], bss_end[], stack_bottom[], stack_top[];
extern void (*init_start[])();
extern void (*init_end[])();

[[gnu::noinline]] static int host_call(int operation, const void* argument) noexcept {
  register int r0 asm("r0") = operation;
  register const void* r1 asm("r1") = argument;
  asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

int puts(const char* line) {
  constexpr int write0 = 0x04;
  host_call(write0, line);
  host_call(write0, "\n");
  return 0;
}

[[noreturn]] static void leave(int status) noexcept {
  constexpr int exit_extended = 0x20;
  const std::uint32_t block[2] = {0x20026u, static_cast<std::uint32_t>(status)};
  host_call(exit_extended, block);
  for (;;) {
  }
}

[[noreturn]] void on_fault() {
  puts("fault");
  leave(99);
}

[[noreturn]] void on_reset() {
  *reinterpret_cast<volatile std::uint32_t*>(0xE000ED88u) |= 0xFu
                                                             << 20;  // CPACR: the floating-point unit, before any use
  asm volatile("dsb\n isb");
  const std::uint32_t* from = data_in_flash;
  for (std::uint32_t* to = data_start; to < data_end; ++to) *to = *from++;
  for (std::uint32_t* to = bss_start; to < bss_end; ++to) *to = 0;
  for (auto f = init_start; f < init_end; ++f) (*f)();
  leave(program());
}

using Vector = void (*)();
[[gnu::section(".vectors"), gnu::used]] const struct {
  std::uint32_t* stack;
  Vector handler[15];
} vectors = {stack_top, {on_reset, on_fault, on_fault, on_fault, on_fault, on_fault}};

// What the compiler and newlib's assert() ask for.
int __aeabi_atexit(void*, void (*)(void*), void*) { return 0; }
int __cxa_atexit(void (*)(void*), void*, void*) { return 0; }
void* __dso_handle = nullptr;
[[noreturn]] void __assert_func(const char*, int, const char*, const char* what) {
  puts(what);
  leave(98);
}
}  // extern "C"

namespace board {

// SysTick counts down at 25 MHz; with the emulator's -icount shift=0 an instruction is a nanosecond.
std::uint32_t now() noexcept {
  volatile std::uint32_t* const systick = reinterpret_cast<volatile std::uint32_t*>(0xE000E010u);
  if ((systick[0] & 1u) == 0) {
    systick[1] = 0xFFFFFFu;
    systick[2] = 0;
    systick[0] = 5;
  }
  return systick[2];
}

std::uint32_t instructions_since(std::uint32_t begin) noexcept { return ((begin - now()) & 0xFFFFFFu) * 40u; }

[[gnu::noinline]] std::uint32_t stack_of(void (*work)()) noexcept {
  constexpr std::uint32_t paint = 0xA5A5A5A5u;
  std::uint32_t* const here = static_cast<std::uint32_t*>(__builtin_frame_address(0)) - 16;
  for (volatile std::uint32_t* p = stack_bottom; p < here; ++p) *p = paint;
  work();
  const volatile std::uint32_t* p = stack_bottom;
  while (p < here && *p == paint) ++p;
  return static_cast<std::uint32_t>((here + 16 - p) * 4);
}

// The board's first UART (CMSDK APB UART: DATA, STATE, CTRL, INTSTATUS, BAUDDIV), by polling.
static volatile std::uint32_t* uart() noexcept {
  volatile std::uint32_t* const u = reinterpret_cast<volatile std::uint32_t*>(0x40004000u);
  if (u[2] == 0) {
    u[4] = 16;  // the least that it takes
    u[2] = 3;   // both directions
  }
  return u;
}

bool send(std::span<const std::uint8_t> bytes) noexcept {
  for (const std::uint8_t b : bytes) {
    while ((uart()[1] & 1u) != 0) {
    }
    uart()[0] = b;
  }
  return true;
}

bool receive(std::span<std::uint8_t> bytes) noexcept {
  for (std::uint8_t& b : bytes) {
    while ((uart()[1] & 2u) == 0) {
    }
    b = static_cast<std::uint8_t>(uart()[0]);
  }
  return true;
}

}  // namespace board
