// The thread on which LCM lives, and the ends that other threads hold. What they exchange passes through rings.
#pragma once

#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "../event_log.hpp"
#include "../ring.hpp"
#include "codec.hpp"
#include "multicast.hpp"

struct _lcm_t;

namespace saltus {

// One conversation on a bus. Its functions are called by the thread of the bus.
class Port {
 public:
  virtual ~Port() = default;
  virtual std::string_view hears() const noexcept = 0;  // channel; empty: all
  virtual void heard(std::string_view channel, std::span<const std::uint8_t> bytes) noexcept = 0;
  virtual std::string_view says() const noexcept = 0;                  // channel of the next message
  virtual std::size_t next(std::span<std::uint8_t> out) noexcept = 0;  // [B] of it; 0: nothing to send
};

struct BusOptions {
  // true: who sends wakes the bus at once, by a system call: for lockstep. false: the bus looks every 250 us, and
  // sending costs the real-time thread no system call: for paced runs.
  bool wake = true;
  EventLogWriter* log = nullptr;  // gets every message sent and heard, before anybody acts on it; must outlive the bus
};

// Everything here is called by the thread that made the bus, but for wake() and the counts.
class Bus {
 public:
  // udpm://..., or memq:// for ends within this process. Throws LinkError.
  explicit Bus(const std::string& url, const BusOptions& options = {});
  // On an LCM that is open and stays so. Its provider's defects are then its owner's.
  explicit Bus(_lcm_t* lcm, const BusOptions& options = {});
  ~Bus();  // sends what waits, then ends the thread
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;

  void attach(Port& port);  // before start(); a port stops the bus before it goes
  void start();
  void stop() noexcept;

  void wake() noexcept;  // there is something to send
  bool wakes() const noexcept { return options_.wake; }

  std::int64_t foreign() const noexcept { return foreign_; }      // messages that nobody here listens to
  std::int64_t malformed() const noexcept { return malformed_; }  // packets that are not LCM's
  std::int64_t unsent() const noexcept { return unsent_; }        // messages the network did not take

 private:
  void run() noexcept;
  bool send_all() noexcept;
  bool receive_all() noexcept;
  void deliver(std::string_view channel, std::span<const std::uint8_t> bytes) noexcept;

  BusOptions options_;
  std::unique_ptr<Multicast> socket_;
  _lcm_t* lcm_ = nullptr;
  bool owns_lcm_ = false;
  std::vector<void*> subscriptions_;  // of liblcm
  std::vector<Port*> ports_;
  int wake_ = -1;
  std::atomic<bool> stopping_{false};
  std::atomic<std::int64_t> foreign_{0}, malformed_{0}, unsent_{0};
  std::array<std::uint8_t, largest_message> out_{};
  std::thread thread_;

  friend struct LcmCallback;
};

// Lets one thread sleep until another has something for it.
class Doorbell {
 public:
  Doorbell();  // throws LinkError
  ~Doorbell();
  Doorbell(const Doorbell&) = delete;
  Doorbell& operator=(const Doorbell&) = delete;
  void ring() noexcept;
  void await(std::int64_t ns) noexcept;  // returns when rung, or after ns

 private:
  int event_;
};

// One end of a link over a bus: a Link (link.hpp) for the thread that holds it.
//   experimenter  BusEnd<Stimulus<Nu>, Measurement<Ny>> end(bus, stimulus_channel, measurement_channel);
//   machine       BusEnd<Measurement<Ny>, Stimulus<Nu>> end(bus, measurement_channel, stimulus_channel);
template <class Out, class In, std::size_t Capacity = 64>
class BusEnd final : public Port {
 public:
  BusEnd(Bus& bus, std::string says, std::string hears, Checksum checksum = Checksum::checked)
      : bus_(&bus), says_(std::move(says)), hears_(std::move(hears)), checksum_(checksum) {
    bus.attach(*this);
  }
  ~BusEnd() override { bus_->stop(); }
  BusEnd(const BusEnd&) = delete;
  BusEnd& operator=(const BusEnd&) = delete;

  [[nodiscard]] bool try_send(const Out& message) noexcept {
    const bool taken = out_.try_push(message);
    if (bus_->wakes()) bus_->wake();
    if (!taken) faults_.note(Fault::overflow);
    return taken;
  }
  [[nodiscard]] bool try_receive(In& message) noexcept { return in_.try_pop(message); }

  // Sleeps until there may be something to receive. Not for the real-time thread.
  void await(std::int64_t ns) noexcept { bell_.await(bus_->wakes() ? ns : std::min<std::int64_t>(ns, 250'000)); }

  FaultCounts& faults() noexcept { return faults_; }
  std::int64_t received() const noexcept { return received_.load(std::memory_order_relaxed); }  // good ones

  std::string_view hears() const noexcept override { return hears_; }
  std::string_view says() const noexcept override { return says_; }
  void heard(std::string_view, std::span<const std::uint8_t> bytes) noexcept override {
    In message;
    if (const Decoded d = decode(bytes, message, checksum_); !d.good) {
      faults_.note(d.fault);
      return;
    }
    received_.fetch_add(1, std::memory_order_relaxed);
    if (!in_.try_push(message)) faults_.note(Fault::overflow);
    if (bus_->wakes()) bell_.ring();
  }
  std::size_t next(std::span<std::uint8_t> out) noexcept override {
    Out message;
    return out_.try_pop(message) ? encode(message, out) : 0;
  }

 private:
  Bus* bus_;
  std::string says_, hears_;
  Checksum checksum_;
  FaultCounts faults_;
  std::atomic<std::int64_t> received_{0};
  Doorbell bell_;
  Ring<Out, Capacity> out_;
  Ring<In, Capacity> in_;
};

}  // namespace saltus
