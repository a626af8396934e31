// Two hosts: a rig in one network namespace, an experimenter in another, each on its end of a veth pair; between the
// other ends a relay that loses, doubles and damages.
#include <arpa/inet.h>
#include <poll.h>

#include <atomic>

#include "core/random.hpp"
#include "tests/support/background.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/network.hpp"

using namespace saltus::test;

namespace {

bool shell(const std::string& command) { return std::system((command + " >/dev/null 2>&1").c_str()) == 0; }

// In the new process: a network of its own, where `device` is to appear.
void become_host(const std::string& device, const std::string& address) {
  if (::unshare(CLONE_NEWNET) != 0) ::_exit(125);
  for (int i = 0; i < 1000 && ::if_nametoindex(device.c_str()) == 0; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  if (!shell("ip link set lo up && ip addr add " + address + "/24 dev " + device + " && ip link set " + device +
             " up && ip route add 224.0.0.0/4 dev " + device)) {
    ::_exit(124);
  }
}

// The near end of a host's cable.
bool connect_host(pid_t host, const std::string& near, const std::string& far, const std::string& address) {
  std::this_thread::sleep_for(std::chrono::milliseconds(300));  // it must be in its own network first
  return shell("ip link add " + near + " type veth peer name " + far + " && ip link set " + far + " netns " +
               std::to_string(host) + " && ip addr add " + address + "/24 dev " + near + " && ip link set " + near +
               " up");
}

class Relay {
 public:
  std::atomic<std::int64_t> passed{0}, lost{0}, damaged{0}, doubled{0};

  Relay(const char* a, const char* b) : sockets_{open(a), open(b)}, thread_([this] { run(); }) {}
  ~Relay() {
    done_ = true;
    thread_.join();
    for (const int s : sockets_) ::close(s);
  }

 private:
  static sockaddr_in group() {
    sockaddr_in g{};
    g.sin_family = AF_INET;
    g.sin_addr.s_addr = htonl(0xEFFF4C43);
    g.sin_port = htons(7667);
    return g;
  }
  static int open(const char* device) {
    const int s = ::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0);
    const int one = 1, zero = 0;
    const sockaddr_in g = group();
    ip_mreqn request{};
    request.imr_multiaddr = g.sin_addr;
    request.imr_ifindex = static_cast<int>(::if_nametoindex(device));
    (void)::setsockopt(s, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
    (void)::setsockopt(s, IPPROTO_IP, IP_MULTICAST_ALL, &zero, sizeof zero);
    (void)::setsockopt(s, IPPROTO_IP, IP_MULTICAST_LOOP, &zero, sizeof zero);
    (void)::setsockopt(s, IPPROTO_IP, IP_ADD_MEMBERSHIP, &request, sizeof request);
    (void)::setsockopt(s, IPPROTO_IP, IP_MULTICAST_IF, &request, sizeof request);
    (void)::bind(s, reinterpret_cast<const sockaddr*>(&g), sizeof g);
    return s;
  }

  void run() {
    const sockaddr_in g = group();
    while (!done_.load()) {
      std::array<pollfd, 2> what{pollfd{sockets_[0], POLLIN, 0}, pollfd{sockets_[1], POLLIN, 0}};
      (void)::poll(what.data(), what.size(), 20);
      for (std::size_t i = 0; i < 2; ++i) {
        std::array<char, 65536> p;
        for (ssize_t n = 0; (n = ::recv(sockets_[i], p.data(), p.size(), 0)) > 0;) {
          const double dice = random_.uniform();
          if (dice < 0.05) {
            ++lost;
            continue;
          }
          if (dice < 0.10) {
            p[static_cast<std::size_t>(n) - 10] ^= 4;
            ++damaged;
          }
          int copies = 1;
          if (dice > 0.98) {
            copies = 2;
            ++doubled;
          }
          for (; copies > 0; --copies) {
            (void)::sendto(sockets_[1 - i], p.data(), static_cast<std::size_t>(n), 0,
                           reinterpret_cast<const sockaddr*>(&g), sizeof g);
          }
          ++passed;
        }
      }
    }
  }

  std::array<int, 2> sockets_;
  saltus::Random random_{7};
  std::atomic<bool> done_{false};
  std::thread thread_;
};

}  // namespace

TEST_CASE("between two hosts, through a line that loses, doubles and damages, the bits are the same") {
  SALTUS_OWN_NETWORK();
  if (!shell("ip link add t0 type veth peer name t1") || !shell("ip link del t0")) {
    WARN("skipped: veth pairs cannot be made here (the program ip, or its rights)");
    return;
  }
  const Folder f;
  REQUIRE(f.run(short_campaign({"--json", "here.json"})).status == 0);
  Background rig(f, "rig", short_rig({"--link", "udpm://239.255.76.67:7667?ttl=1"}),
                 [] { become_host("r1", "198.18.1.2"); });
  REQUIRE(connect_host(rig.process(), "r0", "r1", "198.18.1.1"));
  Background identify(
      f, "identify",
      short_campaign({"--link", "udpm://239.255.76.67:7667?ttl=1", "--json", "far.json", "--patience", "60"}),
      [] { become_host("e1", "198.18.2.2"); });
  REQUIRE(connect_host(identify.process(), "e0", "e1", "198.18.2.1"));
  Relay relay("r0", "e0");
  const auto done = identify.end(0);
  INFO(done.out << done.err);
  CHECK(done.status == 0);
  CHECK(hash_in(f, "far.json") == hash_in(f, "here.json"));
  CHECK(hash_in(f, "far.json").size() == 16);
  CHECK(relay.lost > 0);
  CHECK(relay.damaged > 0);
  CHECK(relay.doubled > 0);
  CHECK(done.out.find("orders sent again") != std::string::npos);
  CHECK(done.out.find("checksum") != std::string::npos);
  const auto ended = rig.end(SIGINT);
  CHECK(ended.status == 0);
  CHECK(ended.out.find("checksum") != std::string::npos);
}
