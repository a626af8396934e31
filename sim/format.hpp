// Numbers and words put together as printf does, for stories, notes and pages.
#pragma once

#include <string>

namespace saltus {

[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...);

std::string text(double x, const char* pattern = "%.4g");

}  // namespace saltus
