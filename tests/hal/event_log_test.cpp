#include "hal/event_log.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <iterator>

#include "tests/support/catch.hpp"

using namespace saltus;
namespace fs = std::filesystem;

namespace {

struct Scratch {
  fs::path path = fs::temp_directory_path() / ("saltus_log_" + std::to_string(::getpid()) + ".lcm");
  ~Scratch() { fs::remove(path); }
};

std::vector<std::uint8_t> payload(int i) {
  return std::vector<std::uint8_t>(static_cast<std::size_t>(10 + i % 50), static_cast<std::uint8_t>(i));
}

std::vector<LoggedEvent> read_all(const fs::path& path, std::int64_t* skipped = nullptr) {
  EventLogReader reader(path);
  std::vector<LoggedEvent> all;
  for (LoggedEvent e; reader.next(e);) all.push_back(e);
  if (skipped != nullptr) *skipped = reader.skipped();
  return all;
}

std::vector<char> bytes_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}
void set_bytes(const fs::path& path, const std::vector<char>& bytes) {
  std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

}  // namespace

TEST_CASE("a log gives back its events, and its bytes are those of LCM's format") {
  const Scratch s;
  {
    EventLogWriter log(s.path);
    const std::array<std::uint8_t, 3> data{1, 2, 3};
    CHECK(log.write(0x0102030405060708, "AB", data));
    CHECK(log.events() == 1);
  }
  const std::vector<char> expected{'\xED', '\xA1', '\xDA', 1, 0, 0, 0, 0, 0, 0, 0, 0,   1,   2, 3, 4, 5,
                                   6,      7,      8,      0, 0, 0, 2, 0, 0, 0, 3, 'A', 'B', 1, 2, 3};
  CHECK(bytes_of(s.path) == expected);
  const auto events = read_all(s.path);
  REQUIRE(events.size() == 1);
  CHECK(events[0].number == 0);
  CHECK(events[0].time == 0x0102030405060708);
  CHECK(events[0].channel == "AB");
  CHECK(events[0].data == std::vector<std::uint8_t>{1, 2, 3});
}

TEST_CASE("a log that was cut off is read to its last whole event, and can be gone on with") {
  const Scratch s;
  {
    EventLogWriter log(s.path);
    for (int i = 0; i < 100; ++i) CHECK(log.write("CHANNEL", payload(i)));
  }
  const auto size = fs::file_size(s.path);
  for (const std::uintmax_t cut : {1u, 20u, 40u, 60u}) {
    fs::resize_file(s.path, size - cut);
    std::int64_t skipped = 0;
    const auto events = read_all(s.path, &skipped);
    CHECK(events.size() == 99);
    CHECK(events.back().data == payload(98));
    CHECK(skipped > 0);
  }
  {
    EventLogWriter log(s.path, EventLogWriter::Existing::append);
    CHECK(log.events() == 99);
    CHECK(log.write("CHANNEL", payload(99)));
  }
  const auto events = read_all(s.path);
  REQUIRE(events.size() == 100);
  for (int i = 0; i < 100; ++i) {
    CHECK(events[static_cast<std::size_t>(i)].number == i);
    CHECK(events[static_cast<std::size_t>(i)].data == payload(i));
  }
}

TEST_CASE("one damaged byte costs at most one event, wherever it is") {
  const Scratch s;
  {
    EventLogWriter log(s.path);
    for (int i = 0; i < 5; ++i) CHECK(log.write("CHANNEL", payload(i)));
  }
  const std::vector<char> whole = bytes_of(s.path);
  for (std::size_t i = 0; i < whole.size(); ++i) {
    std::vector<char> damaged = whole;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x40);
    set_bytes(s.path, damaged);
    const auto events = read_all(s.path);
    CHECK(events.size() >= 4);
    int intact = 0;
    for (const LoggedEvent& e : events) {
      if (e.number >= 0 && e.number < 5 && e.data == payload(static_cast<int>(e.number))) ++intact;
    }
    CHECK(intact >= 4);
  }
}

TEST_CASE("what was written before a process is killed is in the log") {
  const Scratch s;
  int told[2];
  REQUIRE(::pipe(told) == 0);
  const pid_t child = ::fork();
  if (child == 0) {
    EventLogWriter log(s.path);
    for (int i = 0;; ++i) {
      if (log.write("CHANNEL", payload(i)) && ::write(told[1], &i, sizeof i) != sizeof i) ::_exit(1);
    }
  }
  ::close(told[1]);
  int last = -1;
  for (int i = 0; i < 3000 && ::read(told[0], &last, sizeof last) == sizeof last; ++i) {
  }
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  while (::read(told[0], &last, sizeof last) == sizeof last) {
  }
  ::close(told[0]);
  const auto events = read_all(s.path);
  CHECK(events.size() >= static_cast<std::size_t>(last + 1));
  for (std::size_t i = 0; i < events.size(); ++i) CHECK(events[i].data == payload(static_cast<int>(i)));
}

TEST_CASE("a log that cannot be had says which and what to do, and a full disk costs no event that was written") {
  CHECK_THROWS_AS(EventLogReader("/nowhere/x.lcm"), LogError);
  CHECK_THROWS_AS(EventLogReader("/"), LogError);
  CHECK_THROWS_AS(EventLogWriter("/nowhere/x.lcm"), LogError);
  if (fs::exists("/dev/full")) {
    EventLogWriter log("/dev/full");
    CHECK_FALSE(log.write("CHANNEL", payload(0)));
    CHECK(log.failed() == 1);
    CHECK(log.events() == 0);
  }
}
