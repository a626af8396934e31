// The header of a record and its row of column names: what the cells of a data row mean. Only record.cpp uses it.
#pragma once

#include <cstddef>
#include <vector>

#include "record.hpp"
#include "record_text.hpp"

namespace saltus::record_text {

enum class Role : std::size_t { experiment, t, cycle, section, chart, input, output };

struct Column {
  std::string name;
  Role role = Role::t;
  std::size_t channel = 0;  // its index, of an input or output
};

struct Header {
  Record record;  // without rows
  std::vector<Column> columns;
};

// Leaves the row of column names as the present line. Throws RecordError.
Header read_header(Lines& lines);

}  // namespace saltus::record_text
