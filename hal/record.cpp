#include "record.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <istream>
#include <limits>
#include <set>

#include "record_header.hpp"
#include "record_text.hpp"

namespace saltus {
namespace {

using record_text::Column;
using record_text::excerpt;
using record_text::Lines;
using record_text::Place;
using record_text::Role;

constexpr std::size_t most_charts = 64;
constexpr std::int64_t longest_span = std::int64_t{1} << 24;  // [section] of one experiment
constexpr int most = std::numeric_limits<int>::max();

class RowReader {
 public:
  explicit RowReader(Lines& lines) : lines_(lines) {
    record_text::Header header = record_text::read_header(lines);
    record_ = std::move(header.record);
    columns_ = std::move(header.columns);
  }

  Record read() {
    const Place below{lines_.number() + 1, 1};
    while (lines_.next()) {
      const std::string_view text = record_text::trim(lines_.text());
      if (text.empty()) continue;
      if (text.front() == '#') {
        lines_.refuse(text, "a header line after the row of column names", "move it above that row");
      }
      read_row();
      check_order();
      previous_line_ = lines_.number();
    }
    if (record_.rows() == 0) lines_.refuse(below, "no data rows", "add one for each sample below the column names");
    return std::move(record_);
  }

 private:
  void read_row() {
    lines_.split(cells_);
    const std::string_view text = lines_.text();
    if (cells_.size() != columns_.size()) {
      lines_.refuse(cells_.size() > columns_.size() ? cells_[columns_.size()] : text.substr(text.size()),
                    "this row has " + std::to_string(cells_.size()) + " cells, but there are " +
                        std::to_string(columns_.size()) + " column names",
                    "leave a missing measurement's cell empty, and write decimals with a point");
    }
    Record& r = record_;
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      const std::size_t channel = columns_[i].channel;
      switch (columns_[i].role) {
        case Role::experiment:
          r.experiment.push_back(count(i, most));
          break;
        case Role::t:
          r.t.push_back(value(i));
          break;
        case Role::cycle:
          r.cycle.push_back(count(i, most));
          break;
        case Role::section:
          r.section.push_back(count(i, *r.sections_per_cycle - 1));
          break;
        case Role::chart:
          r.chart.push_back(chart(cells_[i]));
          break;
        case Role::input:
          r.inputs[channel].values.push_back(value(i));
          break;
        case Role::output:
          r.outputs[channel].values.push_back(value(i));
          break;
      }
    }
  }

  double value(std::size_t i) const {
    const std::optional<double> v = record_text::number(cells_[i]);
    if (!v) {
      lines_.refuse(cells_[i],
                    excerpt(cells_[i]) + " in column " + excerpt(columns_[i].name) + " is not a finite number",
                    "write a number such as -1.5e-3, or leave the cell of a missing measurement empty");
    }
    if (columns_[i].role == Role::t && std::isnan(*v)) {
      lines_.refuse(cells_[i], "a row without its time", "write t in seconds, or remove the row");
    }
    return *v;
  }

  int count(std::size_t i, int high) const {
    const std::optional<int> n = record_text::whole(cells_[i], 0, high);
    if (n) return *n;
    lines_.refuse(cells_[i],
                  excerpt(cells_[i]) + " in column " + excerpt(columns_[i].name) + " is not a whole number from 0 to " +
                      std::to_string(high),
                  columns_[i].role == Role::section ? "correct it, or the header's sections-per-cycle" : "correct it");
  }

  int chart(std::string_view name) {
    std::vector<std::string>& known = record_.chart_names;
    if (name.empty()) return -1;
    const auto found = std::find(known.begin(), known.end(), name);
    if (found != known.end()) return static_cast<int>(found - known.begin());
    if (known.size() == most_charts) {
      lines_.refuse(name, "more than 64 different charts", "write the chart's name, not a value");
    }
    known.emplace_back(name);
    return static_cast<int>(known.size() - 1);
  }

  std::string_view cell(Role role) const {
    const auto found =
        std::find_if(columns_.begin(), columns_.end(), [role](const Column& c) { return c.role == role; });
    return cells_[static_cast<std::size_t>(found - columns_.begin())];
  }

