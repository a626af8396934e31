// LCM's own packets on a multicast socket of ours. On the network this is LCM's `udpm`, to the bit: lcm-spy, lcm-logger
// and every other LCM program hear it and are heard. In the process it is without what liblcm 1.3.1 brings along: a
// second thread and a pipe on the way, a default queue of 30 that keeps the oldest, a start that blocks for ten seconds
// where multicast is filtered, memory kept for every channel name ever heard, and a crash by one malformed fragment.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

namespace saltus {

// What the environment does not allow; the message names the address and the mend.
struct LinkError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// udpm://[group[:port]][?ttl=N&recv_buf_size=N]
struct MulticastAddress {
  std::uint32_t group = 0xEFFF4C43;  // 239.255.76.67
  std::uint16_t port = 7667;
  int ttl = 0;                   // [hop] 0: this machine only, 1: its network
  int receive_buffer = 4 << 20;  // [B]

  static MulticastAddress parse(const std::string& url);  // throws LinkError
  std::string text() const;                               // group:port
};

class Multicast {
 public:
  // Joins the group. Throws LinkError, with the command that mends it where the network lacks a route.
  explicit Multicast(const MulticastAddress& address);
  ~Multicast();
  Multicast(const Multicast&) = delete;
  Multicast& operator=(const Multicast&) = delete;

  // At once, or not at all (false). `data` up to 60 kB.
  bool send(std::string_view channel, std::span<const std::uint8_t> data) noexcept;

  // One message; views into a buffer of this object, valid until the next call.
  struct Received {
    enum { nothing, message, malformed } what = nothing;
    std::string_view channel;
    std::span<const std::uint8_t> data;
  };
  Received receive() noexcept;

  int descriptor() const noexcept { return socket_; }

 private:
  MulticastAddress address_;
  int socket_ = -1;
  std::uint32_t sent_ = 0;
  std::array<std::uint8_t, 1 << 16> buffer_{};
};

// What is wrong with the network for this address, and the command that mends it; empty when a message sent to the
// group comes back within a second.
std::string what_the_network_lacks(const MulticastAddress& address);

}  // namespace saltus
