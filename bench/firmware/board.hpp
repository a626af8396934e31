// What a program may ask of the machine it runs on, beside puts(). On a host nothing is counted.
#pragma once

#include <cstdint>
#include <span>

namespace board {

// An instant, and what was executed since then [instruction], to within 40 and up to 6e8; on a host 0.
std::uint32_t now() noexcept;
std::uint32_t instructions_since(std::uint32_t begin) noexcept;

// Largest number of bytes of stack that `work` had in use; on a host 0.
std::uint32_t stack_of(void (*work)()) noexcept;

// The serial line; on a host, descriptor 3. Waits until all is sent, or come. False: there is nobody (a board cannot
// tell).
bool send(std::span<const std::uint8_t> bytes) noexcept;
bool receive(std::span<std::uint8_t> bytes) noexcept;

}  // namespace board
