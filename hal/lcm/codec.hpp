// Messages to bytes and back, by the coders that lcm-gen made of the .lcm files here. No allocation, no exception.
#pragma once

#include <algorithm>
#include <span>

#include "../link.hpp"
#include "../notice.hpp"

namespace saltus {

inline constexpr int max_inputs = 8, max_outputs = 16;  // that a message holds
inline constexpr std::size_t largest_message = 1400;    // [B] one frame of an Ethernet, with LCM's and UDP's headers

inline constexpr char stimulus_channel[] = "SALTUS_STIM";
inline constexpr char measurement_channel[] = "SALTUS_MEAS";
inline constexpr char htf_channel[] = "SALTUS_HTF";
inline constexpr char status_channel[] = "SALTUS_STATUS";

enum class Checksum : std::uint8_t {
  checked,
  ignored,  // for the control of tests only: shows what the checksum is for
};

// Size of the message [B]; `out` holds at least largest_message.
std::size_t encode(const Stimulus<max_inputs>& m, int inputs, std::span<std::uint8_t> out) noexcept;
std::size_t encode(const Measurement<max_outputs>& m, int outputs, std::span<std::uint8_t> out) noexcept;
std::size_t encode(const Presence& m, std::span<std::uint8_t> out) noexcept;
std::size_t encode(const HtfBins& m, std::span<std::uint8_t> out) noexcept;

// What decoding found: the message, or the first check that it failed.
struct Decoded {
  bool good = true;
  Fault fault = Fault::length;  // when not good
};
Decoded decode(std::span<const std::uint8_t> in, Stimulus<max_inputs>& m, int& inputs,
               Checksum checksum = Checksum::checked) noexcept;
Decoded decode(std::span<const std::uint8_t> in, Measurement<max_outputs>& m, int& outputs,
               Checksum checksum = Checksum::checked) noexcept;
Decoded decode(std::span<const std::uint8_t> in, Presence& m) noexcept;
Decoded decode(std::span<const std::uint8_t> in, HtfBins& m) noexcept;

template <int Nu>
std::size_t encode(const Stimulus<Nu>& m, std::span<std::uint8_t> out) noexcept {
  static_assert(Nu <= max_inputs);
  Stimulus<max_inputs> wide{m.session, m.seq, m.tick, {}, m.order, m.experiment, m.sent};
  std::copy(m.u.begin(), m.u.end(), wide.u.begin());
  return encode(wide, Nu, out);
}
template <int Ny>
std::size_t encode(const Measurement<Ny>& m, std::span<std::uint8_t> out) noexcept {
  static_assert(Ny <= max_outputs);
  Measurement<max_outputs> wide{m.session, m.seq, m.tick, {}, m.status, m.answer, m.machine, m.sent};
  std::copy(m.y.begin(), m.y.end(), wide.y.begin());
  return encode(wide, Ny, out);
}
template <int Nu>
Decoded decode(std::span<const std::uint8_t> in, Stimulus<Nu>& m, Checksum checksum = Checksum::checked) noexcept {
  Stimulus<max_inputs> wide;
  int inputs = 0;
  Decoded d = decode(in, wide, inputs, checksum);
  if (d.good && inputs != Nu) d = {false, Fault::kind};
  if (!d.good) return d;
  m = {wide.session, wide.seq, wide.tick, {}, wide.order, wide.experiment, wide.sent};
  std::copy(wide.u.begin(), wide.u.begin() + Nu, m.u.begin());
  return d;
}
template <int Ny>
Decoded decode(std::span<const std::uint8_t> in, Measurement<Ny>& m, Checksum checksum = Checksum::checked) noexcept {
  Measurement<max_outputs> wide;
  int outputs = 0;
  Decoded d = decode(in, wide, outputs, checksum);
  if (d.good && outputs != Ny) d = {false, Fault::kind};
  if (!d.good) return d;
  m = {wide.session, wide.seq, wide.tick, {}, wide.status, wide.answer, wide.machine, wide.sent};
  std::copy(wide.y.begin(), wide.y.begin() + Ny, m.y.begin());
  return d;
}

}  // namespace saltus
