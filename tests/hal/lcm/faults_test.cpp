// Faults on the wire: raw packets that no liblcm would send, and a relay between two ports that loses, doubles, damages
// and overtakes.
#include <arpa/inet.h>
#include <poll.h>

#include <atomic>
#include <deque>
#include <thread>

#include "core/random.hpp"
#include "hal/lcm/notice_board.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/loop.hpp"
#include "tests/support/network.hpp"

using namespace saltus;
using test::Hash;
using test::Plant;

namespace {

using ExperimenterEnd = BusEnd<Stimulus<1>, Measurement<2>>;
using MachineEnd = BusEnd<Measurement<2>, Stimulus<1>>;
using Packet = std::vector<std::uint8_t>;

// Sends any bytes to the group.
class RawSender {
 public:
  explicit RawSender(std::uint16_t port) {
    to_.sin_family = AF_INET;
    to_.sin_addr.s_addr = htonl(0xEFFF4C43);
    to_.sin_port = htons(port);
  }
  ~RawSender() { ::close(socket_); }
  void send(const Packet& p) {
    (void)::sendto(socket_, p.data(), p.size(), 0, reinterpret_cast<const sockaddr*>(&to_), sizeof to_);
  }

 private:
  int socket_ = ::socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in to_{};
};

Packet packet(std::string_view channel, std::span<const std::uint8_t> data, std::uint32_t magic = 0x4c433032) {
  Packet p;
  for (int shift = 24; shift >= 0; shift -= 8) p.push_back(static_cast<std::uint8_t>(magic >> shift));
  p.insert(p.end(), 4, 0);
  p.insert(p.end(), channel.begin(), channel.end());
  p.push_back(0);
  p.insert(p.end(), data.begin(), data.end());
  return p;
}
template <class Message>
Packet packet_of(std::string_view channel, const Message& m) {
  std::array<std::uint8_t, largest_message> bytes{};
  return packet(channel, std::span<const std::uint8_t>(bytes).first(encode(m, bytes)));
}

class Rig {
 public:
  explicit Rig(MachineEnd& end)
      : session_(draw_id(), {}, end.faults()), thread_([this, &end] {
          while (!done_.load()) {
            if (serve(end, session_, plant_, steady_ns()) == 0) end.await(1'000'000);
          }
        }) {}
  ~Rig() {
    done_ = true;
    thread_.join();
  }

 private:
  Plant plant_;
  MachineSession<1, 2> session_;
  std::atomic<bool> done_{false};
  std::thread thread_;
};

// Passes LCM's packets between two ports, each with one fault at most.
class Relay {
 public:
  struct Injected {
    std::atomic<std::int64_t> lost{0}, doubled{0}, damaged{0}, overtaken{0};
  };
  Injected injected;
  std::atomic<bool> faulty{false};

  Relay(std::uint16_t a, std::uint16_t b) : ends_{End(a), End(b)}, thread_([this] { run(); }) {}
  ~Relay() {
    done_ = true;
    thread_.join();
  }

 private:
  struct End {
    explicit End(std::uint16_t port) : in(MulticastAddress{0xEFFF4C43, port, 0, 1 << 20}), out(port) {}
    Multicast in;
    RawSender out;
    Packet held;  // to be overtaken by the next one
    std::int64_t since = 0;
    std::deque<Packet> own;  // sent by this relay to that port, and heard again
  };

  void run() {
    while (!done_.load()) {
      std::array<pollfd, 2> what{pollfd{ends_[0].in.descriptor(), POLLIN, 0},
                                 pollfd{ends_[1].in.descriptor(), POLLIN, 0}};
      (void)::poll(what.data(), what.size(), 1);
      for (std::size_t i = 0; i < 2; ++i) {
        for (auto r = ends_[i].in.receive(); r.what != Multicast::Received::nothing; r = ends_[i].in.receive()) {
          const bool down = r.channel == stimulus_channel;
          if (down != (i == 0) || r.channel == status_channel) continue;  // each channel has one direction
          pass(ends_[1 - i], packet(r.channel, r.data), 8 + r.channel.size() + 1);
        }
        if (!ends_[i].held.empty() && steady_ns() - ends_[i].since > 4'000'000) release(ends_[i], false);
      }
    }
  }

  void release(End& to, bool was_overtaken) {
    to.out.send(to.held);
    to.held.clear();
    injected.overtaken += was_overtaken ? 1 : 0;
  }

