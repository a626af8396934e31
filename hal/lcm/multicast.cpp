#include "multicast.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>

namespace saltus {
namespace {

constexpr std::uint32_t short_message = 0x4c433032;  // "LC02": a whole message in one packet
constexpr std::uint32_t long_message = 0x4c433033;   // "LC03": a fragment; nothing of ours is that long
constexpr std::size_t header_size = 8;               // [B] the magic and a packet number, big-endian
constexpr std::size_t longest_channel = 63;          // [B] without its final 0

sockaddr_in socket_address(const MulticastAddress& a) noexcept {
  sockaddr_in s{};
  s.sin_family = AF_INET;
  s.sin_addr.s_addr = htonl(a.group);
  s.sin_port = htons(a.port);
  return s;
}

std::string route_advice(const MulticastAddress& a) {
  return a.ttl == 0
             ? "run: sudo ip link set lo up && sudo ip route add 224.0.0.0/4 dev lo"
             : "run: sudo ip route add 224.0.0.0/4 dev INTERFACE, where INTERFACE leads to the other machine (ip "
               "link shows them)";
}

[[noreturn]] void refuse(const std::string& url, const std::string& why) {
  throw LinkError("--link " + url + ": " + why +
                  "; write udpm://239.255.76.67:7667?ttl=0 (this machine) or ttl=1 (its network)");
}

template <class Number>
bool whole(std::string_view text, Number low, Number high, Number& value) {
  Number v{};
  const auto [stop, fault] = std::from_chars(text.data(), text.data() + text.size(), v);
  if (fault != std::errc{} || stop != text.data() + text.size() || v < low || v > high) return false;
  value = v;
  return true;
}

void put(std::uint8_t* at, std::uint32_t value) noexcept {
  for (int i = 0; i < 4; ++i) at[i] = static_cast<std::uint8_t>(value >> (24 - 8 * i));
}
std::uint32_t get(const std::uint8_t* at) noexcept {
  return std::uint32_t{at[0]} << 24 | std::uint32_t{at[1]} << 16 | std::uint32_t{at[2]} << 8 | at[3];
}

}  // namespace

MulticastAddress MulticastAddress::parse(const std::string& url) {
  MulticastAddress a;
  constexpr std::string_view scheme = "udpm://";
  if (url.rfind(scheme, 0) != 0) refuse(url, "this is no address of a link");
  std::string_view rest = std::string_view(url).substr(scheme.size());
  std::string_view options;
  if (const auto question = rest.find('?'); question != rest.npos) {
    options = rest.substr(question + 1);
    rest = rest.substr(0, question);
  }
  if (!rest.empty()) {
    const auto colon = rest.find(':');
    const std::string host(rest.substr(0, colon));
    in_addr ip{};
    if (inet_pton(AF_INET, host.c_str(), &ip) != 1 || (ntohl(ip.s_addr) >> 28) != 14) {
      refuse(url, "'" + host + "' is no multicast group (224.0.0.0 to 239.255.255.255)");
    }
    a.group = ntohl(ip.s_addr);
    if (colon != rest.npos && !whole<std::uint16_t>(rest.substr(colon + 1), 1, 65535, a.port)) {
      refuse(url, "'" + std::string(rest.substr(colon + 1)) + "' is no port");
    }
  }
  while (!options.empty()) {
    const auto end = std::min(options.find('&'), options.size());
    const std::string_view option = options.substr(0, end);
    options.remove_prefix(std::min(end + 1, options.size()));
    const auto equals = std::min(option.find('='), option.size());
    const std::string_view key = option.substr(0, equals);
    const std::string_view value = option.substr(std::min(equals + 1, option.size()));
    const bool known = key == "ttl"             ? whole(value, 0, 255, a.ttl)
                       : key == "recv_buf_size" ? whole(value, 2048, 1 << 30, a.receive_buffer)
                                                : false;
    if (!known) refuse(url, "'" + std::string(option) + "' is not understood");
  }
  return a;
}

std::string MulticastAddress::text() const {
  std::string s;
  for (int shift = 24; shift >= 0; shift -= 8) {
    s += (shift < 24 ? "." : "") + std::to_string((group >> shift) & 255u);
  }
  return s + ":" + std::to_string(port);
}

Multicast::Multicast(const MulticastAddress& address) : address_(address) {
  const auto check = [&](bool good, const std::string& what, const std::string& mend) {
    if (good) return;
    const std::string why = std::strerror(errno);
    if (socket_ >= 0) ::close(socket_);
    throw LinkError("udpm://" + address_.text() + ": " + what + " (" + why + "); " + mend);
  };
  const sockaddr_in group = socket_address(address);
  socket_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  check(socket_ >= 0, "no socket to be had", "check the limits of this process");
  const auto set = [&](int level, int option, auto value, const char* what) {
    check(::setsockopt(socket_, level, option, &value, sizeof value) == 0, what, "check the kernel's options");
  };
  set(SOL_SOCKET, SO_REUSEADDR, 1, "the port cannot be shared");
  const int size = address.receive_buffer;  // the kernel cuts it to net.core.rmem_max without a word
  set(SOL_SOCKET, SO_RCVBUF, size, "no receive buffer");
  set(IPPROTO_IP, IP_MULTICAST_TTL, static_cast<unsigned char>(address.ttl), "no time to live");
  set(IPPROTO_IP, IP_MULTICAST_LOOP, static_cast<unsigned char>(1), "no loop to this machine");
  set(IPPROTO_IP, IP_MULTICAST_ALL, 0, "groups cannot be told apart");
  // Bound to the group and not to the port alone: Linux else delivers other groups of the same port as well.
  check(::bind(socket_, reinterpret_cast<const sockaddr*>(&group), sizeof group) == 0, "the port cannot be bound",
        "another program has it for itself; choose another port, for example udpm://239.255.76.67:7668");
  // A route is what decides through which interface to join and to send.
  const int probe = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const bool routed = probe >= 0 && ::connect(probe, reinterpret_cast<const sockaddr*>(&group), sizeof group) == 0;
  const int fault = errno;
  if (probe >= 0) ::close(probe);
  errno = fault;
  check(routed, "no route to the multicast group", route_advice(address));
  ip_mreqn request{};
  request.imr_multiaddr = group.sin_addr;
  check(::setsockopt(socket_, IPPROTO_IP, IP_ADD_MEMBERSHIP, &request, sizeof request) == 0,
        "the multicast group cannot be joined", route_advice(address));
}

Multicast::~Multicast() { ::close(socket_); }

bool Multicast::send(std::string_view channel, std::span<const std::uint8_t> data) noexcept {
  if (channel.empty() || channel.size() > longest_channel) return false;
  std::array<std::uint8_t, header_size + longest_channel + 1> head{};
  put(head.data(), short_message);
  put(head.data() + 4, sent_++);
  std::copy(channel.begin(), channel.end(), head.begin() + header_size);
  std::array<iovec, 2> parts{iovec{head.data(), header_size + channel.size() + 1},
                             iovec{const_cast<std::uint8_t*>(data.data()), data.size()}};
  sockaddr_in to = socket_address(address_);
  msghdr message{};
  message.msg_name = &to;
  message.msg_namelen = sizeof to;
  message.msg_iov = parts.data();
  message.msg_iovlen = parts.size();
  return ::sendmsg(socket_, &message, MSG_DONTWAIT | MSG_NOSIGNAL) >= 0;
}

Multicast::Received Multicast::receive() noexcept {
  Received r;
  const ssize_t got = ::recv(socket_, buffer_.data(), buffer_.size(), MSG_DONTWAIT);
  if (got < 0) return r;
  r.what = Received::malformed;
  const auto size = static_cast<std::size_t>(got);
  if (size < header_size || get(buffer_.data()) != short_message) {
    // Another program's long messages are none of ours, and no fault.
    if (size >= header_size && get(buffer_.data()) == long_message) r.what = Received::message;
    return r;
  }
  const std::uint8_t* const begin = buffer_.data() + header_size;
  const std::size_t room = std::min(size - header_size, longest_channel + 1);
  const void* const end = std::memchr(begin, 0, room);
  if (end == nullptr) return r;
  const auto length = static_cast<std::size_t>(static_cast<const std::uint8_t*>(end) - begin);
  r.what = Received::message;
  r.channel = {reinterpret_cast<const char*>(begin), length};
  r.data = {begin + length + 1, size - header_size - length - 1};
  return r;
}

std::string what_the_network_lacks(const MulticastAddress& address) {
  try {
    Multicast here(address);
    const std::string channel = "SALTUS_" + std::to_string(::getpid());
    for (int tries = 0; tries < 10; ++tries) {
      const std::array<std::uint8_t, 4> hello{'h', 'e', 'r', 'e'};
      if (!here.send(channel, hello)) {
        return "udpm://" + address.text() + ": nothing can be sent to the group (" + std::strerror(errno) + "); " +
               route_advice(address);
      }
      pollfd waiting{here.descriptor(), POLLIN, 0};
      if (::poll(&waiting, 1, 100) <= 0) continue;
      for (auto r = here.receive(); r.what != Multicast::Received::nothing; r = here.receive()) {
        if (r.channel == channel) return {};
      }
    }
    return "udpm://" + address.text() +
           ": what is sent to the group does not come back; a packet filter drops it: allow udp port " +
           std::to_string(address.port) + " (sudo nft list ruleset, sudo iptables -S show the rules)";
  } catch (const LinkError& e) {
    return e.what();
  }
}

}  // namespace saltus
