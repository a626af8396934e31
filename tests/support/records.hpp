// Records of emulated machines with a known truth, and what a diagnosis makes of them.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "sim/diagnosis/diagnosis.hpp"
#include "sim/diagnosis/synthetic.hpp"
#include "tests/support/catch.hpp"

namespace saltus::test {

using Values = std::vector<std::pair<std::string, double>>;  // of coefficients, by name

inline std::vector<double> values_of(const diagnosis::Machine& m, const Values& truth) {
  std::vector<double> values;
  REQUIRE(diagnosis::values_with(m, truth, values));
  return values;
}

// An experiment on the machine of that name.
inline Record emulated(const std::string& model, const Values& truth, std::uint64_t seed,
                       const diagnosis::Campaign& c) {
  const auto m = diagnosis::make_machine(model);
  Record r = diagnosis::synthesise(*m, values_of(*m, truth), c, seed);
  REQUIRE(r.rows() > 0);
  return r;
}

// What a machine that no clock paces does from a start, at instants t [s] under inputs u, row by row.
inline std::vector<double> outputs_of(const std::string& model, const Values& truth, const std::vector<double>& t,
                                      const std::vector<double>& u, double longest_step,
                                      const diagnosis::Start& start) {
  const auto m = diagnosis::make_machine(model);
  const diagnosis::Response y = m->values_only(values_of(*m, truth), Course{t, u, 0, longest_step}, start);
  REQUIRE(usable(y.status));
  return y.y;
}

inline diagnosis::Diagnosis judged(const Record& r, const diagnosis::Options& options = {}) {
  const auto m = diagnosis::make_machine(r.model);
  REQUIRE(m != nullptr);
  return diagnosis::diagnose(r, *m, options);
}

// Refused with these words in the message.
inline void refused(const Record& r, const std::string& words) {
  CAPTURE(words);
  try {
    judged(r);
    FAIL("was not refused");
  } catch (const RecordError& e) {
    CAPTURE(e.what());
    CHECK(std::string(e.what()).find(words) != std::string::npos);
  }
}

}  // namespace saltus::test