  void pass(End& to, Packet p, std::size_t payload) {
    bool intact = true;
    const double dice = faulty.load() ? random_.uniform() : 1.0;
    if (dice < 0.05) {
      ++injected.lost;
      return;
    }
    if (dice < 0.10) {
      const std::size_t bit = random_.uniform_int(8 * (p.size() - payload));
      p[payload + bit / 8] = static_cast<std::uint8_t>(p[payload + bit / 8] ^ (1u << bit % 8));
      ++injected.damaged;
      intact = false;
    } else if (dice < 0.12 && to.held.empty()) {
      to.held = p;
      to.since = steady_ns();
      return;
    }
    to.out.send(p);
    if (dice >= 0.12 && dice < 0.14) {
      to.out.send(p);
      ++injected.doubled;
    }
    if (!to.held.empty()) release(to, intact);  // nobody notices being overtaken by rubbish
  }

  std::array<End, 2> ends_;
  Random random_{5};
  std::atomic<bool> done_{false};
  std::thread thread_;
};

struct Outcomes {
  Outcome outcome = Outcome::silent;
  Hash hash;
};

// A loop over a relay: a clean beginning and end, so that every fault has what comes before and after it.
Outcomes run_over(Relay& relay, ExperimenterEnd& here, std::int64_t ticks) {
  ExchangeOptions options;
  options.retry = 3'000'000;
  Lockstep<ExperimenterEnd, 1, 2> machine(here, here.faults(), options);
  Outcomes o;
  Plant::Reply y;
  o.outcome = machine.start(0, y);
  for (std::int64_t n = 0; n < ticks && o.outcome == Outcome::answered; ++n) {
    relay.faulty = n > 10 && n < ticks - 100;
    o.outcome = machine.exchange(n, {test::control(y)}, y);
    o.hash.add(y.y[0]);
    o.hash.add(y.y[1]);
  }
  (void)machine.stop();
  return o;
}

}  // namespace

TEST_CASE("lockstep through loss, doubling, damage and overtaking is bit-identical, and every fault is counted") {
  SALTUS_OWN_NETWORK();
  constexpr std::int64_t ticks = 2000;
  Relay relay(7667, 7668);
  Bus bus("udpm://239.255.76.67:7667"), other("udpm://239.255.76.67:7668");
  ExperimenterEnd here(bus, stimulus_channel, measurement_channel);
  MachineEnd there(other, measurement_channel, stimulus_channel);
  bus.start();
  other.start();
  {
    Rig rig(there);
    const Outcomes o = run_over(relay, here, ticks);
    CHECK(o.outcome == Outcome::answered);
    CHECK(o.hash.value == test::reference(ticks).value);
  }
  const auto counted = [&](Fault f) { return here.faults()[f] + there.faults()[f]; };
  CHECK(relay.injected.lost > 20);
  CHECK(relay.injected.damaged > 20);
  CHECK(relay.injected.doubled > 5);
  CHECK(counted(Fault::length) == 0);
  CHECK(counted(Fault::fingerprint) + counted(Fault::checksum) == relay.injected.damaged);
  CHECK(counted(Fault::duplicate) == relay.injected.doubled);
  CHECK(counted(Fault::late) == relay.injected.overtaken);
  CHECK(counted(Fault::gap) == relay.injected.lost + relay.injected.damaged + relay.injected.overtaken);
  CHECK(counted(Fault::session) == 0);
  CHECK(counted(Fault::range) == 0);
  CHECK(counted(Fault::overflow) == 0);
}

TEST_CASE("the control: without the checksum the same loop diverges") {
  SALTUS_OWN_NETWORK();
  constexpr std::int64_t ticks = 2000;
  Relay relay(7667, 7668);
  Bus bus("udpm://239.255.76.67:7667"), other("udpm://239.255.76.67:7668");
  ExperimenterEnd here(bus, stimulus_channel, measurement_channel, Checksum::ignored);
  MachineEnd there(other, measurement_channel, stimulus_channel, Checksum::ignored);
  bus.start();
  other.start();
  Rig rig(there);
  const Outcomes o = run_over(relay, here, ticks);
  CHECK(o.hash.value != test::reference(ticks).value);
}

