// Publishes what this side has to say to whoever watches, and remembers who else is there.
#pragma once

#include <mutex>

#include "bus.hpp"

namespace saltus {

class NoticeBoard final : public Port {
 public:
  explicit NoticeBoard(Bus& bus);
  ~NoticeBoard() override { bus_->stop(); }
  NoticeBoard(const NoticeBoard&) = delete;
  NoticeBoard& operator=(const NoticeBoard&) = delete;

  // Wait-free; false, and not published, where there is no room.
  bool post(const Presence& p) noexcept;
  bool post(const HtfBins& h) noexcept;
  std::int64_t dropped() const noexcept { return static_cast<std::int64_t>(bins_.dropped()); }  // estimates

  // Others, as they last said of themselves. Not for the real-time thread: takes a lock.
  struct Neighbour {
    Presence presence;
    std::int64_t heard = 0;  // [ns] steady
  };
  std::vector<Neighbour> neighbours() const;
  std::optional<Presence> find(std::int64_t id) const;

  std::string_view hears() const noexcept override { return status_channel; }
  std::string_view says() const noexcept override { return says_; }
  void heard(std::string_view, std::span<const std::uint8_t> bytes) noexcept override;
  std::size_t next(std::span<std::uint8_t> out) noexcept override;

 private:
  Bus* bus_;
  std::string_view says_ = status_channel;
  Ring<Presence, 16> presence_;
  Ring<HtfBins, 256> bins_;
  std::atomic<std::int64_t> own_{0};
  mutable std::mutex mutex_;
  std::array<Neighbour, 8> neighbours_{};  // the longest silent one makes room
};

// "rig@host:1234", for Presence::who.
std::string who_am_i(std::string_view program);

}  // namespace saltus
