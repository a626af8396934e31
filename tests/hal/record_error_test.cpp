// Everything a record is refused for: where the message points, what it says, and the mend it offers.
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "hal/record.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

Record read(const std::string& text) {
  std::istringstream in(text);
  return read_record(in, "test.csv");
}

// The message with which the text is refused; empty where it is accepted.
std::string refusal(const std::string& text) {
  try {
    (void)read(text);
    return "";
  } catch (const RecordError& error) {
    return error.what();
  }
}

struct Case {
  std::string text;
  std::string message;  // all of it, or its beginning up to "..."
};

void check(const std::vector<Case>& cases) {
  for (const Case& c : cases) {
    INFO(c.text.substr(0, 400));
    const bool part = c.message.size() > 3 && c.message.substr(c.message.size() - 3) == "...";
    const std::string expected = part ? c.message.substr(0, c.message.size() - 3) : c.message;
    const std::string got = refusal(c.text);
    CHECK((part ? got.substr(0, expected.size()) : got) == expected);
    CHECK(got.find("; ") != std::string::npos);
  }
}

const std::string v1 = "# saltus-record: 1\n";
const std::string io = v1 + "# inputs: u [N]\n# outputs: y [m]\n";  // 3 lines
const std::string plain = io + "experiment,t,u,y\n";                // 4 lines
const std::string clocked = io +
                            "# sections: clock\n# sections-per-cycle: 4\n# cycle-period-s: 2\n"
                            "experiment,cycle,section,t,u,y\n";  // 7 lines

}  // namespace

