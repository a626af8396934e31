#include "record_header.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <map>

namespace saltus::record_text {
namespace {

constexpr std::size_t most_columns = 64;
constexpr std::size_t most_keys = 1024;
constexpr int most_sections = 4096;      // [-] in a cycle
constexpr int longest_stimulus = 65536;  // [cycle]

constexpr std::array<std::string_view, 5> fixed_columns{"experiment", "t", "cycle", "section", "chart"};  // by Role

constexpr std::array<std::string_view, 11> known_keys{
    "saltus-record", "model",   "sections", "sections-per-cycle",     "cycle-period-s", "inputs",
    "input",         "outputs", "output",   "stimulus-period-cycles", "settle-cycles"};

template <class List, class Name>
bool contains(const List& list, const Name& name) {
  return std::find(list.begin(), list.end(), name) != list.end();
}

class HeaderReader {
 public:
  explicit HeaderReader(Lines& lines) : lines_(lines) { record_.name = lines.file(); }

  Header read() {
    read_keys();
    read_names();
    return {std::move(record_), std::move(columns_)};
  }

 private:
  void read_keys() {
    while (lines_.next()) {
      const std::string_view text = trim(lines_.text());
      if (text.empty()) continue;
      if (text.front() == '#') {
        read_key(trim(text.substr(1)));
        continue;
      }
      if (keys_.count("saltus-record") == 0) {
        lines_.refuse(text, "no line `# saltus-record: 1` above this one, so this is not known to be a record",
                      "put it first in the file");
      }
      return;
    }
    if (keys_.empty()) lines_.refuse(Place{1, 1}, "the file is empty", "a record begins with `# saltus-record: 1`");
    lines_.refuse(Place{lines_.number() + 1, 1}, "the file ends before the row of column names",
                  "add it, such as `experiment,t,...`, and the data below it");
  }

  void read_key(std::string_view text) {
    const auto colon = text.find(':');
    const std::string_view written = trim(text.substr(0, colon));
    if (colon == text.npos || written.empty() || written.find_first_of(" \t") != written.npos) {
      lines_.refuse(text, "a header line that is not `# key: value` with a key of one word",
                    "write a remark as `# note: ...`");
    }
    const std::string_view value = trim(text.substr(colon + 1));
    std::string key(written);
    if (key == "input" || key == "output") key += 's';
    const auto [earlier, fresh] = keys_.emplace(key, lines_.place(written));
    if (!fresh) {
      lines_.refuse(written, "the key " + excerpt(key) + " again, after line " + std::to_string(earlier->second.line),
                    "keep one of the two");
    }
    if (keys_.size() > most_keys) lines_.refuse(text, "more than 1024 header lines", "remove some");
    keep(key, written, value);
  }

  void keep(const std::string& key, std::string_view written, std::string_view value) {
    if (key == "saltus-record") {
      if (value == "1") return;
      lines_.refuse(value, "version " + excerpt(value) + " of the format, but this program reads version 1",
                    "use a newer saltus, or convert the file to `# saltus-record: 1`");
    } else if (key == "model") {
      record_.model = value;
    } else if (key == "sections") {
      record_.sections = value;
    } else if (key == "sections-per-cycle") {
      record_.sections_per_cycle = key_number(key, value, 1, most_sections);
    } else if (key == "stimulus-period-cycles") {
      record_.stimulus_period_cycles = key_number(key, value, 1, longest_stimulus);
    } else if (key == "settle-cycles") {
      record_.settle_cycles = key_number(key, value, 0, std::numeric_limits<int>::max());
    } else if (key == "cycle-period-s") {
      record_.cycle_period = number(value);
      if (record_.cycle_period && *record_.cycle_period > 0.0) return;
      lines_.refuse(value, key + " is " + excerpt(value), "write the period in seconds, a number above 0");
    } else if (key == "inputs") {
      declare(value, record_.inputs, input_places_);
    } else if (key == "outputs") {
      declare(value, record_.outputs, output_places_);
    } else {
      std::string plain = lower(key);
      std::replace(plain.begin(), plain.end(), '_', '-');
      if (contains(known_keys, plain)) {  // kept as a note it would have no effect, and nobody would know
        lines_.refuse(written, excerpt(key) + " is not a key of a record", "did you mean `# " + plain + ": ...`?");
      }
      record_.notes.emplace_back(key, value);
    }
  }

  int key_number(const std::string& key, std::string_view value, int low, int high) const {
    const std::optional<int> n = whole(value, low, high);
    if (n) return *n;
    lines_.refuse(value, key + " is " + excerpt(value),
                  "write a whole number from " + std::to_string(low) + " to " + std::to_string(high));
  }

  // `y_M [m], v_M [m/s]`; a comma inside the brackets belongs to the unit.
  void declare(std::string_view list, std::vector<Channel>& channels, std::vector<Place>& places) const {
    for (bool more = !list.empty(); more;) {
      std::size_t end = list.find_first_of(",[");
      if (end != list.npos && list[end] == '[') end = list.find(',', list.find(']', end));
      more = end != list.npos;
      const std::string_view item = trim(list.substr(0, end));
      if (more) list.remove_prefix(end + 1);

      const auto open = item.find('[');
      const std::string_view name = trim(item.substr(0, open));
      const std::string_view unit = open == item.npos ? "]" : item.substr(open + 1);  // with its closing bracket
      if (unit.find_first_of("[]") + 1 != unit.size() || name.empty() || name.find_first_of("]\"#;") != name.npos ||
          number(name) || contains(fixed_columns, name)) {
        lines_.refuse(item, excerpt(item) + " does not name an input or output",
                      "write `name [unit], name [unit]`, where no name is empty, a number, or one of " +
                          joined({fixed_columns.begin(), fixed_columns.end()}));
      }
      channels.push_back({std::string(name), std::string(trim(unit.substr(0, unit.size() - 1))), {}});
      places.push_back(lines_.place(item));
    }
  }

