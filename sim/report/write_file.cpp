#include "write_file.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace saltus {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const std::string& path, const std::string& why) {
  throw std::runtime_error(path + ": the file cannot be written (" + why +
                           "); choose a folder that exists and may be written to");
}

// The file itself, behind symbolic links.
fs::path target_of(const std::string& path) {
  std::error_code fault;
  const fs::path target = fs::weakly_canonical(fs::absolute(path, fault), fault);
  if (fault) refuse(path, fault.message());
  return target;
}

// Such as a device or a pipe: there is nothing to replace.
bool in_place(const fs::path& target) {
  std::error_code ignored;
  const fs::file_status status = fs::status(target, ignored);
  return fs::exists(status) && !fs::is_regular_file(status);
}

}  // namespace

void check_writable(const std::string& path) {
  const fs::path target = target_of(path);
  std::error_code ignored;
  if (fs::is_directory(target, ignored)) refuse(path, "this is a folder");
  const bool direct = in_place(target);
  if (!direct && !fs::is_directory(target.parent_path(), ignored)) refuse(path, "there is no such folder");
  const fs::path place = direct ? target : target.parent_path();
  if (::access(place.c_str(), W_OK) != 0) refuse(path, std::strerror(errno));
}

void write_file(const std::string& path, const std::string& text) {
  check_writable(path);
  const fs::path target = target_of(path);
  const bool direct = in_place(target);
  const fs::path partial = direct ? target : fs::path(target.string() + "." + std::to_string(::getpid()) + ".part");
  errno = 0;
  std::ofstream out(partial, std::ios::binary);
  out << text;
  out.close();
  std::error_code fault(out ? 0 : errno != 0 ? errno : EIO, std::generic_category());
  if (!fault && !direct) fs::rename(partial, target, fault);
  if (!fault) return;
  std::error_code ignored;
  if (!direct) fs::remove(partial, ignored);
  refuse(path, fault.message());
}

}  // namespace saltus
