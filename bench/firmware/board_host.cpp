#include "board.hpp"

namespace board {

std::uint32_t now() noexcept { return 0; }

std::uint32_t instructions_since(std::uint32_t) noexcept { return 0; }

std::uint32_t stack_of(void (*work)()) noexcept {
  work();
  return 0;
}

}  // namespace board
