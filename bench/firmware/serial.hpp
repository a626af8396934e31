// Messages over a serial line: as they lie in memory, little-endian on both sides, with a CRC-32C behind them. A line
// that loses bytes would need a mark between messages; that of an emulator does not.
#pragma once

#include <array>
#include <bit>
#include <cstring>
#include <span>

#include "hal/crc32c.hpp"
#include "hal/link.hpp"

namespace saltus::serial {

using Order = Stimulus<1>;
using Reply = Measurement<2>;
static_assert(std::endian::native == std::endian::little && sizeof(Order) == 48 && sizeof(Reply) == 64);

template <class Message>
using Frame = std::array<std::uint8_t, sizeof(Message) + 4>;

template <class Message>
Frame<Message> framed(const Message& m) noexcept {
  Frame<Message> f;
  std::memcpy(f.data(), &m, sizeof m);
  const std::uint32_t crc = crc32c(std::span(f).template first<sizeof m>());
  std::memcpy(f.data() + sizeof m, &crc, 4);
  return f;
}

// False where it is damaged; `m` is then untouched.
template <class Message>
bool unframed(const Frame<Message>& f, Message& m) noexcept {
  std::uint32_t crc = 0;
  std::memcpy(&crc, f.data() + sizeof m, 4);
  if (crc != crc32c(std::span(f).template first<sizeof m>())) return false;
  std::memcpy(&m, f.data(), sizeof m);
  return true;
}

}  // namespace saltus::serial