  // [section] from the first row of the experiment to this row.
  std::int64_t span(std::size_t row) const {
    const std::int64_t cycles = std::int64_t{record_.cycle[row]} - record_.cycle[first_];
    return cycles * *record_.sections_per_cycle + record_.section[row] - record_.section[first_];
  }

  // The last row against the one before it, and against the first of its experiment.
  void check_order() {
    const Record& r = record_;
    const std::size_t row = r.rows() - 1;
    if (row == 0 || r.experiment[row] != r.experiment[row - 1]) {
      if (!begun_.insert(r.experiment[row]).second) {
        lines_.refuse(cell(Role::experiment), "experiment " + std::to_string(r.experiment[row]) + " begins again",
                      "an experiment is one uninterrupted measurement: number this one afresh, or sort the rows");
      }
      first_ = row;
      return;
    }
    if (r.sections_per_cycle) {
      const std::int64_t step = span(row) - span(row - 1);
      if (step == 0) {
        lines_.refuse(cell(Role::section), "the same experiment, cycle and section as" + previous(),
                      "keep one of the two");
      }
      if (step < 0) refuse_order(Role::cycle, "cycle and section go back from");
      if (span(row) >= longest_span) {
        lines_.refuse(cell(Role::cycle), "an experiment of more than 16 million sections",
                      "correct the cycle, or split the experiment");
      }
    } else if (!r.cycle.empty() && r.cycle[row] < r.cycle[row - 1]) {
      refuse_order(Role::cycle, "the cycle goes back from");
    }
    if (!(r.t[row] > r.t[row - 1])) refuse_order(Role::t, "t does not rise from");
    if (r.clock_paced() && r.cycle_period) {
      const double section = *r.cycle_period / *r.sections_per_cycle;  // [s]
      const double off = (r.t[row] - r.t[first_]) / section - static_cast<double>(span(row));
      if (!(std::abs(off) <= 0.5)) {
        lines_.refuse(cell(Role::t), "t is more than half a section off the time of its cycle and section",
                      "correct them, or the header's cycle-period-s or sections-per-cycle");
      }
    }
  }

  std::string previous() const { return " line " + std::to_string(previous_line_); }

  [[noreturn]] void refuse_order(Role role, const std::string& what) const {
    lines_.refuse(cell(role), what + previous(), "sort the rows, or number a new experiment");
  }

  Lines& lines_;
  Record record_;
  std::vector<Column> columns_;
  std::vector<std::string_view> cells_;
  std::set<int> begun_;            // experiments
  std::size_t first_ = 0;          // row of the present experiment
  std::size_t previous_line_ = 0;  // of the row before
};

std::string message(std::string_view file, std::size_t line, std::size_t column, std::string_view what,
                    std::string_view mend) {
  std::string text(file);
  if (line != 0) text.append(":").append(std::to_string(line)).append(":").append(std::to_string(column));
  return text.append(": ").append(what).append("; ").append(mend);
}

}  // namespace

RecordError::RecordError(std::string_view file, std::size_t line, std::size_t column, std::string_view what,
                         std::string_view mend)
    : std::runtime_error(message(file, line, column, what, mend)), line_(line), column_(column) {}

Record read_record(std::istream& in, std::string name) {
  Lines lines(in, std::move(name));
  return RowReader(lines).read();
}

Record read_record(const std::filesystem::path& path) {
  const std::string name = path.string();
  std::error_code fault;
  const auto status = std::filesystem::status(path, fault);
  if (status.type() == std::filesystem::file_type::not_found) {
    throw RecordError(name, "there is no such file", "check the path");
  }
  if (std::filesystem::is_directory(status)) {
    throw RecordError(name, "this is a directory, not a record", "name a file in it");
  }
  if (std::filesystem::is_regular_file(status) && std::filesystem::file_size(path, fault) > record_text::largest_file &&
      !fault) {
    throw RecordError(name, "the file is larger than 2 GB", "split it by experiment");
  }
  std::ifstream in(path, std::ios::binary);
  if (!in) throw RecordError(name, "the file cannot be opened", "check its rights");
  return read_record(in, name);
}

}  // namespace saltus
