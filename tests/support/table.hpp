// Reads a small CSV table of the tests' data: a header row, then rows; no quotes.
#pragma once

#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/catch.hpp"

namespace saltus::test {

// Rows of cells, without the header, from tests/data/`name`. Fails the test where there are none.
inline std::vector<std::vector<std::string>> table(const std::string& name) {
  std::ifstream file(SALTUS_TEST_DATA "/" + name);
  std::vector<std::vector<std::string>> rows;
  std::string line;
  std::getline(file, line);
  while (std::getline(file, line)) {
    std::istringstream cells(line);
    std::vector<std::string>& row = rows.emplace_back();
    for (std::string cell; std::getline(cells, cell, ',');) row.push_back(cell);
  }
  INFO(name);
  REQUIRE_FALSE(rows.empty());
  return rows;
}

}  // namespace saltus::test
