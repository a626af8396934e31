// A measured record: what a machine was told and what it answered, kept as CSV text (`saltus-record: 1`).
//
//   # saltus-record: 1                       `# key: value` lines first; keys not named here are kept as notes
//   # model: hopper
//   # inputs: u [N]                          names and units, comma separated; `input` and `output` mean the same
//   # outputs: y_M [m], v_M [m/s]
//   experiment,t,u,y_M,v_M                   then one row of column names, in any order
//   0,0,0.5,1.85,-1.93                       then the data
//
// Columns: `experiment` (its rows are one uninterrupted measurement), `t` [s], optional `cycle`, `section`, `chart`,
// then the declared inputs and outputs. A row says what was measured at t, and the input held from t to the next row;
// so the pair (command, answer to it) is the input of one row and the outputs of the next.
//
// A record is paced by a clock when its header also has `sections-per-cycle` (and `sections: clock`, `cycle-period-s`,
// `stimulus-period-cycles`, `settle-cycles`): the rows are samples at equal clock phases, and on_grid() lays them out.
#pragma once

#include <cstddef>
#include <filesystem>
#include <iosfwd>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace saltus {

// One input or output and its column. NaN is a missing value. For an output that is a measurement that was not made;
// for an input the record does not say what was applied: the reader accepts it, and whoever uses the record must
// decide.
struct Channel {
  std::string name;
  std::string unit;            // as written between the brackets; empty where none was given
  std::vector<double> values;  // (rows)
};

struct Record {
  std::string name = "record";  // where it came from, for messages
  std::string model;            // empty where the header names none
  std::string sections;         // what paces the sections: "clock", another word, or empty

  std::optional<int> sections_per_cycle;      // [-]  1 to 4096
  std::optional<double> cycle_period;         // [s]  of one cycle
  std::optional<int> stimulus_period_cycles;  // [cycle]  1 to 65536
  std::optional<int> settle_cycles;           // [cycle]  at the start of each experiment, not yet periodic

  std::vector<std::pair<std::string, std::string>> notes;  // every other header key, in the order of the file

  std::vector<int> experiment;  // (rows)
  std::vector<double> t;        // (rows) [s]  rising within an experiment
  std::vector<int> cycle;       // (rows), or empty where there is no such column; so are section and chart
  std::vector<int> section;     // (rows)  0 to sections_per_cycle - 1
  std::vector<int> chart;       // (rows)  index into chart_names; -1 = not known

  std::vector<std::string> chart_names;  // in the order of their first appearance
  std::vector<Channel> inputs;
  std::vector<Channel> outputs;

  std::size_t rows() const noexcept { return t.size(); }
  bool clock_paced() const noexcept { return sections_per_cycle && (sections.empty() || sections == "clock"); }
};

// Everything that can be wrong with a record. The message is "FILE:LINE:COLUMN: what is wrong; how to mend it", or
// "FILE: ..." where it concerns the file as a whole. Columns count bytes from 1.
class RecordError : public std::runtime_error {
 public:
  RecordError(std::string_view file, std::size_t line, std::size_t column, std::string_view what,
              std::string_view mend);
  RecordError(std::string_view file, std::string_view what, std::string_view mend)
      : RecordError(file, 0, 0, what, mend) {}

  std::size_t line() const noexcept { return line_; }      // 0 = the file as a whole
  std::size_t column() const noexcept { return column_; }  // 0 = the file as a whole

 private:
  std::size_t line_;
  std::size_t column_;
};

// Reads a record or throws RecordError; `name` stands for the file in messages. CRLF, spaces around cells, empty lines
// and a byte-order mark are accepted, an empty cell or `nan` is a missing value; nothing else is tolerated.
Record read_record(std::istream& in, std::string name);
Record read_record(const std::filesystem::path& path);

// Writes a record that read_record gives back bit for bit, or throws RecordError and writes nothing: the text is made
// and read back first, and a file is written beside its target and renamed, so that no half-written one is ever seen.
void write_record(std::ostream& out, const Record& record);
void write_record(const std::filesystem::path& path, const Record& record);

// The rows of one experiment.
struct Experiment {
  int id = 0;
  std::size_t first_row = 0;
  std::size_t rows = 0;
};

// In the order of the file.
std::vector<Experiment> experiments(const Record& record);

// One experiment as dense arrays over whole cycles, from its first cycle to its last.
struct Grid {
  int sections = 0;                          // [-] in a cycle
  int first_cycle = 0;                       // its number in the record
  int cycles = 0;                            // [cycle]
  std::vector<std::vector<double>> inputs;   // (channel, sample), sample = (cycle - first_cycle) * sections + section;
  std::vector<std::vector<double>> outputs;  //   NaN = missing
  std::size_t missing_rows = 0;              // samples without a row
  std::size_t filled_inputs = 0;             // input values taken from another repeat of the stimulus
  std::size_t missing_inputs = 0;            // input values still NaN
};

// Lays one experiment on the grid of its sections. Where the header has a stimulus period, a missing input is that of
// the same sample some whole periods earlier, or else later: the stimulus runs on whether or not a row was recorded.
// Throws RecordError where the record has no sections.
Grid on_grid(const Record& record, const Experiment& experiment);

// Cycles at the start of a grid that the header calls settling. They count from cycle 0 where the experiment begins
// there or soon after, and from its own start where it begins later than they would end.
int settling_cycles(const Record& record, const Grid& grid);

}  // namespace saltus
