#include "program.hpp"

#include <unistd.h>

#include <charconv>
#include <cmath>
#include <cstdio>

#include "../report/write_file.hpp"

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

bool check_outputs(std::initializer_list<OutputFile> files) {
  const char* taken = nullptr;
  for (const auto& [option, path] : files) {
    if (path == "-") {
      if (taken != nullptr) {
        throw UsageError(std::string(option) + " -: " + taken + " goes to standard output already; name a file");
      }
      taken = option;
    } else if (!path.empty()) {
      check_writable(path);
    }
  }
  return taken != nullptr;
}

void write_text(const std::string& path, const std::string& text) {
  if (path == "-") {
    std::fwrite(text.data(), 1, text.size(), stdout);  // main() sees whether it arrived
  } else {
    write_file(path, text);
  }
}

void write_json(const std::string& path, const nlohmann::json& j) {
  write_text(path, j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
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
