#include "sim/report/write_file.hpp"

#include <filesystem>
#include <stdexcept>

#include "tests/support/catch.hpp"
#include "tests/support/program.hpp"

using namespace saltus;
using saltus::test::Folder;

namespace {

std::string refusal(const std::string& path) {
  std::string early, late;
  try {
    check_writable(path);
  } catch (const std::runtime_error& e) {
    early = e.what();
  }
  try {
    write_file(path, "text\n");
  } catch (const std::runtime_error& e) {
    late = e.what();
  }
  CHECK(early == late);
  return late;
}

}  // namespace

TEST_CASE("A file is written whole, over what was there, and nothing stays beside it") {
  const Folder folder;
  const std::string path = folder.path("x.csv").string();
  write_file(path, "first, and longer\n");
  write_file(path, "second\n");
  CHECK(folder.read("x.csv") == "second\n");
  write_file(path, "");
  CHECK(folder.read("x.csv").empty());
  const std::string bytes("\0\xff\r\n", 4);
  write_file(path, bytes);
  CHECK(folder.read("x.csv") == bytes);
  CHECK(folder.files() == std::vector<std::string>{"x.csv"});
}

TEST_CASE("A symbolic link stays one, and its target is written") {
  const Folder folder;
  folder.write("target.csv", "old\n");
  std::filesystem::create_symlink("target.csv", folder.path("link.csv"));
  write_file(folder.path("link.csv").string(), "new\n");
  CHECK(std::filesystem::is_symlink(folder.path("link.csv")));
  CHECK(folder.read("target.csv") == "new\n");
  CHECK(folder.files() == std::vector<std::string>{"link.csv", "target.csv"});
}

TEST_CASE("A device is written to, never replaced") {
  if (!std::filesystem::is_character_file("/dev/null")) return;
  write_file("/dev/null", "text\n");
  CHECK(std::filesystem::is_character_file("/dev/null"));
  if (!std::filesystem::is_character_file("/dev/full")) return;
  CHECK_THROWS_AS(write_file("/dev/full", "text\n"), std::runtime_error);
  CHECK(std::filesystem::is_character_file("/dev/full"));
}

TEST_CASE("What cannot be written is refused before and when it is written, in the same words") {
  const Folder folder;
  folder.write("file", "kept\n");
  const std::string here = folder.path().string();
  for (const std::string& path : {here, here + "/missing/x.csv", here + "/file/x.csv"}) {
    INFO(path);
    const std::string words = refusal(path);
    CHECK(words.find(path + ": the file cannot be written (") == 0);
    CHECK(words.find("choose a folder that exists") != words.npos);
  }
  CHECK(folder.files() == std::vector<std::string>{"file"});
  CHECK(folder.read("file") == "kept\n");
}
