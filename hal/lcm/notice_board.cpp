#include "notice_board.hpp"

#include <unistd.h>

#include "../lockstep.hpp"

namespace saltus {

NoticeBoard::NoticeBoard(Bus& bus) : bus_(&bus) { bus.attach(*this); }

bool NoticeBoard::post(const Presence& p) noexcept {
  own_.store(p.id, std::memory_order_relaxed);
  const bool taken = presence_.try_push(p);
  if (bus_->wakes()) bus_->wake();
  return taken;
}

bool NoticeBoard::post(const HtfBins& h) noexcept {
  const bool taken = bins_.try_push(h);
  if (bus_->wakes()) bus_->wake();
  return taken;
}

std::vector<NoticeBoard::Neighbour> NoticeBoard::neighbours() const {
  const std::lock_guard lock(mutex_);
  std::vector<Neighbour> all;
  for (const Neighbour& n : neighbours_) {
    if (n.heard != 0) all.push_back(n);
  }
  return all;
}

std::optional<Presence> NoticeBoard::find(std::int64_t id) const {
  for (const Neighbour& n : neighbours()) {
    if (n.presence.id == id) return n.presence;
  }
  return {};
}

void NoticeBoard::heard(std::string_view, std::span<const std::uint8_t> bytes) noexcept {
  Presence p;
  if (!decode(bytes, p).good || p.id == own_.load(std::memory_order_relaxed)) return;
  const std::lock_guard lock(mutex_);
  Neighbour* place = &neighbours_[0];
  for (Neighbour& n : neighbours_) {
    if (n.presence.id == p.id) {
      place = &n;
      break;
    }
    if (n.heard < place->heard) place = &n;
  }
  *place = {p, steady_ns()};
}

std::size_t NoticeBoard::next(std::span<std::uint8_t> out) noexcept {
  Presence p;
  if (presence_.try_pop(p)) {
    says_ = status_channel;
    return encode(p, out);
  }
  HtfBins h;
  if (!bins_.try_pop(h)) return 0;
  says_ = htf_channel;
  return encode(h, out);
}

std::string who_am_i(std::string_view program) {
  std::array<char, 64> host{};
  if (::gethostname(host.data(), host.size() - 1) != 0) host = {'?'};
  return std::string(program) + "@" + host.data() + ":" + std::to_string(::getpid());
}

}  // namespace saltus
