// Runs the saltus program as its users do, in a folder of its own that is gone afterwards.
//
//   const saltus::test::Folder folder;
//   const auto done = folder.run({"htf", "hopper", "--csv", "x.csv"});
//   CHECK(done.status == 0);
//   CHECK(folder.files() == std::vector<std::string>{"x.csv"});
#pragma once

#include <fcntl.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

namespace saltus::test {

struct Outcome {
  int status = -1;  // exit status; 128 + the signal that ended it
  std::string out, err;
};

inline std::string text_of(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class Folder {
 public:
  Folder() : root_(make()) { std::filesystem::create_directory(path()); }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(root_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  std::filesystem::path path(const std::string& name = {}) const { return root_ / "work" / name; }
  std::string read(const std::string& name) const { return text_of(path(name)); }
  void write(const std::string& name, const std::string& text) const {
    std::ofstream(path(name), std::ios::binary) << text;
  }

  // Everything in it, folders included, sorted.
  std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(path())) {
      names.push_back(entry.path().lexically_relative(path()).string());
    }
    std::sort(names.begin(), names.end());
    return names;
  }

  // Runs `saltus ARGUMENTS` here. `search` replaces the PATH, `out` takes standard output instead of the outcome. A run
  // that takes minutes is ended: status 128 + SIGALRM.
  Outcome run(const std::vector<std::string>& arguments, const char* search = nullptr,
              const char* out = nullptr) const {
    const std::string captured = (root_ / "out").string(), errors = (root_ / "err").string();
    const pid_t child = ::fork();
    if (child == 0) {
      ::alarm(540);
      if (search != nullptr) ::setenv("PATH", search, 1);
      redirect(out != nullptr ? out : captured.c_str(), STDOUT_FILENO);
      redirect(errors.c_str(), STDERR_FILENO);
      std::vector<char*> argv{const_cast<char*>("saltus")};
      for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
      argv.push_back(nullptr);
      if (::chdir(path().c_str()) == 0) ::execv(SALTUS_PROGRAM, argv.data());
      ::_exit(127);
    }
    int status = 0;
    if (child < 0 || ::waitpid(child, &status, 0) != child) throw std::runtime_error("the program was not run");
    return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status),
            out != nullptr ? std::string{} : text_of(captured), text_of(errors)};
  }

 private:
  static std::filesystem::path make() {
    // mkdtemp() puts a name of its own in the place of the six.
    std::string name = (std::filesystem::temp_directory_path() / ("saltus-test-" + std::string(6, 'X'))).string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    return name;
  }
  static void redirect(const char* file, int stream) {
    const int f = ::open(file, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    if (f < 0 || ::dup2(f, stream) < 0) ::_exit(126);
  }

  std::filesystem::path root_;  // holds the captured streams, and the folder of the run
};

}  // namespace saltus::test
