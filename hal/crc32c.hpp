// CRC-32C (Castagnoli; RFC 3720, appendix B.4): finds every error of up to five bits, and every burst of up to 32, in
// messages as short as these. UDP's own checksum does not see what goes wrong before it is made or after it is checked.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace saltus {

namespace detail {
constexpr std::array<std::uint32_t, 256> crc32c_table() noexcept {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t r = i;
    for (int bit = 0; bit < 8; ++bit) r = (r >> 1) ^ ((r & 1) != 0 ? 0x82f63b78u : 0u);
    table[i] = r;
  }
  return table;
}
inline constexpr std::array<std::uint32_t, 256> crc32c_bytes = crc32c_table();
}  // namespace detail

constexpr std::uint32_t crc32c(std::span<const std::uint8_t> bytes) noexcept {
  std::uint32_t r = 0xffffffffu;
  for (const std::uint8_t b : bytes) r = (r >> 8) ^ detail::crc32c_bytes[(r ^ b) & 0xffu];
  return ~r;
}

}  // namespace saltus
