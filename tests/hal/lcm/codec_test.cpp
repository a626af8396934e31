#include "hal/lcm/codec.hpp"

#include <limits>

#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

using Bytes = std::array<std::uint8_t, largest_message>;

Stimulus<1> stimulus() {
  Stimulus<1> s;
  s.session = 0x1122334455667788;
  s.seq = 5;
  s.tick = 4;
  s.u = {-1.5e-3};
  s.experiment = 3;
  s.sent = 9;
  return s;
}
Measurement<2> measurement() { return {7, 5, 5, {0.1, -2.0}, Status::grazing, Answer::measured, 42, 6}; }

// Every damage of `size` good bytes must be found.
template <class Message>
void check_damage(const Bytes& good, std::size_t size) {
  Message m;
  for (std::size_t bit = 0; bit < 8 * size; ++bit) {
    Bytes b = good;
    b[bit / 8] = static_cast<std::uint8_t>(b[bit / 8] ^ (1u << bit % 8));
    CHECK_FALSE(decode(std::span(b).first(size), m).good);
  }
  for (std::size_t at = 0; at + 4 <= size; ++at) {
    Bytes b = good;
    for (std::size_t i = at; i < at + 4; ++i) b[i] = static_cast<std::uint8_t>(~b[i]);
    CHECK_FALSE(decode(std::span(b).first(size), m).good);
  }
  for (std::size_t other = 0; other <= size + 20; ++other) {
    if (other == size) continue;
    const Decoded d = decode(std::span(good).first(other), m);
    CHECK_FALSE(d.good);
    CHECK(d.fault == Fault::length);
  }
}

}  // namespace

TEST_CASE("messages come back as they were, and fit a frame") {
  Bytes b{};
  const Stimulus<1> s = stimulus();
  std::size_t size = encode(s, b);
  CHECK(size == 124);
  Stimulus<1> s2;
  CHECK(decode(std::span(b).first(size), s2).good);
  CHECK((s2.session == s.session && s2.seq == s.seq && s2.tick == s.tick && s2.u == s.u && s2.order == s.order));
  CHECK((s2.experiment == s.experiment && s2.sent == s.sent));

  const Measurement<2> m = measurement();
  size = encode(m, b);
  CHECK(size == 196);
  Measurement<2> m2;
  CHECK(decode(std::span(b).first(size), m2).good);
  CHECK((m2.session == m.session && m2.seq == m.seq && m2.tick == m.tick && m2.y == m.y && m2.status == m.status));
  CHECK((m2.answer == m.answer && m2.machine == m.machine && m2.sent == m.sent));

  HtfBins h;
  h.tones = HtfBins::capacity;
  h.line[63] = 99;
  h.value[63] = {1.0, -2.0};
  size = encode(h, b);
  CHECK(size > 0);
  CHECK(size <= largest_message);
  HtfBins h2;
  CHECK(decode(std::span(b).first(size), h2).good);
  CHECK((h2.tones == h.tones && h2.line == h.line && h2.value == h.value));

  Presence p;
  p.who = std::string_view("rig@here:1\x1b[2J");
  p.faults[10] = 8;
  size = encode(p, b);
  CHECK(size > 0);
  Presence p2;
  CHECK(decode(std::span(b).first(size), p2).good);
  CHECK(p2.who.view() == "rig@here:1?[2J");  // nothing that a terminal would obey
  CHECK(p2.faults == p.faults);
}

TEST_CASE("every flipped bit, every burst of four bytes and every wrong length is found") {
  Bytes b{};
  std::size_t size = encode(stimulus(), b);
  check_damage<Stimulus<1>>(b, size);
  size = encode(measurement(), b);
  check_damage<Measurement<2>>(b, size);
}

TEST_CASE("the checks have their order: length, fingerprint, checksum, kind") {
  Bytes b{};
  const std::size_t size = encode(stimulus(), b);
  Stimulus<1> s;
  const auto fault = [&](const Bytes& bytes, std::size_t n) { return decode(std::span(bytes).first(n), s).fault; };
  Bytes bad = b;
  bad[0] ^= 1;  // fingerprint
  bad[60] ^= 1;
  CHECK(fault(bad, size - 1) == Fault::length);
  CHECK(fault(bad, size) == Fault::fingerprint);
  bad[0] ^= 1;
  CHECK(fault(bad, size) == Fault::checksum);
  CHECK(fault(Bytes{}, size) == Fault::fingerprint);
  CHECK(fault(Bytes{}, 0) == Fault::length);

  // Well made, but not for this conversation: another number of channels.
  Stimulus<2> two;
  const std::size_t n = encode(two, b);
  CHECK(fault(b, n) == Fault::kind);
  // A measurement where a stimulus should be has another length here; a type of equal fields has another kind.
  CHECK(fault(b, encode(measurement(), b)) == Fault::length);
}

TEST_CASE("without the checksum a flipped bit in a value passes: what it is there for") {
  Bytes b{};
  const std::size_t size = encode(stimulus(), b);
  b[size - 4 - 8 * max_inputs + 1] ^= 1;
  Stimulus<1> s;
  CHECK_FALSE(decode(std::span(b).first(size), s).good);
  CHECK(decode(std::span(b).first(size), s, Checksum::ignored).good);
  CHECK(s.u != stimulus().u);
}
