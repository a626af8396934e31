// A network for one test alone, where nothing else is and from where nothing leaves. What is started afterwards,
// threads and programs, lives in it too.
#pragma once

#include <net/if.h>
#include <net/route.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

namespace saltus::test {

enum class Multicasting { routed, unrouted };

// Moves this thread into a network namespace of its own, lo up and, if wanted, multicast routed to it. Returns why that
// is not possible; empty when done.
inline std::string enter_own_network(Multicasting multicast = Multicasting::routed) {
  if (::unshare(CLONE_NEWNET) != 0 && ::unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0) {
    return std::string("network namespaces are not permitted here (") + std::strerror(errno) + ")";
  }
  const int s = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  ifreq lo{};
  std::strcpy(lo.ifr_name, "lo");
  lo.ifr_flags = IFF_UP | IFF_RUNNING;
  std::string why;
  if (::ioctl(s, SIOCSIFFLAGS, &lo) != 0) why = std::string("lo cannot be brought up (") + std::strerror(errno) + ")";
  if (why.empty() && multicast == Multicasting::routed) {
    rtentry route{};
    sockaddr_in to{}, mask{};
    to.sin_family = mask.sin_family = AF_INET;
    to.sin_addr.s_addr = htonl(0xE0000000);
    mask.sin_addr.s_addr = htonl(0xF0000000);
    std::memcpy(&route.rt_dst, &to, sizeof to);
    std::memcpy(&route.rt_genmask, &mask, sizeof mask);
    char device[] = "lo";
    route.rt_dev = device;
    route.rt_flags = RTF_UP;
    if (::ioctl(s, SIOCADDRT, &route) != 0) why = std::string("no route can be added (") + std::strerror(errno) + ")";
  }
  ::close(s);
  return why;
}

}  // namespace saltus::test

// Ends the test with a stated reason where it cannot have a network; Catch2 version 2 has no skip of its own.
#define SALTUS_OWN_NETWORK(...)                                                             \
  if (const std::string why = saltus::test::enter_own_network(__VA_ARGS__); !why.empty()) { \
    WARN("skipped: " << why);                                                               \
    return;                                                                                 \
  }
