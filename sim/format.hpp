// Numbers and words put together as printf does, for stories, notes and pages.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace saltus {

[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

std::string text(double x, const char* pattern = "%.4g");

// A unit as it follows a number: nothing for "1" and "-".
std::string after_number(std::string_view unit);

std::string listed(const std::vector<std::string>& names, std::string_view between = ", ");

}  // namespace saltus
