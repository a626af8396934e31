#include "record_text.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <utility>

#include "record.hpp"

namespace saltus::record_text {
namespace {

constexpr std::size_t longest_line = 65536;  // [B]
constexpr std::string_view text_mend = "save the file as UTF-8 text with LF or CRLF line ends";

// Offset of the first byte that is neither printable ASCII, a tab, nor part of well-formed UTF-8.
std::size_t garbled(std::string_view s) {
  const auto byte = [s](std::size_t i) { return static_cast<std::uint32_t>(static_cast<unsigned char>(s[i])); };
  constexpr std::array<std::uint32_t, 4> smallest{0, 0x80, 0x800, 0x10000};  // code point by number of further bytes
  constexpr std::array<std::uint32_t, 4> lead_bits{0x7F, 0x1F, 0x0F, 0x07};
  for (std::size_t i = 0; i < s.size();) {
    const std::uint32_t lead = byte(i);
    if ((lead < 0x20 && lead != '\t') || lead == 0x7F || (lead >= 0x80 && lead < 0xC2) || lead > 0xF4) return i;
    const std::size_t further = lead < 0x80 ? 0 : lead < 0xE0 ? 1 : lead < 0xF0 ? 2 : 3;
    if (s.size() - i <= further) return i;
    std::uint32_t code = lead & lead_bits[further];
    for (std::size_t k = 1; k <= further; ++k) {
      if ((byte(i + k) & 0xC0) != 0x80) return i;
      code = code << 6 | (byte(i + k) & 0x3F);
    }
    if (code < smallest[further] || code > 0x10FFFF || (code >= 0xD800 && code < 0xE000)) return i;
    i += further + 1;
  }
  return s.npos;
}

// Letters to change, add or remove to make one name of the other.
std::size_t edits(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t changed = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({row[j] + 1, row[j + 1] + 1, changed});
    }
  }
  return row[b.size()];
}

}  // namespace

Lines::Lines(std::istream& in, std::string file) : in_(in.rdbuf()), file_(std::move(file)), buffer_(longest_line + 2) {}

bool Lines::next() {
  in_.getline(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
  const auto got = static_cast<std::size_t>(in_.gcount());
  if (in_.bad())
    refuse(Place{line_number_ + 1, 1}, "the file cannot be read on", "check the disk and what the path is");
  if (got == 0 && in_.eof()) return false;
  ++line_number_;
  bytes_ += got;
  line_ = std::string_view(buffer_.data(), in_.good() ? got - 1 : got);
  if (line_number_ == 1 && line_.substr(0, 3) == "\xEF\xBB\xBF") line_.remove_prefix(3);
  if (!line_.empty() && line_.back() == '\r') line_.remove_suffix(1);
  if (const auto zero = line_.find('\0'); zero != line_.npos) {
    refuse(line_.substr(zero), "a zero byte: this is not text",
           std::string(text_mend) + "; `saltus log` converts an LCM event log");
  }
  if (line_.size() > longest_line) {
    refuse(line_.substr(longest_line), "the line is longer than 64 kB", "write one row a line, ended by LF or CRLF");
  }
  if (const auto bad = garbled(line_); bad != line_.npos) {
    refuse(line_.substr(bad), "a byte that is neither printable nor UTF-8", text_mend);
  }
  if (bytes_ > largest_file) refuse(line_, "the file is larger than 2 GB", "split it by experiment");
  return true;
}

void Lines::split(std::vector<std::string_view>& cells) const {
  cells.clear();
  for (std::size_t from = 0;;) {
    const auto comma = line_.find(',', from);
    cells.push_back(trim(line_.substr(from, comma - from)));
    if (comma == line_.npos) return;
    from = comma + 1;
  }
}

Place Lines::place(std::string_view at) const {
  return {line_number_, static_cast<std::size_t>(at.data() - line_.data()) + 1};
}

void Lines::refuse(Place at, std::string_view what, std::string_view mend) const {
  throw RecordError(file_, at.line, at.column, what, mend);
}

std::string_view trim(std::string_view s) {
  const auto first = s.find_first_not_of(" \t");
  return first == s.npos ? s.substr(s.size()) : s.substr(first, s.find_last_not_of(" \t") - first + 1);
}

std::string lower(std::string_view s) {
  std::string out(s);
  for (char& c : out) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return out;
}

std::string excerpt(std::string_view s) {
  constexpr std::size_t longest = 40;
  std::string out("`");
  out.append(s.substr(0, longest)).append(s.size() > longest ? "...`" : "`");
  for (char& c : out) c = static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) > 0x7E ? '?' : c;
  return out;
}

std::string joined(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
  return out;
}

std::optional<double> number(std::string_view cell) {
  if (cell.empty()) return std::numeric_limits<double>::quiet_NaN();
  if (cell.size() > 1 && cell[0] == '+' && cell[1] != '-') cell.remove_prefix(1);
  double value = 0.0;
  const char* const end = cell.data() + cell.size();
  const auto [stop, fault] = std::from_chars(cell.data(), end, value);
  if (fault != std::errc{} || stop != end || std::isinf(value)) return {};
  return value;
}

std::optional<int> whole(std::string_view cell, int low, int high) {
  const std::optional<double> value = number(cell);
  if (!value || !(*value >= low && *value <= high) || *value != std::floor(*value)) return {};
  return static_cast<int>(*value);
}

const std::string& nearest(std::string_view written, const std::vector<std::string>& names) {
  const std::string small = lower(written);
  return *std::min_element(names.begin(), names.end(), [&](const std::string& a, const std::string& b) {
    return edits(small, lower(a)) < edits(small, lower(b));
  });
}

}  // namespace saltus::record_text