TEST_CASE("raw packets of every malformed kind are counted and harm nobody") {
  SALTUS_OWN_NETWORK();
  Bus bus("udpm://"), other("udpm://");
  ExperimenterEnd here(bus, stimulus_channel, measurement_channel);
  MachineEnd there(other, measurement_channel, stimulus_channel);
  bus.start();
  other.start();
  Rig rig(there);
  Lockstep<ExperimenterEnd, 1, 2> machine(here, here.faults(), {});
  Plant::Reply y;
  REQUIRE(machine.start(0, y) == Outcome::answered);
  REQUIRE(machine.exchange(0, {0.5}, y) == Outcome::answered);
  const Plant::Reply good = y;
  const std::int64_t session = machine.session().session(), seq = machine.session().order().seq;
  const FaultCounts& f = there.faults();

  RawSender raw(7667);
  Random random(3);
  std::int64_t malformed = 0, foreign = 0;
  const auto junk = [&](std::size_t n) {
    Packet p(n);
    for (auto& b : p) b = static_cast<std::uint8_t>(random.bits());
    return p;
  };
  Stimulus<1> s;
  s.session = session;
  s.order = Order::hold;
  s.tick = 1;
  s.seq = seq + 1;
  s.sent = seq + 1;
  const Packet proper = packet_of(stimulus_channel, s);
  const std::size_t head = 8 + sizeof stimulus_channel;

  for (std::size_t n = 0; n < 500; ++n) {  // noise, with LCM's magic and without
    Packet p = junk(n % 100);
    if (p.size() >= 4) p[0] = 0;
    raw.send(p);
    ++malformed;
  }
  raw.send(packet(stimulus_channel, junk(3)));         // short
  raw.send(Packet(proper.begin(), proper.end() - 7));  // cut
  Packet padded = proper;
  padded.insert(padded.end(), 12, 0);
  raw.send(padded);                                   // padded
  raw.send(packet(stimulus_channel, Packet(60000)));  // as long as it gets
  raw.send(packet(stimulus_channel, Packet(124)));    // all zero: no fingerprint
  Packet unterminated(proper.begin(), proper.begin() + static_cast<std::ptrdiff_t>(head) - 1);
  raw.send(unterminated);  // a channel without end
  ++malformed;
  raw.send(packet(std::string(200, 'x'), Packet(10)));  // a channel too long
  ++malformed;
  // Fragments, the first of which crashes liblcm 1.3.1: nothing here is ever that long, so they are passed over.
  raw.send(packet("x", Packet(100, 0xFF), 0x4c433033));
  foreign += 2;
  raw.send(packet("SOMETHING_ELSE", Packet(10)));  // once by each bus
  for (int i = 0; i < 3000; ++i) {                 // a channel never seen before each time; liblcm would keep them all
    raw.send(packet("FOREIGN_" + std::to_string(i), Packet(10)));
    if (i % 100 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  foreign += 3000;
  Stimulus<2> two;
  two.session = session;
  raw.send(packet_of(stimulus_channel, two));  // another number of inputs
  s.u = {std::numeric_limits<double>::quiet_NaN()};
  raw.send(packet_of(stimulus_channel, s));  // well made, and no number
  s.sent += 1;
  s.u = {std::numeric_limits<double>::infinity()};
  raw.send(packet_of(stimulus_channel, s));
  s.u = {0.0};
  s.session = session + 1;
  raw.send(packet_of(stimulus_channel, s));  // another sender
  Measurement<2> m{session, seq, 1, {9.0, 9.0}, Status::ok, Answer::measured, 1, 50};
  raw.send(packet_of(measurement_channel, m));  // another machine

  for (int i = 0; i < 1000 && there.faults()[Fault::session] == 0; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  CHECK(f[Fault::length] == 4);
  CHECK(f[Fault::fingerprint] == 1);
  CHECK(f[Fault::kind] == 1);
  CHECK(f[Fault::range] == 2);
  CHECK(f[Fault::session] == 1);
  CHECK(bus.malformed() == malformed);
  CHECK(other.malformed() == malformed);
  CHECK(other.foreign() >= foreign);
  // The conversation goes on as if nothing had been.
  const double u = test::control(good);
  REQUIRE(machine.exchange(1, {u}, y) == Outcome::answered);
  CHECK(y.y[0] == 1.0 - 1.4 * good.y[0] * good.y[0] + good.y[1] + 0.001 * u);
  CHECK(here.faults()[Fault::session] >= 1);
  CHECK(machine.stop() == Outcome::answered);
}