  void read_names() {
    lines_.split(cells_);
    const std::string_view first = cells_.front();
    if (cells_.size() == 1 && first.find_first_of(";\t") != first.npos) {
      lines_.refuse(first, "the column names are not separated by commas",
                    "separate cells by commas, and write decimals with a point");
    }
    if (number(first) && !first.empty()) {
      lines_.refuse(first, "a number where the column names should be", "put a row `experiment,t,...` above it");
    }
    if (cells_.size() > most_columns) lines_.refuse(cells_[most_columns], "more than 64 columns", "remove some");
    for (const std::string_view cell : cells_) {
      if (cell.empty()) lines_.refuse(cell, "a column without a name", "name it, or remove the comma");
      if (contains(names_, cell)) {
        lines_.refuse(cell, "a second column " + excerpt(cell), "rename or remove one of the two");
      }
      names_.emplace_back(cell);
      columns_.push_back({names_.back()});
      if (!assign_role(columns_.back())) undeclared_.push_back(names_.back());
    }
    for (const std::string need : {"experiment", "t"}) {
      if (contains(names_, need)) continue;
      lines_.refuse(first, "no column " + excerpt(need) + "; the columns are " + joined(names_),
                    need == "t" ? "add the time in seconds" : "add it, 0 in every row where there is only one");
    }
    check_declared("inputs", record_.inputs, input_places_);
    check_declared("outputs", record_.outputs, output_places_);
    if (record_.outputs.empty()) {
      lines_.refuse(first, "the header declares no outputs",
                    undeclared_.empty() ? "add a column of measurements and `# outputs: NAME [UNIT]`"
                                        : "did you mean `# outputs: " + joined(undeclared_) + "`?");
    }
    if (!undeclared_.empty()) {
      lines_.refuse(cell_of(undeclared_.front()),
                    "the header does not declare the column " + excerpt(undeclared_.front()),
                    "remove it, or add it to `# inputs: ...` or `# outputs: ...`");
    }
    check_sections();
  }

  std::string_view cell_of(std::string_view name) const { return *std::find(cells_.begin(), cells_.end(), name); }

  // False where the header does not say what the column is.
  bool assign_role(Column& column) const {
    for (std::size_t i = 0; i < fixed_columns.size(); ++i) {
      if (column.name != fixed_columns[i]) continue;
      column.role = static_cast<Role>(i);
      return true;
    }
    for (const Role role : {Role::input, Role::output}) {
      const std::vector<Channel>& channels = role == Role::input ? record_.inputs : record_.outputs;
      for (std::size_t i = 0; i < channels.size(); ++i) {
        if (column.name != channels[i].name) continue;
        column.role = role;
        column.channel = i;
        return true;
      }
    }
    return false;
  }

  void check_declared(const std::string& key, const std::vector<Channel>& channels,
                      const std::vector<Place>& places) const {
    for (std::size_t i = 0; i < channels.size(); ++i) {
      const std::string& name = channels[i].name;
      const auto same = [&name](const Channel& c) { return c.name == name; };
      const auto declared = std::count_if(record_.inputs.begin(), record_.inputs.end(), same) +
                            std::count_if(record_.outputs.begin(), record_.outputs.end(), same);
      if (declared > 1) lines_.refuse(places[i], excerpt(name) + " is declared twice", "declare a column once");
      if (contains(names_, name)) continue;
      std::vector<std::string> meant;
      for (const Channel& c : channels) {
        const bool wrong = &c == &channels[i] && !undeclared_.empty();
        meant.push_back(wrong ? nearest(name, undeclared_) : c.name);
        if (!c.unit.empty()) meant.back() += " [" + c.unit + "]";
      }
      lines_.refuse(places[i], "no column " + excerpt(name) + "; the columns are " + joined(names_),
                    undeclared_.empty() ? "add the column, or remove its name here"
                                        : "did you mean `" + key + ": " + joined(meant) + "`?");
    }
  }

  void check_sections() const {
    if (record_.sections_per_cycle && !(contains(names_, "cycle") && contains(names_, "section"))) {
      lines_.refuse(keys_.at("sections-per-cycle"), "sections-per-cycle, but no columns `cycle` and `section`",
                    "add the columns, or remove this line");
    }
    if (record_.sections_per_cycle) return;
    if (record_.sections == "clock") {
      lines_.refuse(keys_.at("sections"), "`sections: clock`, but not how many", "add `# sections-per-cycle: N`");
    }
    if (contains(names_, "section")) {
      lines_.refuse(cell_of("section"), "a column `section`, but not how many there are",
                    "add `# sections-per-cycle: N` to the header");
    }
  }

  Lines& lines_;
  Record record_;
  std::vector<Column> columns_;
  std::map<std::string, Place> keys_;
  std::vector<Place> input_places_;
  std::vector<Place> output_places_;
  std::vector<std::string_view> cells_;
  std::vector<std::string> names_;
  std::vector<std::string> undeclared_;
};

}  // namespace

Header read_header(Lines& lines) { return HeaderReader(lines).read(); }

}  // namespace saltus::record_text
