// What an image has to say: lines of text without stdio, and a hash.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <cstdio>
#include <string_view>

namespace board {

// A line of text, printed when it is complete.
class Line {
 public:
  Line& operator<<(std::string_view text) noexcept {
    for (const char c : text) put(c);
    return *this;
  }
  // 0 and above.
  Line& operator<<(std::int64_t x) noexcept {
    if (x >= 10) *this << x / 10;
    put(static_cast<char>('0' + x % 10));
    return *this;
  }
  Line& hex(std::uint64_t x) noexcept {
    for (int shift = 60; shift >= 0; shift -= 4) put("0123456789abcdef"[x >> shift & 15]);
    return *this;
  }
  ~Line() { std::puts(text_.data()); }

 private:
  void put(char c) noexcept {
    if (n_ + 1 < text_.size()) text_[n_++] = c;
  }
  std::array<char, 128> text_{};
  std::size_t n_ = 0;
};

// FNV-1a over the bytes of numbers.
class Hash {
 public:
  void add(double x) noexcept {
    for (int i = 0; i < 64; i += 8) sum_ = (sum_ ^ (std::bit_cast<std::uint64_t>(x) >> i & 0xff)) * 0x100000001b3;
  }
  // All lines of an estimator, tone by tone.
  void add_lines(const auto& estimator, int tones, int harmonics, int outputs) noexcept {
    for (int k = 0; k < tones; ++k) {
      for (int l = -harmonics; l <= harmonics; ++l) {
        for (int c = 0; c < outputs; ++c) {
          const auto line = estimator.line(k, l, c);
          add(line.real());
          add(line.imag());
        }
      }
    }
  }
  std::uint64_t sum() const noexcept { return sum_; }

 private:
  std::uint64_t sum_ = 0xcbf29ce484222325;
};

}  // namespace board
