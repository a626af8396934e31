#include "hal/ring.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <thread>

#include "tests/support/catch.hpp"
#include "tests/support/malloc_guard.hpp"

using saltus::Ring;

namespace {

struct Message {
  std::int64_t number = 0;
  std::array<std::int64_t, 6> copies{};  // torn if they ever differ from the number

  static Message of(std::int64_t n) { return {n, {n, n, n, n, n, n}}; }
  bool whole() const {
    for (const std::int64_t c : copies)
      if (c != number) return false;
    return true;
  }
};

}  // namespace

TEST_CASE("a ring gives values back in order, holds its capacity and counts what it refuses") {
  Ring<int, 4> ring;
  int value = -1;
  CHECK_FALSE(ring.try_pop(value));
  CHECK(value == -1);
  for (int round = 0; round < 5; ++round) {  // the slots are used again and again
    for (int i = 0; i < 4; ++i) CHECK(ring.try_push(10 * round + i));
    CHECK_FALSE(ring.try_push(99));
    CHECK_FALSE(ring.try_push(99));
    CHECK(ring.dropped() == static_cast<std::size_t>(2 * round + 2));
    for (int i = 0; i < 4; ++i) {
      CHECK(ring.try_pop(value));
      CHECK(value == 10 * round + i);
    }
    CHECK_FALSE(ring.try_pop(value));
  }
}

TEST_CASE("a full ring has room again for exactly as many as were popped") {
  Ring<int, 8> ring;
  int pushed = 0;
  int popped = 0;
  while (ring.try_push(pushed)) ++pushed;
  CHECK(pushed == 8);
  for (int take = 1; take <= 8; ++take) {
    int value = -1;
    for (int i = 0; i < take; ++i, ++popped) {
      CHECK(ring.try_pop(value));
      CHECK(value == popped);
    }
    int room = 0;
    for (; ring.try_push(pushed); ++pushed) ++room;
    CHECK(room == take);
  }
}

TEST_CASE("the smallest ring holds one value") {
  Ring<char, 1> ring;
  char value = ' ';
  CHECK(ring.try_push('a'));
  CHECK_FALSE(ring.try_push('b'));
  CHECK(ring.try_pop(value));
  CHECK(value == 'a');
  CHECK_FALSE(ring.try_pop(value));
}

TEST_CASE("a ring does not allocate and does not throw") {
  const saltus::test::AllocationCount allocated;
  Ring<Message, 16> ring;
  Message message;
  bool all = true;
  for (std::int64_t i = 0; i < 1000; ++i) all = all && ring.try_push(Message::of(i)) && ring.try_pop(message);
  CHECK(all);
  CHECK(allocated() == 0);
  STATIC_REQUIRE(noexcept(ring.try_push(message)));
  STATIC_REQUIRE(noexcept(ring.try_pop(message)));
  STATIC_REQUIRE(alignof(Ring<Message, 16>) == 64);
}

TEST_CASE("between two threads nothing is lost, torn or out of order") {
  constexpr std::int64_t count = 100'000;
  Ring<Message, 64> ring;
  std::int64_t torn = 0;
  std::int64_t out_of_order = 0;
  std::size_t refused = 0;
  std::thread consumer([&] {
    Message message;
    for (std::int64_t expected = 0; expected < count;) {
      if (!ring.try_pop(message)) {
        std::this_thread::yield();
        continue;
      }
      torn += message.whole() ? 0 : 1;
      out_of_order += message.number == expected ? 0 : 1;
      ++expected;
    }
  });
  for (std::int64_t i = 0; i < count;) {
    if (ring.try_push(Message::of(i))) {
      ++i;
    } else {
      ++refused;
      std::this_thread::yield();
    }
  }
  consumer.join();
  CHECK(torn == 0);
  CHECK(out_of_order == 0);
  CHECK(ring.dropped() == refused);
}

TEST_CASE("a producer that does not wait loses exactly the values counted as dropped") {
  constexpr std::int64_t count = 100'000;
  Ring<Message, 8> ring;
  std::int64_t received = 0;
  std::int64_t not_rising = 0;
  std::thread consumer([&] {
    Message message;
    for (std::int64_t last = -1; last != count;) {  // the last message is sent until it is taken
      if (!ring.try_pop(message)) {
        std::this_thread::yield();
        continue;
      }
      not_rising += message.number > last ? 0 : 1;
      last = message.number;
      ++received;
    }
  });
  for (std::int64_t i = 0; i < count; ++i) (void)ring.try_push(Message::of(i));
  const std::size_t dropped = ring.dropped();
  while (!ring.try_push(Message::of(count))) std::this_thread::yield();
  consumer.join();
  CHECK(not_rising == 0);
  CHECK(received + static_cast<std::int64_t>(dropped) == count + 1);
}
