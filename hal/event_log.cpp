#include "event_log.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <fstream>
#include <iterator>

namespace saltus {
namespace {

constexpr std::uint32_t magic = 0xEDA1DA01;
constexpr std::size_t head_size = 28;
constexpr std::uint32_t longest_channel = 256, largest_data = 1u << 28;  // [B] beyond which a length is damage

template <class Unsigned>
void put(std::uint8_t* at, Unsigned value) noexcept {
  for (std::size_t i = 0; i < sizeof value; ++i) at[sizeof value - 1 - i] = static_cast<std::uint8_t>(value >> (8 * i));
}
template <class Unsigned>
Unsigned get(const std::uint8_t* at) noexcept {
  Unsigned value = 0;
  for (std::size_t i = 0; i < sizeof value; ++i) value = static_cast<Unsigned>(value << 8) | at[i];
  return value;
}

bool holds_magic(std::span<const std::uint8_t> bytes) noexcept {
  std::array<std::uint8_t, 4> word{};
  put(word.data(), magic);
  return std::search(bytes.begin(), bytes.end(), word.begin(), word.end()) != bytes.end();
}

[[noreturn]] void refuse(const std::filesystem::path& path, const std::string& why, const std::string& mend) {
  throw LogError(path.string() + ": " + why + "; " + mend);
}

}  // namespace

EventLogWriter::EventLogWriter(const std::filesystem::path& path, Existing existing) : buffer_(2048) {
  std::error_code ignored;
  if (existing == Existing::append && std::filesystem::exists(path, ignored)) {
    EventLogReader old(path);
    LoggedEvent event;
    while (old.next(event)) events_ = event.number + 1;
    size_ = old.position();
  }
  const int fresh = existing == Existing::replace ? O_TRUNC : 0;
  file_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | fresh, 0666);
  if (file_ < 0 || (existing == Existing::append && ::ftruncate(file_, size_) != 0)) {
    const std::string why = std::strerror(errno);
    if (file_ >= 0) ::close(file_);
    refuse(path, "the log cannot be written (" + why + ")", "check the folder, its rights and its room");
  }
}

EventLogWriter::~EventLogWriter() { ::close(file_); }

bool EventLogWriter::write(std::string_view channel, std::span<const std::uint8_t> data) noexcept {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return write(std::chrono::duration_cast<std::chrono::microseconds>(now).count(), channel, data);
}

bool EventLogWriter::write(std::int64_t time, std::string_view channel, std::span<const std::uint8_t> data) noexcept {
  const std::size_t size = head_size + channel.size() + data.size();
  if (size > buffer_.size()) {
    try {
      buffer_.resize(size);
    } catch (...) {
      ++failed_;
      return false;
    }
  }
  std::uint8_t* const b = buffer_.data();
  put(b, magic);
  put(b + 4, static_cast<std::uint64_t>(events_));
  put(b + 12, static_cast<std::uint64_t>(time));
  put(b + 20, static_cast<std::uint32_t>(channel.size()));
  put(b + 24, static_cast<std::uint32_t>(data.size()));
  std::copy(channel.begin(), channel.end(), b + head_size);
  std::copy(data.begin(), data.end(), b + head_size + channel.size());
  for (std::size_t done = 0; done < size;) {
    const ssize_t n = ::pwrite(file_, b + done, size - done, size_ + static_cast<off_t>(done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      ++failed_;
      if (::ftruncate(file_, size_) != 0) return false;  // the reader skips what is left of it
      return false;
    }
    done += static_cast<std::size_t>(n);
  }
  size_ += static_cast<std::int64_t>(size);
  ++events_;
  return true;
}

EventLogReader::EventLogReader(const std::filesystem::path& path) {
  std::error_code fault;
  if (std::filesystem::is_directory(path, fault)) refuse(path, "this is a folder", "name the log in it");
  std::ifstream in(path, std::ios::binary);
  if (!in) refuse(path, "the log cannot be read", "check its name and rights");
  bytes_.assign(std::istreambuf_iterator<char>(in), {});
  if (in.bad()) refuse(path, "the log cannot be read to its end", "check the disk");
}

bool EventLogReader::next(LoggedEvent& event) {
  while (at_ + head_size <= bytes_.size()) {
    const std::uint8_t* const b = bytes_.data() + at_;
    const auto channel = get<std::uint32_t>(b + 20), data = get<std::uint32_t>(b + 24);
    if (get<std::uint32_t>(b) == magic && channel > 0 && channel <= longest_channel && data <= largest_data &&
        std::size_t{channel} + data <= bytes_.size() - at_ - head_size) {
      const std::uint8_t* const text = b + head_size;
      const std::size_t end = at_ + head_size + channel + data;
      // Where nothing follows it, this is the last event, or the next one is damaged; or a length of this one is, and
      // then what it claims for itself holds the beginning of another.
      const bool followed =
          end == bytes_.size() || (end + 4 <= bytes_.size() && get<std::uint32_t>(bytes_.data() + end) == magic);
      if (followed || !holds_magic({text, std::size_t{channel} + data})) {
        event.number = static_cast<std::int64_t>(get<std::uint64_t>(b + 4));
        event.time = static_cast<std::int64_t>(get<std::uint64_t>(b + 12));
        event.channel.assign(reinterpret_cast<const char*>(text), channel);
        event.data.assign(text + channel, text + channel + data);
        at_ = whole_ = end;
        return true;
      }
    }
    ++at_;
    ++skipped_;
  }
  skipped_ += static_cast<std::int64_t>(bytes_.size() - at_);
  at_ = bytes_.size();
  return false;
}

}  // namespace saltus
