// The writer. What it makes is read back before anything is put anywhere, so the reader's rules hold here too.
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <fstream>
#include <ostream>
#include <sstream>
#include <system_error>

#include "record.hpp"

namespace saltus {
namespace {

namespace fs = std::filesystem;

// The shortest digits that give the same number back.
template <class Number>
void append(std::string& text, Number value) {
  std::array<char, 32> digits{};
  text.append(digits.data(), std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr);
}

void append_value(std::string& text, double value) {
  if (std::isnan(value)) {
    text += "nan";  // without the sign a NaN may carry
  } else {
    append(text, value);
  }
}

void append_key(std::string& text, std::string_view key, std::string_view value) {
  text.append("# ").append(key).append(": ").append(value).append("\n");
}

template <class Number>
void append_key(std::string& text, std::string_view key, const std::optional<Number>& value) {
  if (!value) return;
  std::string digits;
  append(digits, *value);
  append_key(text, key, digits);
}

std::string declared(const std::vector<Channel>& channels) {
  std::string list;
  for (const Channel& c : channels) {
    list += (list.empty() ? "" : ", ") + c.name + (c.unit.empty() ? "" : " [" + c.unit + "]");
  }
  return list;
}

std::string header_of(const Record& r) {
  std::string text;
  append_key(text, "saltus-record", "1");
  if (!r.model.empty()) append_key(text, "model", r.model);
  if (!r.sections.empty()) append_key(text, "sections", r.sections);
  append_key(text, "sections-per-cycle", r.sections_per_cycle);
  append_key(text, "cycle-period-s", r.cycle_period);
  if (!r.inputs.empty()) append_key(text, "inputs", declared(r.inputs));
  append_key(text, "outputs", declared(r.outputs));
  append_key(text, "stimulus-period-cycles", r.stimulus_period_cycles);
  append_key(text, "settle-cycles", r.settle_cycles);
  for (const auto& [key, value] : r.notes) append_key(text, key, value);
  text += "experiment";
  if (!r.cycle.empty()) text += ",cycle";
  if (!r.section.empty()) text += ",section";
  text += ",t";
  if (!r.chart.empty()) text += ",chart";
  for (const Channel& c : r.inputs) text += "," + c.name;
  for (const Channel& c : r.outputs) text += "," + c.name;
  return text + "\n";
}

// Empty where the chart is not known.
std::string_view chart_name(const Record& r, std::size_t row) {
  return r.chart[row] < 0 ? std::string_view() : r.chart_names[static_cast<std::size_t>(r.chart[row])];
}

std::string text_of(const Record& r) {
  std::string text = header_of(r);
  for (std::size_t row = 0; row < r.rows(); ++row) {
    append(text, r.experiment[row]);
    if (!r.cycle.empty()) append(text += ',', r.cycle[row]);
    if (!r.section.empty()) append(text += ',', r.section[row]);
    append(text += ',', r.t[row]);
    if (!r.chart.empty()) text.append(",").append(chart_name(r, row));
    for (const Channel& c : r.inputs) append_value(text += ',', c.values[row]);
    for (const Channel& c : r.outputs) append_value(text += ',', c.values[row]);
    text += '\n';
  }
  return text;
}

void check_columns(const Record& r, const std::string& file) {
  const auto check = [&](const std::string& column, std::size_t size) {
    if (size == r.rows()) return;
    throw RecordError(
        file,
        "the column `" + column + "` has " + std::to_string(size) + " rows, but t has " + std::to_string(r.rows()),
        "fill every column for every row, with NaN where a value is missing");
  };
  check("experiment", r.experiment.size());
  if (!r.cycle.empty()) check("cycle", r.cycle.size());
  if (!r.section.empty()) check("section", r.section.size());
  if (!r.chart.empty()) check("chart", r.chart.size());
  for (const Channel& c : r.inputs) check(c.name, c.values.size());
  for (const Channel& c : r.outputs) check(c.name, c.values.size());
  for (const int chart : r.chart) {
    if (chart < 0 || static_cast<std::size_t>(chart) < r.chart_names.size()) continue;
    throw RecordError(file, "chart " + std::to_string(chart) + " has no name", "add it to chart_names");
  }
}

// Numbers come back by the choice of their digits; names and remarks only where they hold no comma, line end and the
// like.
bool same_words(const Record& a, const Record& b) {
  const auto same_channels = [](const std::vector<Channel>& p, const std::vector<Channel>& q) {
    return std::equal(p.begin(), p.end(), q.begin(), q.end(),
                      [](const Channel& c, const Channel& d) { return c.name == d.name && c.unit == d.unit; });
  };
  if (a.model != b.model || a.sections != b.sections || a.notes != b.notes || a.rows() != b.rows() ||
      a.chart.size() != b.chart.size() || !same_channels(a.inputs, b.inputs) || !same_channels(a.outputs, b.outputs)) {
    return false;
  }
  for (std::size_t row = 0; row < a.chart.size(); ++row) {
    if (chart_name(a, row) != chart_name(b, row)) return false;
  }
  return true;
}

std::string checked_text(const Record& record, const std::string& file) {
  check_columns(record, file);
  std::string text = text_of(record);
  std::istringstream in(text);
  if (!same_words(record, read_record(in, file))) {
    throw RecordError(file, "a name, unit or note would not be read back as it is",
                      "take commas, brackets, line ends and outer spaces out of it");
  }
  return text;
}

}  // namespace

void write_record(std::ostream& out, const Record& record) {
  out << checked_text(record, record.name) << std::flush;
  if (!out) throw RecordError(record.name, "the record could not be written", "check that there is room for it");
}

void write_record(const fs::path& path, const Record& record) {
  const std::string file = path.string();
  const std::string text = checked_text(record, file);
  const auto check = [&file](const std::error_code& fault) {
    if (!fault) return;
    throw RecordError(file, "the file cannot be written (" + fault.message() + ")",
                      "check the directory, its rights and its room");
  };
  std::error_code fault;
  const fs::path target = fs::weakly_canonical(path, fault);  // through a symbolic link, which shall stay one
  check(fault);
  const fs::file_status status = fs::status(target, fault);
  if (fs::is_directory(status)) throw RecordError(file, "this is a directory", "name a file in it");
  const bool device = fs::exists(status) && !fs::is_regular_file(status);  // such as /dev/stdout: it cannot be replaced
  const fs::path partial = device ? target : fs::path(target.string() + "." + std::to_string(::getpid()) + ".part");

  errno = 0;
  std::ofstream out(partial, std::ios::binary);
  out << text;
  out.close();
  fault.assign(out ? 0 : errno != 0 ? errno : EIO, std::generic_category());
  if (!fault && !device) fs::rename(partial, target, fault);
  if (fault && !device) {
    std::error_code ignored;
    fs::remove(partial, ignored);
  }
  check(fault);
}

}  // namespace saltus
