#include "bus.hpp"

#include <lcm/lcm.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <set>

namespace saltus {
namespace {

constexpr int bunch = 64;               // messages in one direction before the other gets its turn
constexpr std::int64_t look = 250'000;  // [ns] between looks for something to send, where nobody wakes

int new_event() {
  const int event = ::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (event < 0) throw LinkError(std::string("no event descriptor to be had (") + std::strerror(errno) + ")");
  return event;
}
void signal(int event) noexcept {
  const std::uint64_t one = 1;
  if (::write(event, &one, sizeof one) < 0) return;  // full: it is awake
}
void clear(int event) noexcept {
  std::uint64_t count = 0;
  if (::read(event, &count, sizeof count) < 0) return;  // was not rung
}
int wait_for(pollfd* what, nfds_t n, std::int64_t ns) noexcept {
  const timespec limit{static_cast<time_t>(ns / 1'000'000'000), static_cast<long>(ns % 1'000'000'000)};
  return ::ppoll(what, n, ns < 0 ? nullptr : &limit, nullptr);
}

}  // namespace

Doorbell::Doorbell() : event_(new_event()) {}
Doorbell::~Doorbell() { ::close(event_); }
void Doorbell::ring() noexcept { signal(event_); }
void Doorbell::await(std::int64_t ns) noexcept {
  pollfd what{event_, POLLIN, 0};
  if (wait_for(&what, 1, ns > 0 ? ns : 0) > 0) clear(event_);
}

// A raw subscription of liblcm: without its typed decoding, and without its C++ layer.
struct LcmCallback {
  static void heard(const lcm_recv_buf_t* buffer, const char* channel, void* user) noexcept {
    // liblcm 1.3.1 may say 4294967295 bytes: nothing beyond the largest message is looked at.
    const std::size_t size = buffer->data_size;
    static_cast<Bus*>(user)->deliver(
        channel, {static_cast<const std::uint8_t*>(buffer->data), size <= largest_message ? size : std::size_t{0}});
  }
};

Bus::Bus(const std::string& url, const BusOptions& options) : options_(options) {
  if (url == "memq://" || url == "memq") {
    lcm_ = lcm_create("memq://");
    owns_lcm_ = true;
    if (lcm_ == nullptr) throw LinkError("--link " + url + ": LCM cannot be opened; check its installation");
  } else {
    socket_ = std::make_unique<Multicast>(MulticastAddress::parse(url));
  }
  wake_ = new_event();
}

Bus::Bus(_lcm_t* lcm, const BusOptions& options) : options_(options), lcm_(lcm), wake_(new_event()) {
  if (lcm == nullptr) throw LinkError("LCM is not open");
}

Bus::~Bus() {
  stop();
  for (void* const s : subscriptions_) (void)lcm_unsubscribe(lcm_, static_cast<lcm_subscription_t*>(s));
  if (owns_lcm_) lcm_destroy(lcm_);
  ::close(wake_);
}

void Bus::attach(Port& port) { ports_.push_back(&port); }

void Bus::start() {
  if (lcm_ != nullptr && subscriptions_.empty()) {
    // Each channel once, whoever hears it: deliver() sees to the rest, as it does for a socket.
    std::set<std::string, std::less<>> channels;
    for (const Port* const port : ports_) channels.emplace(port->hears());
    if (channels.count("") != 0) channels = {".*"};
    for (const std::string& channel : channels) {
      lcm_subscription_t* const s = lcm_subscribe(lcm_, channel.c_str(), &LcmCallback::heard, this);
      if (s == nullptr) throw LinkError("LCM cannot subscribe; check the network with saltus link-test");
      subscriptions_.push_back(s);
      if (lcm_subscription_set_queue_capacity(s, 0) != 0) throw LinkError("LCM cannot lift the limit of its queue");
    }
  }
  stopping_ = false;
  thread_ = std::thread([this] { run(); });
}

void Bus::stop() noexcept {
  if (!thread_.joinable()) return;
  stopping_ = true;
  signal(wake_);
  thread_.join();
}

void Bus::wake() noexcept { signal(wake_); }

void Bus::run() noexcept {
  std::array<pollfd, 2> what{pollfd{socket_ ? socket_->descriptor() : lcm_get_fileno(lcm_), POLLIN, 0},
                             pollfd{wake_, POLLIN, 0}};
  while (!stopping_.load(std::memory_order_relaxed)) {
    const bool sent = send_all();
    const bool received = receive_all();
    if (sent || received) continue;
    (void)wait_for(what.data(), what.size(), options_.wake ? -1 : look);
    if ((what[1].revents & POLLIN) != 0) clear(wake_);
  }
  (void)send_all();
}

bool Bus::send_all() noexcept {
  bool any = false;
  for (Port* const port : ports_) {
    for (int i = 0; i < bunch; ++i) {
      const std::size_t size = port->next(out_);
      if (size == 0) break;
      any = true;
      const std::span<const std::uint8_t> bytes(out_.data(), size);
      const std::string_view channel = port->says();
      if (options_.log != nullptr) (void)options_.log->write(channel, bytes);
      const bool taken =
          socket_ ? socket_->send(channel, bytes)
                  : lcm_publish(lcm_, channel.data(), bytes.data(), static_cast<unsigned int>(bytes.size())) == 0;
      if (!taken) unsent_.fetch_add(1, std::memory_order_relaxed);
    }
  }
  return any;
}

bool Bus::receive_all() noexcept {
  for (int i = 0; i < bunch; ++i) {
    if (lcm_ != nullptr) {
      if (lcm_handle_timeout(lcm_, 0) <= 0) return i > 0;
      continue;
    }
    const Multicast::Received r = socket_->receive();
    if (r.what == Multicast::Received::nothing) return i > 0;
    if (r.what == Multicast::Received::malformed) {
      malformed_.fetch_add(1, std::memory_order_relaxed);
    } else {
      deliver(r.channel, r.data);
    }
  }
  return true;
}

void Bus::deliver(std::string_view channel, std::span<const std::uint8_t> bytes) noexcept {
  bool known = false;
  for (Port* const port : ports_) {
    if (!port->hears().empty() && port->hears() != channel) continue;
    if (!known && options_.log != nullptr) (void)options_.log->write(channel, bytes);
    known = true;
    port->heard(channel, bytes);
  }
  if (!known) foreign_.fetch_add(1, std::memory_order_relaxed);
}

}  // namespace saltus
