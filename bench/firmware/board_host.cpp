#include "board.hpp"

#include <unistd.h>

namespace board {

std::uint32_t now() noexcept { return 0; }

std::uint32_t instructions_since(std::uint32_t) noexcept { return 0; }

std::uint32_t stack_of(void (*work)()) noexcept {
  work();
  return 0;
}

constexpr int line = 3;

bool send(std::span<const std::uint8_t> bytes) noexcept {
  while (!bytes.empty()) {
    const ssize_t n = ::write(line, bytes.data(), bytes.size());
    if (n <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  return true;
}

bool receive(std::span<std::uint8_t> bytes) noexcept {
  while (!bytes.empty()) {
    const ssize_t n = ::read(line, bytes.data(), bytes.size());
    if (n <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  return true;
}

}  // namespace board
