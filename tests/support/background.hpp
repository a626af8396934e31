// The saltus program running beside a test, until told otherwise.
#pragma once

#include <signal.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "tests/support/program.hpp"

namespace saltus::test {

class Background {
 public:
  // Runs `saltus ARGUMENTS` in the folder; its streams go to NAME.out and NAME.err there. `before` is called in the new
  // process first.
  template <class Before>
  Background(const Folder& folder, const std::string& name, const std::vector<std::string>& arguments, Before&& before)
      : out_(folder.path(name + ".out")), err_(folder.path(name + ".err")) {
    child_ = ::fork();
    if (child_ != 0) return;
    ::alarm(540);
    before();
    for (const auto& [file, stream] : {std::pair{out_, STDOUT_FILENO}, std::pair{err_, STDERR_FILENO}}) {
      const int f = ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
      if (f < 0 || ::dup2(f, stream) < 0) ::_exit(126);
    }
    std::vector<char*> argv{const_cast<char*>("saltus")};
    for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
    argv.push_back(nullptr);
    if (::chdir(folder.path().c_str()) == 0) ::execv(SALTUS_PROGRAM, argv.data());
    ::_exit(127);
  }
  Background(const Folder& folder, const std::string& name, const std::vector<std::string>& arguments)
      : Background(folder, name, arguments, [] {}) {}
  ~Background() { (void)end(SIGKILL); }
  Background(const Background&) = delete;
  Background& operator=(const Background&) = delete;

  pid_t process() const { return child_; }

  // Its outcome, after it has ended by itself, or by the signal if that is not 0.
  Outcome end(int signal) {
    if (child_ > 0) {
      if (signal != 0) ::kill(child_, signal);
      int status = 0;
      (void)::waitpid(child_, &status, 0);
      child_ = -1;
      status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    return {status_, text_of(out_), text_of(err_)};
  }

  // True once the file of the folder holds `text`; false after a minute without.
  bool says(const std::string& text) const {
    for (int i = 0; i < 6000; ++i) {
      if (text_of(out_).find(text) != std::string::npos || text_of(err_).find(text) != std::string::npos) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return false;
  }

 private:
  std::filesystem::path out_, err_;
  pid_t child_ = -1;
  int status_ = -1;
};

// A short campaign of one experiment pair and more; settling for 20 cycles unless said otherwise.
inline std::vector<std::string> short_campaign(const std::vector<std::string>& more) {
  std::vector<std::string> all{"identify",  "hopper", "--period", "8", "--band",  "1.5",
                               "--periods", "2",      "--seed",   "5", "--noise", "0.001,0.006"};
  if (std::find(more.begin(), more.end(), "--settle") == more.end()) all.insert(all.end(), {"--settle", "20"});
  all.insert(all.end(), more.begin(), more.end());
  return all;
}
inline std::vector<std::string> short_rig(const std::vector<std::string>& more) {
  std::vector<std::string> all{"rig", "hopper", "--seed", "5", "--noise", "0.001,0.006"};
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

// The value of "htf_hash" in a JSON file; empty where there is none.
inline std::string hash_in(const Folder& folder, const std::string& file) {
  const std::string text = folder.read(file), key = "\"htf_hash\": \"";
  const auto at = text.find(key);
  return at == std::string::npos ? std::string{} : text.substr(at + key.size(), 16);
}

}  // namespace saltus::test
