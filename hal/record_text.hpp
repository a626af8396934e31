// The text under a record: lines, cells and numbers, with their places for messages. Only the files record*.cpp use it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <istream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace saltus::record_text {

inline constexpr std::uintmax_t largest_file = 2'000'000'000;  // [B]

struct Place {
  std::size_t line = 0;    // from 1
  std::size_t column = 0;  // [B] from 1
};

// A stream as lines of UTF-8 text. Throws RecordError where it is none, or is of an absurd size.
class Lines {
 public:
  Lines(std::istream& in, std::string file);

  bool next();                                                  // false at the end
  std::string_view text() const noexcept { return line_; }      // without its line end; valid until next()
  std::size_t number() const noexcept { return line_number_; }  // of the present line, from 1; 0 before the first
  void split(std::vector<std::string_view>& cells) const;       // the present line at its commas, without spaces around
  Place place(std::string_view at) const;                       // of a piece of the present line
  const std::string& file() const noexcept { return file_; }

  [[noreturn]] void refuse(Place at, std::string_view what, std::string_view mend) const;
  [[noreturn]] void refuse(std::string_view at, std::string_view what, std::string_view mend) const {
    refuse(place(at), what, mend);
  }

 private:
  std::istream in_;  // on the caller's buffer, but a stream of our own: the caller's may throw
  std::string file_;
  std::vector<char> buffer_;
  std::string_view line_;
  std::size_t line_number_ = 0;
  std::uintmax_t bytes_ = 0;
};

std::string_view trim(std::string_view s);  // without the spaces and tabs around it
std::string lower(std::string_view s);      // ASCII letters only
std::string excerpt(std::string_view s);    // what stood in the file, made fit for a message
std::string joined(const std::vector<std::string>& names);

// The number in a cell: NaN where it is empty or `nan`; nothing where it is not a finite number.
std::optional<double> number(std::string_view cell);

// The whole number in a cell, if it is one from low to high. `3.0` is one: a table with gaps is often written so.
std::optional<int> whole(std::string_view cell, int low, int high);

// The one of `names` (not empty) that is nearest to what was written, in letters to change.
const std::string& nearest(std::string_view written, const std::vector<std::string>& names);

}  // namespace saltus::record_text
