#include "program.hpp"

#include <unistd.h>

#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>

namespace saltus::program {

void ModelChoice::add_to(CLI::App& command) {
  command.add_option("MODEL", name, "the model: " + known_models())->required();
  command.add_option("--set", settings, "NAME=VALUE: set a parameter of the model, in its SI unit; may be repeated")
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
  command.add_option("--ticks", ticks, "steps of the integrator a cycle, a multiple of 32")
      ->check(CLI::Range(std::int64_t{32}, std::int64_t{1} << 20))
      ->check([](const std::string& text) {
        return std::stoll(text) % 32 == 0 ? std::string{} : text + " is not a multiple of 32";
      })
      ->capture_default_str();
}

Setting parse_setting(const std::string& text, const char* option) {
  const auto equals = text.find('=');
  const auto usage = [&](const std::string& why) {
    return UsageError(std::string(option) + " " + text + ": " + why + "; write NAME=VALUE, for example k=9.8");
  };
  if (equals == std::string::npos || equals == 0) throw usage("there is no NAME= in it");
  Setting s{text.substr(0, equals), 0.0};
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data() + equals + 1, end, s.value);
  if (error != std::errc{} || stop != end || !std::isfinite(s.value)) throw usage("the value is not a finite number");
  return s;
}

void write_text(const std::string& path, const std::string& text) {
  if (path == "-") {
    std::cout << text << std::flush;
    return;
  }
  const std::string beside = path + ".part";
  std::ofstream out(beside, std::ios::binary);
  out << text;
  out.close();
  std::error_code error;
  if (out) std::filesystem::rename(beside, path, error);
  if (!out || error) {
    std::error_code ignored;
    std::filesystem::remove(beside, ignored);
    throw RunError(path + ": cannot be written; choose a folder that exists and may be written to");
  }
}

Progress::Progress(std::string what) : what_(std::move(what)), terminal_(isatty(STDERR_FILENO) != 0) {}
Progress::~Progress() {
  if (shown_) std::fprintf(stderr, "\r\033[K");
}
void Progress::at(double fraction) {
  const int percent = static_cast<int>(100.0 * fraction);
  if (!terminal_ || percent == last_) return;
  std::fprintf(stderr, "\r%s %3d %%", what_.c_str(), percent);
  last_ = percent;
  shown_ = true;
}

std::string number(double x, const char* format) {
  char text[64];
  std::snprintf(text, sizeof text, format, x);
  return text;
}
std::string complex_number(double re, double im, int digits) {
  char text[96];
  if (im == 0.0) {
    std::snprintf(text, sizeof text, "%.*f", digits, re);
  } else {
    std::snprintf(text, sizeof text, "%.*f %c %.*fi", digits, re, im < 0.0 ? '-' : '+', digits, std::abs(im));
  }
  return text;
}

}  // namespace saltus::program
