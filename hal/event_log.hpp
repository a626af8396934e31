// LCM event logs, as lcm-logger writes and lcm-logplayer, lcm-spy and `saltus log` read them: for each event
//   0xEDA1DA01, event number (8), time [us since 1970] (8), lengths of channel (4) and data (4), channel, data;
//   big-endian
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace saltus {

// A log that cannot be opened, read or written; the message is "FILE: what is wrong; how to mend it".
struct LogError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Hands every event to the kernel before write() returns: whatever happens to this process afterwards, the event is in
// the file. Used by one thread, and never the real-time one.
class EventLogWriter {
 public:
  // Begins a new log, or goes on at the end of one (behind its last whole event). Throws LogError.
  enum class Existing { replace, append };
  explicit EventLogWriter(const std::filesystem::path& path, Existing existing = Existing::replace);
  ~EventLogWriter();
  EventLogWriter(const EventLogWriter&) = delete;
  EventLogWriter& operator=(const EventLogWriter&) = delete;

  // False, and counted, when the event is not in the file, for want of room: the log then ends with the event before.
  bool write(std::string_view channel, std::span<const std::uint8_t> data) noexcept;                     // now
  bool write(std::int64_t time, std::string_view channel, std::span<const std::uint8_t> data) noexcept;  // [us]

  std::int64_t events() const noexcept { return events_; }
  std::int64_t failed() const noexcept { return failed_; }

 private:
  int file_ = -1;
  std::int64_t size_ = 0, events_ = 0, failed_ = 0;
  std::vector<std::uint8_t> buffer_;
};

struct LoggedEvent {
  std::int64_t number = 0;
  std::int64_t time = 0;  // [us] since 1970
  std::string channel;
  std::vector<std::uint8_t> data;
};

// Reads to the last whole event. A damaged stretch is skipped to the next event that follows from its neighbours.
class EventLogReader {
 public:
  explicit EventLogReader(const std::filesystem::path& path);  // throws LogError

  bool next(LoggedEvent& event);                                    // false at the end
  std::int64_t skipped() const noexcept { return skipped_; }  // [B] that are no event: damage, or an event cut off
  std::int64_t position() const noexcept { return static_cast<std::int64_t>(whole_); }  // [B] behind the last event

 private:
  std::vector<std::uint8_t> bytes_;
  std::size_t at_ = 0, whole_ = 0;
  std::int64_t skipped_ = 0;
};

}  // namespace saltus
