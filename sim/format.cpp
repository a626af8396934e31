#include "format.hpp"

#include <cstdarg>
#include <cstdio>

namespace saltus {

std::string format(const char* pattern, ...) {
  va_list list, again;
  va_start(list, pattern);
  va_copy(again, list);
  const int length = std::vsnprintf(nullptr, 0, pattern, list);
  va_end(list);
  std::string s(length > 0 ? static_cast<std::size_t>(length) : 0, '\0');
  if (length > 0) std::vsnprintf(s.data(), s.size() + 1, pattern, again);
  va_end(again);
  return s;
}

std::string text(double x, const char* pattern) { return format(pattern, x); }

std::string after_number(std::string_view unit) {
  return unit.empty() || unit == "1" || unit == "-" ? std::string() : " " + std::string(unit);
}

std::string listed(const std::vector<std::string>& names, std::string_view between) {
  std::string s;
  for (const std::string& n : names) {
    if (!s.empty()) s += between;
    s += n;
  }
  return s;
}

}  // namespace saltus