TEST_CASE("a file that is no record is refused") {
  check({
      {"", "test.csv:1:1: the file is empty; a record begins with `# saltus-record: 1`"},
      {"\n \r\n", "test.csv:1:1: the file is empty; ..."},
      {"\xEF\xBB\xBF", "test.csv:1:1: the file is empty; ..."},
      {"experiment,t,u,y\n0,0,0,0\n",
       "test.csv:1:1: no line `# saltus-record: 1` above this one, so this is not known to be a record; put it first "
       "in "
       "the file"},
      {"# model: hopper\n  experiment,t\n", "test.csv:2:3: no line `# saltus-record: 1` above this one..."},
      {v1, "test.csv:2:1: the file ends before the row of column names; add it, such as `experiment,t,...`..."},
      {plain, "test.csv:5:1: no data rows; add one for each sample below the column names"},
      {plain + "\n\n", "test.csv:5:1: no data rows; ..."},
      {"# saltus-record: 2\n",
       "test.csv:1:18: version `2` of the format, but this program reads version 1; use a newer..."},
      {"\xEF\xBB\xBF#saltus-record:\n", "test.csv:1:16: version `` of the format..."},
      {plain + "0,0," + std::string(1, '\0') + "1,2\n",
       "test.csv:5:5: a zero byte: this is not text; save the file as UTF-8 text with LF or CRLF line ends; `saltus "
       "log` "
       "converts an LCM event log"},
      {std::string(100'000, '\0'), "test.csv:1:1: a zero byte..."},
      {"\x7F"
       "ELF",
       "test.csv:1:1: a byte that is neither printable nor UTF-8; save the file as UTF-8 text..."},
      {plain + "0,0,1,2\r0,1,1,2\r",
       "test.csv:5:8: a byte that is neither printable nor UTF-8; save the file as UTF-8 text with LF or CRLF line "
       "ends"},
  });
}

TEST_CASE("text that is not UTF-8 is refused at the byte") {
  for (const std::string bad : {"\xB5", "\xC0\x80", "\xC3", "\xE0\x80\x80", "\xED\xA0\x80", "\xF0\x80\x80\x80",
                                "\xF4\x90\x80\x80", "\xF5\x80\x80\x80", "\xE2\x82", "\xC3(", "\x1B[0m"}) {
    check({{v1 + "# note: 5 " + bad + "\n", "test.csv:2:11: a byte that is neither printable nor UTF-8; ..."}});
  }
  for (const std::string good :
       {"\xC2\xB5", "\xE2\x82\xAC", "\xED\x9F\xBF", "\xEF\xBF\xBD", "\xF0\x9F\x8E\x89", "\xF4\x8F\xBF\xBF"}) {
    CHECK(read(v1 + "# note: " + good + "\n# outputs: y\nexperiment,t,y\n0,0,0\n").notes[0].second == good);
  }
}

TEST_CASE("a header line is refused where it says nothing, or says it twice") {
  const std::string mend = "; write a remark as `# note: ...`";
  check({
      {v1 + "# a remark\n", "test.csv:2:3: a header line that is not `# key: value` with a key of one word" + mend},
      {v1 + "#  a remark: yes\n",
       "test.csv:2:4: a header line that is not `# key: value` with a key of one word" + mend},
      {v1 + "# : hopper\n", "test.csv:2:3: a header line that is not `# key: value`..."},
      {v1 + "#\n", "test.csv:2:2: a header line that is not `# key: value`..."},
      {v1 + "# note: a\n# note: b\n", "test.csv:3:3: the key `note` again, after line 2; keep one of the two"},
      {v1 + v1, "test.csv:2:3: the key `saltus-record` again, after line 1; keep one of the two"},
      {v1 + "# input: u\n# inputs: u\n", "test.csv:3:3: the key `inputs` again, after line 2; ..."},
      {v1 + "# output: y\n# outputs: y\n", "test.csv:3:3: the key `outputs` again, after line 2; ..."},
      {v1 + "# Sections_Per_Cycle: 4\n",
       "test.csv:2:3: `Sections_Per_Cycle` is not a key of a record; did you mean `# sections-per-cycle: ...`?"},
      {plain + "# note: late\n", "test.csv:5:1: a header line after the row of column names; move it above that row"},
  });
  std::string many = v1;
  for (int i = 0; i < 1024; ++i) many += "# note-" + std::to_string(i) + ": 0\n";
  check({{many, "test.csv:1025:3: more than 1024 header lines; remove some"}});
}

TEST_CASE("numbers in the header are refused outside their range") {
  const auto key = [](const std::string& line) { return v1 + "# " + line + "\n"; };
  check({
      {key("sections-per-cycle: 0"), "test.csv:2:23: sections-per-cycle is `0`; write a whole number from 1 to 4096"},
      {key("sections-per-cycle: 4097"),
       "test.csv:2:23: sections-per-cycle is `4097`; write a whole number from 1 to 4096"},
      {key("sections-per-cycle: 1e99"), "test.csv:2:23: sections-per-cycle is `1e99`; ..."},
      {key("sections-per-cycle: 32.5"), "test.csv:2:23: sections-per-cycle is `32.5`; ..."},
      {key("sections-per-cycle:"), "test.csv:2:22: sections-per-cycle is ``; ..."},
      {key("stimulus-period-cycles: 65537"),
       "test.csv:2:27: stimulus-period-cycles is `65537`; write a whole number from 1 to 65536"},
      {key("settle-cycles: -1"), "test.csv:2:18: settle-cycles is `-1`; write a whole number from 0 to 2147483647"},
      {key("cycle-period-s: 0"), "test.csv:2:19: cycle-period-s is `0`; write the period in seconds, a number above 0"},
      {key("cycle-period-s: nan"), "test.csv:2:19: cycle-period-s is `nan`; ..."},
      {key("cycle-period-s: inf"), "test.csv:2:19: cycle-period-s is `inf`; ..."},
      {key("cycle-period-s: 1 s"), "test.csv:2:19: cycle-period-s is `1 s`; ..."},
  });
}

TEST_CASE("the names of inputs and outputs are refused where they cannot be") {
  for (const std::string bad : {"y [m", "y m]", "y [m]]", "y [m] [s]", "[m]", "1.5", "nan", "t", "chart",
                                "experiment [s]", "y [m] x", "\"y\"", "a;b", "#y"}) {
    check({{v1 + "# outputs: x [m], " + bad + "\n", "test.csv:2:19: `" + bad +
                                                        "` does not name an input or output; write `name [unit], name "
                                                        "[unit]`, where no name is empty, a number, or one of "
                                                        "experiment, t, cycle, section, chart"}});
  }
  check({
      {v1 + "# inputs: u,,v\n", "test.csv:2:13: `` does not name an input or output; ..."},
      {v1 + "# inputs: u,\n", "test.csv:2:13: `` does not name an input or output; ..."},
  });
}

TEST_CASE("columns and their declarations must agree") {
  check({
      {v1 + "# inputs: u [N]\n# outputs: x [m], y_m [m]\nexperiment,t,u,x,y_M\n",
       "test.csv:3:19: no column `y_m`; the columns are experiment, t, u, x, y_M; did you mean `outputs: x [m], y_M "
       "[m]`?"},
      {v1 + "# inputs: torque [N m]\n# outputs: y [m]\nexperiment,t,y,rest,torqe\n",
       "test.csv:2:11: no column `torque`; the columns are experiment, t, y, rest, torqe; did you mean `inputs: torqe "
       "[N "
       "m]`?"},
      {io + "experiment,t,u\n",
       "test.csv:3:12: no column `y`; the columns are experiment, t, u; add the column, or remove its name here"},
      {v1 + "# inputs: u\n# outputs: y, y\nexperiment,t,u,y\n",
       "test.csv:3:12: `y` is declared twice; declare a column once"},
      {v1 + "# inputs: u\n# outputs: u\nexperiment,t,u\n",
       "test.csv:2:11: `u` is declared twice; declare a column once"},
      {v1 + "experiment,t,y,v\n", "test.csv:2:1: the header declares no outputs; did you mean `# outputs: y, v`?"},
      {v1 + "experiment,t\n",
       "test.csv:2:1: the header declares no outputs; add a column of measurements and `# outputs: NAME [UNIT]`"},
      {io + "experiment,t,u,extra,y\n",
       "test.csv:4:16: the header does not declare the column `extra`; remove it, or add it to `# inputs: ...` or `# "
       "outputs: ...`"},
      {io + "experiment, t,u,y, u\n", "test.csv:4:20: a second column `u`; rename or remove one of the two"},
      {io + "experiment,t,t,u,y\n", "test.csv:4:14: a second column `t`; ..."},
      {io + "experiment,t,u,y,\n", "test.csv:4:18: a column without a name; name it, or remove the comma"},
      {io + "t,u,y\n",
       "test.csv:4:1: no column `experiment`; the columns are t, u, y; add it, 0 in every row where there is only one"},
      {io + "experiment,u,y\n",
       "test.csv:4:1: no column `t`; the columns are experiment, u, y; add the time in seconds"},
      {io + "0,0,0,0\n",
       "test.csv:4:1: a number where the column names should be; put a row `experiment,t,...` above it"},
      {io + "experiment;t;u;y\n",
       "test.csv:4:1: the column names are not separated by commas; separate cells by commas, and write decimals with "
       "a "
       "point"},
      {io + "experiment\tt\tu\ty\n", "test.csv:4:1: the column names are not separated by commas; ..."},
  });
  std::string many = v1 + "# outputs: c2";  // 64 columns are accepted
  for (int i = 3; i < 64; ++i) many += ",c" + std::to_string(i);
  many += "\n" + many.substr(many.find("c2")).insert(0, "experiment,t,") + "\n0,0" + std::string(62, ',') + "\n";
  CHECK(read(many).outputs.size() == 62);
  std::string wide = io + "experiment,t,u,y";
  for (int i = 4; i < 65; ++i) wide += ",c" + std::to_string(i);
  check({{wide + "\n", "test.csv:4:252: more than 64 columns; remove some"}});
}

TEST_CASE("sections need their columns and their number") {
  check({
      {io + "# sections-per-cycle: 4\nexperiment,cycle,t,u,y\n",
       "test.csv:4:3: sections-per-cycle, but no columns `cycle` and `section`; add the columns, or remove this line"},
      {io + "# sections: clock\nexperiment,t,u,y\n",
       "test.csv:4:3: `sections: clock`, but not how many; add `# sections-per-cycle: N`"},
      {io + "experiment,cycle,section,t,u,y\n",
       "test.csv:4:18: a column `section`, but not how many there are; add `# sections-per-cycle: N` to the header"},
  });
}

TEST_CASE("a cell that is not what its column holds is refused") {
  const std::string number = "; write a number such as -1.5e-3, or leave the cell of a missing measurement empty";
  check({
      {plain + "0,0,1\n",
       "test.csv:5:6: this row has 3 cells, but there are 4 column names; leave a missing measurement's cell empty, "
       "and "
       "write decimals with a point"},
      {plain + "0,0,1,2\n0,1,1, 2,5\n", "test.csv:6:10: this row has 5 cells, but there are 4 column names; ..."},
      {plain + "0,0,1, wet\n", "test.csv:5:8: `wet` in column `y` is not a finite number" + number},
      {plain + "0,0,1.5V,2\n", "test.csv:5:5: `1.5V` in column `u` is not a finite number" + number},
      {plain + "0,0,1,inf\n", "test.csv:5:7: `inf` in column `y` is not a finite number" + number},
      {plain + "0,0,-Infinity,1\n", "test.csv:5:5: `-Infinity` in column `u` is not a finite number" + number},
      {plain + "0,0,1,1e999\n", "test.csv:5:7: `1e999` in column `y` is not a finite number" + number},
      {plain + "0,0,1,0x10\n", "test.csv:5:7: `0x10` in column `y` is not a finite number" + number},
      {plain + "0,0,1,+-1\n", "test.csv:5:7: `+-1` in column `y` is not a finite number" + number},
      {plain + "0,0,1,+\n", "test.csv:5:7: `+` in column `y` is not a finite number" + number},
      {plain + "0,0,1,\"2\"\n", "test.csv:5:7: `\"2\"` in column `y` is not a finite number" + number},
      {plain + "0,,1,2\n", "test.csv:5:3: a row without its time; write t in seconds, or remove the row"},
      {plain + "-1,0,1,2\n",
       "test.csv:5:1: `-1` in column `experiment` is not a whole number from 0 to 2147483647; correct it"},
      {plain + "0.5,0,1,2\n", "test.csv:5:1: `0.5` in column `experiment` is not a whole number..."},
      {plain + ",0,1,2\n", "test.csv:5:1: `` in column `experiment` is not a whole number..."},
      {plain + "2147483648,0,1,2\n", "test.csv:5:1: `2147483648` in column `experiment` is not a whole number..."},
      {clocked + "0,-1,0,0,1,2\n", "test.csv:8:3: `-1` in column `cycle` is not a whole number..."},
      {clocked + "0,0,4,0,1,2\n",
       "test.csv:8:5: `4` in column `section` is not a whole number from 0 to 3; correct it, or the header's "
       "sections-per-cycle"},
      {clocked + "0,0,1.5,0,1,2\n", "test.csv:8:5: `1.5` in column `section` is not a whole number from 0 to 3; ..."},
  });
  CHECK(read(clocked + "0.0,1e0,3.0,0,1,2\n").section[0] == 3);  // a whole number all the same

  std::string charts = io + "experiment,t,chart,u,y\n";
  for (int i = 0; i < 65; ++i) charts += "0," + std::to_string(i) + ",c" + std::to_string(i) + ",0,0\n";
  check({{charts, "test.csv:69:6: more than 64 different charts; write the chart's name, not a value"}});
}

TEST_CASE("rows out of order are refused") {
  const std::string sort = "; sort the rows, or number a new experiment";
  check({
      {plain + "0,1,0,0\n0,1,0,0\n", "test.csv:6:3: t does not rise from line 5" + sort},
      {plain + "0,1,0,0\n\n0,0.5,0,0\n", "test.csv:7:3: t does not rise from line 5" + sort},
      {plain + "0,1,0,0\n1,0,0,0\n0,2,0,0\n",
       "test.csv:7:1: experiment 0 begins again; an experiment is one uninterrupted measurement: number this one "
       "afresh, "
       "or sort the rows"},
      {io + "experiment,cycle,t,u,y\n0,3,0,0,0\n0,2,1,0,0\n", "test.csv:6:3: the cycle goes back from line 5" + sort},
      {clocked + "0,1,2,0,0,0\n0,1,2,0.5,0,0\n",
       "test.csv:9:5: the same experiment, cycle and section as line 8; keep one of the two"},
      {clocked + "0,1,2,0,0,0\n0,1,1,0.5,0,0\n", "test.csv:9:3: cycle and section go back from line 8" + sort},
      {clocked + "0,1,2,0,0,0\n0,0,3,0.5,0,0\n", "test.csv:9:3: cycle and section go back from line 8" + sort},
      {clocked + "0,0,0,0,0,0\n0,4194304,0,8388608,0,0\n",
       "test.csv:9:3: an experiment of more than 16 million sections; correct the cycle, or split the experiment"},
  });
}

TEST_CASE("without sections a cycle has any number of rows") {
  const Record r = read(io + "experiment,cycle,t,u,y\n0,1,0,0,0\n0,1,1,0,0\n0,4,2,0,0\n");
  CHECK(r.cycle == std::vector<int>{1, 1, 4});
}

TEST_CASE("the time of a clock-paced record must be that of its sections, within half of one") {
  const std::string off =
      "t is more than half a section off the time of its cycle and section; correct them, or the header's "
      "cycle-period-s or sections-per-cycle";
  check({
      {clocked + "0,0,0,10,0,0\n0,0,1,10.7501,0,0\n", "test.csv:9:7: " + off},
      {clocked + "0,0,0,10,0,0\n0,0,1,10.2499,0,0\n", "test.csv:9:7: " + off},
      {clocked + "0,0,0,10,0,0\n0,1,0,11,0,0\n", "test.csv:9:7: " + off},
      {clocked + "0,0,0,0,0,0\n0,0,1,1e308,0,0\n", "test.csv:9:7: " + off},
  });
  CHECK(read(clocked + "0,5,3,10,0,0\n0,6,0,10.75,0,0\n0,6,2,11.25,0,0\n").rows() == 3);  // jitter, a gap, any start
  std::string events = clocked;
  events.replace(events.find("clock"), 5, "event");
  CHECK(read(events + "0,0,0,0,0,0\n0,0,1,77,0,0\n").rows() == 2);  // paced by something else
}

TEST_CASE("lines and files of an absurd size are refused") {
  const std::string longest = "# note: " + std::string(65536 - 8, 'x');
  CHECK(refusal(v1 + longest + "\n").find("ends before the row of column names") != std::string::npos);
  CHECK(refusal(v1 + longest + "\r\n").find("ends before the row of column names") != std::string::npos);
  check({
      {v1 + longest + "x\n",
       "test.csv:2:65537: the line is longer than 64 kB; write one row a line, ended by LF or CRLF"},
      {v1 + longest + "x\r\n", "test.csv:2:65537: the line is longer than 64 kB; ..."},
      {v1 + longest + std::string(200'000, 'x'), "test.csv:2:65537: the line is longer than 64 kB; ..."},
  });
}

TEST_CASE("a file that cannot be read is refused by its name") {
  const std::filesystem::path folder = SALTUS_TEST_DATA;
  const auto message = [](const std::filesystem::path& path) -> std::string {
    try {
      (void)read_record(path);
      return "";
    } catch (const RecordError& error) {
      CHECK(error.line() == 0);
      CHECK(error.column() == 0);
      return error.what();
    }
  };
  CHECK(message(folder) == folder.string() + ": this is a directory, not a record; name a file in it");
  const std::string none = (folder / "no-such-record.csv").string();
  CHECK(message(none) == none + ": there is no such file; check the path");
  const std::string through = (folder / "hopper/open-none.csv/x.csv").string();
  CHECK(message(through).substr(0, through.size() + 2) == through + ": ");
}

TEST_CASE("a file of more than 2 GB is refused before it is read") {
  const auto path = std::filesystem::temp_directory_path() / ("saltus-" + std::to_string(std::random_device{}()));
  std::ofstream(path) << plain << "0,0,1,2\n";
  std::error_code fault;
  std::filesystem::resize_file(path, 2'000'000'001, fault);  // sparse: it takes no room
  std::string message;
  try {
    (void)read_record(path);
  } catch (const RecordError& error) {
    message = error.what();
  }
  std::filesystem::remove(path);
  if (!fault) CHECK(message == path.string() + ": the file is larger than 2 GB; split it by experiment");
}

TEST_CASE("an error knows its place") {
  try {
    (void)read(plain + "0,0,1,wet\n");
    FAIL("not refused");
  } catch (const RecordError& error) {
    CHECK(error.line() == 5);
    CHECK(error.column() == 7);
  }
}

TEST_CASE("a message shows what stood in the file, shortened and without control characters") {
  const std::string cell(100, 'x');
  const std::string message = refusal(plain + "0,0,1,\t" + cell + "\n");
  CHECK(message.find("`" + std::string(40, 'x') + "...`") != std::string::npos);
  CHECK(refusal(plain + "0,0,1,5\xC2\xB5\n").find("`5??`") != std::string::npos);
}

TEST_CASE("a damaged record is read or refused, and never anything else") {
  const std::string text = clocked +
                           "0,0,0,0,0.5,1\n0,0,1,0.5,0.5,nan\n0,0,3,1.5,-0.5,1e-3\n"
                           "0,1,0,2,,2\n1,7,2,0,0.25,-3\n1,8,0,1,0.25,\n";
  const std::string alphabet = "0123456789.,-+eEinaf#:[] \t\r\n\"\\;_sxu\xEF\xBB\xBF\x80\xFF" + std::string(1, '\0');
  std::mt19937 draw(20240607);
  const auto below = [&draw](std::size_t n) { return static_cast<std::size_t>(draw()) % n; };
  int read_well = 0;
  int refused = 0;
  int without_mend = 0;
  for (int trial = 0; trial < 6000; ++trial) {
    std::string damaged = text;
    const std::size_t wounds = 1 + below(3);
    for (std::size_t i = 0; i < wounds && !damaged.empty(); ++i) {
      const std::size_t at = below(damaged.size());
      switch (below(5)) {
        case 0:
          damaged[at] = alphabet[below(alphabet.size())];
          break;
        case 1:
          damaged.insert(at, 1, alphabet[below(alphabet.size())]);
          break;
        case 2:
          damaged.erase(at, 1 + below(3));
          break;
        case 3:
          damaged.insert(at, damaged.substr(below(damaged.size()), below(40)));
          break;
        default:
          damaged.resize(at + 1);
          break;
      }
    }
    try {
      const Record r = read(damaged);
      for (const Experiment& e : experiments(r)) {
        if (r.sections_per_cycle) (void)on_grid(r, e);
      }
      std::ostringstream out;
      write_record(out, r);
      ++read_well;
    } catch (const RecordError& error) {
      ++refused;
      without_mend += std::string(error.what()).find("; ") == std::string::npos ? 1 : 0;
    }
  }
  CHECK(read_well > 200);
  CHECK(refused > 3000);
  CHECK(without_mend == 0);
}
