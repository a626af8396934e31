// Where the time of a diagnosis goes.
#pragma once

#include <chrono>

#include "diagnosis.hpp"

namespace saltus::diagnosis {

class Laps {
 public:
  explicit Laps(Diagnosis& d) : d_(d) {}
  // What the time since the last lap went into.
  void operator()(const char* what) {
    const auto now = std::chrono::steady_clock::now();
    d_.seconds.emplace_back(what, std::chrono::duration<double>(now - last_).count());
    last_ = now;
  }

 private:
  Diagnosis& d_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace saltus::diagnosis
