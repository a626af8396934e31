// Measured records, whole, damaged and wrong, from the command line.
#include "tests/support/catch.hpp"
#include "tests/support/htf_table.hpp"
#include "tests/support/program.hpp"

#include <nlohmann/json.hpp>

#include <functional>
#include <sstream>

using nlohmann::json;
using namespace saltus::test;

namespace {

// A record as lines and cells, to be spoilt.
struct Sheet {
  using Row = std::vector<std::string>;
  std::vector<std::string> header;
  std::string columns;
  std::vector<Row> rows;

  // Of the record at hand, with the rows of `keep`.
  static Sheet open(const std::function<bool(int experiment, int cycle)>& keep) {
    std::istringstream in(text_of(std::filesystem::path(SALTUS_TEST_DATA) / "hopper/open-none.csv"));
    Sheet s;
    std::string line;
    while (std::getline(in, line) && line[0] == '#') s.header.push_back(line);
    s.columns = line;
    while (std::getline(in, line)) {
      Row row;
      std::istringstream cells(line);
      for (std::string cell; std::getline(cells, cell, ',');) row.push_back(cell);
      if (keep(std::stoi(row[0]), std::stoi(row[1]))) s.rows.push_back(row);
    }
    return s;
  }
  // One experiment with a stimulus, settling and two periods.
  static const Sheet& small() {
    static const Sheet s = open([](int experiment, int cycle) { return experiment == 1 && cycle < 168; });
    return s;
  }

  // Replaces the header line that begins so, or removes it.
  Sheet& with(const std::string& key, const std::string& line) {
    for (std::string& h : header) {
      if (h.compare(0, key.size() + 2, "# " + key) == 0) h = line;
    }
    return *this;
  }
  Sheet& set(std::size_t column, const std::function<std::string(std::size_t row)>& value) {
    for (std::size_t i = 0; i < rows.size(); ++i) rows[i][column] = value(i);
    return *this;
  }
  // ":LINE:COLUMN" of a cell in the text.
  std::string place(std::size_t row, std::size_t cell) const {
    std::size_t column = 1;
    for (std::size_t i = 0; i < cell; ++i) column += rows[row][i].size() + 1;
    return ":" + std::to_string(header.size() + row + 2) + ":" + std::to_string(column);
  }
  std::string text() const {
    std::string t;
    for (const std::string& h : header) t += h.empty() ? "" : h + "\n";
    t += columns + "\n";
    for (const Row& row : rows) {
      for (std::size_t i = 0; i < row.size(); ++i) t += (i == 0 ? "" : ",") + row[i];
      t += "\n";
    }
    return t;
  }
};

}  // namespace

TEST_CASE("The measured record is identified from the command line, with its standard errors") {
  const Folder folder;
  const std::string record = std::string(SALTUS_TEST_DATA) + "/hopper/open-none.csv";
  const auto done = folder.run(
      {"identify", "hopper", "--record", record, "--csv", "x.csv", "--json", "x.json", "--pictures", "pictures"});
  REQUIRE(done.status == 0);
  const HtfTable table(folder.path("x.csv"));
  CHECK(table.entries().size() == 84 * 7 * 2);
  int inside = 0, far = 0;
  for (const auto& [key, entry] : table.entries()) {
    const auto& [m, line, output] = key;
    CHECK(entry.cycles == 4 * 64);
    const double error = std::abs(entry.value - reference_isochrons().at(m, line, output).value) / entry.sigma;
    inside += error < 1.0 ? 1 : 0;
    far += error > 3.0 ? 1 : 0;
  }
  // A complex error is within its sigma with probability 1 - 1/e, beyond three of them with 1e-4; but distortion, which
  // repeats, is in no scatter: it reaches four of them on a line or two near the resonance.
  CHECK(std::abs(inside / 1176.0 - 0.632) < 0.06);
  CHECK(far <= 2);

  const json j = json::parse(folder.read("x.json"));
  CHECK(j.at("missing") == 0);
  CHECK(j.at("samples") == 7 * 4 * 2048);
  CHECK(j.at("notes").empty());
  CHECK(j.at("htf").size() == 1176);
  // Too few lines for the exact form: two poles, whose misfit their stated error has to hold.
  const auto& multiplier = j.at("multipliers").at(0);
  const double error = std::abs(std::complex<double>(multiplier.at("re"), multiplier.at("im")) -
                                std::complex<double>(-0.248983334736, 0.699333251798));
  CHECK(error < 3e-2);
  CHECK(error < 4.0 * multiplier.at("sigma").get<double>());
}

TEST_CASE("Rows and cells that are missing are counted, and cost no truth") {
  Sheet sheet = Sheet::open([](int, int) { return true; });
  std::uint64_t state = 1;
  const auto lost = [&state](double share) {  // a plain generator, so that the data stay what they are
    state = state * 6364136223846793005u + 1442695040888963407u;
    return static_cast<double>(state >> 11) < share * 9007199254740992.0;
  };
  std::vector<Sheet::Row> kept;
  std::size_t cells = 0;
  for (Sheet::Row& row : sheet.rows) {
    if (lost(0.0025)) continue;
    for (const std::size_t column : {4u, 5u, 6u}) {
      if (!lost(0.0025)) continue;
      row[column] = cells++ % 2 == 0 ? "" : "nan";
    }
    kept.push_back(row);
  }
  sheet.rows.swap(kept);
  const Folder folder;
  folder.write("gaps.csv", sheet.text());
  REQUIRE(folder.run({"identify", "hopper", "--record", "gaps.csv", "--csv", "x.csv", "--json", "x.json"}).status == 0);
  const json j = json::parse(folder.read("x.json"));
  CHECK(j.at("status") == "missing");
  // About 0.75 % of the 57344 samples lack an output.
  CHECK((j.at("missing") > 300 && j.at("missing") < 560));
  const HtfTable table(folder.path("x.csv"));
  REQUIRE(table.entries().size() == 84 * 7 * 2);
  int one = 0, two = 0;
  for (const auto& [key, entry] : table.entries()) {
    const auto& [m, line, output] = key;
    const double z =
        std::norm(entry.value - reference_isochrons().at(m, line, output).value) / std::pow(entry.sigma, 2);
    one += z < -std::log(1.0 - 0.68) ? 1 : 0;
    two += z < -std::log(1.0 - 0.95) ? 1 : 0;
  }
  CHECK(std::abs(one / 1176.0 - 0.68) < 0.06);
  CHECK(std::abs(two / 1176.0 - 0.95) < 0.027);
}

TEST_CASE("A record whose experiments count their cycles on settles each of them") {
  const Folder folder;
  Sheet sheet = Sheet::open([](int experiment, int) { return experiment <= 2; });
  folder.write("anew.csv", sheet.text());
  for (Sheet::Row& row : sheet.rows) {
    const int on = 296 * std::stoi(row[0]);
    row[1] = std::to_string(std::stoi(row[1]) + on);
    row[3] = std::to_string(std::stod(row[3]) + on);
  }
  folder.write("on.csv", sheet.text());
  REQUIRE(folder.run({"identify", "hopper", "--record", "anew.csv", "--csv", "a.csv"}).status == 0);
  REQUIRE(folder.run({"identify", "hopper", "--record", "on.csv", "--csv", "b.csv", "--json", "b.json"}).status == 0);
  const HtfTable a(folder.path("a.csv")), b(folder.path("b.csv"));
  REQUIRE(a.entries().size() == b.entries().size());
  double worst = 0.0;
  for (const auto& [key, entry] : a.entries())
    worst = std::max(worst, std::abs(entry.value - b.entries().at(key).value));
  CHECK(worst < 1e-12);
  const json notes = json::parse(folder.read("b.json")).at("notes");
  REQUIRE(notes.size() == 2);
  CHECK(notes[0] == "experiment 1: begins at cycle 296, its first 40 cycles left out as settling");
}

TEST_CASE("Tones that clash are left out and named, and the others stay") {
  Sheet sheet = Sheet::small();
  const Folder folder;
  folder.write("before.csv", sheet.text());
  REQUIRE(folder.run({"identify", "hopper", "--record", "before.csv", "--csv", "a.csv"}).status == 0);
  const HtfTable before(folder.path("a.csv"));
  const int line = before.lines(0, "y_M").front();
  const int rival = line + 64;
  // As large a tone of the same class, and one on half the pumping frequency.
  sheet.set(4, [&](std::size_t i) {
    const double n = static_cast<double>(32 * std::stoi(sheet.rows[i][1]) + std::stoi(sheet.rows[i][2]));
    const auto wave = [n](int q) { return std::cos(2.0 * std::acos(-1.0) * std::fmod(q * n, 2048.0) / 2048.0); };
    char text[32];
    std::snprintf(text, sizeof text, "%.12g", std::stod(sheet.rows[i][4]) + 0.1 * wave(rival) + 0.1 * wave(96));
    return std::string(text);
  });
  folder.write("after.csv", sheet.text());
  const auto done = folder.run({"identify", "hopper", "--record", "after.csv", "--csv", "b.csv"});
  REQUIRE(done.status == 0);
  const std::string both = "(lines " + std::to_string(line) + " " + std::to_string(rival) + ")";
  CHECK(done.out.find("note: experiment 1: left out 2 tone(s)") != done.out.npos);
  CHECK(done.out.find(both) != done.out.npos);
  CHECK(done.out.find("left out 1 multiple(s) of half the pumping frequency (lines 96)") != done.out.npos);
  const HtfTable after(folder.path("b.csv"));
  auto lines = before.lines(0, "y_M");
  lines.erase(lines.begin());
  CHECK(after.lines(0, "y_M") == lines);
}

TEST_CASE("One period gives values without standard errors, and its gaps are named") {
  const Folder folder;
  Sheet sheet = Sheet::small();
  sheet.rows.resize(104 * 32);
  folder.write("one.csv", sheet.text());
  REQUIRE(folder.run({"identify", "hopper", "--record", "one.csv", "--csv", "x.csv"}).status == 0);
  const HtfTable table(folder.path("x.csv"));
  for (const auto& [key, entry] : table.entries()) CHECK((std::isnan(entry.sigma) && entry.cycles == 64));

  for (const std::size_t row : {1500u, 2000u, 3000u}) sheet.rows[row][5] = "";
  folder.write("gaps.csv", sheet.text());
  const auto done = folder.run({"identify", "hopper", "--record", "gaps.csv", "--csv", "y.csv"});
  REQUIRE(done.status == 0);
  CHECK(done.out.find("3 missing") != done.out.npos);
  CHECK(
      done.out.find("3 of the 2048 samples of a stimulus period were never measured of y_M and count as undisturbed") !=
      done.out.npos);
  const HtfTable gaps(folder.path("y.csv"));
  const auto lines = table.lines(0, "y_M");
  CHECK(gaps.error(table, 0, "y_M", lines).norm < 0.05 * table.size(0, "y_M", lines).norm);
  CHECK(gaps.error(table, 0, "v_M", lines).norm == 0.0);
}

TEST_CASE("An output that only some experiments measured is left out there, and said so") {
  const Folder folder;
  Sheet sheet = Sheet::open([](int experiment, int) { return experiment == 1 || experiment == 2; });
  sheet.set(5, [&](std::size_t i) { return sheet.rows[i][0] == "1" ? "nan" : sheet.rows[i][5]; });
  folder.write("x.csv", sheet.text());
  const auto done = folder.run({"identify", "hopper", "--record", "x.csv", "--csv", "h.csv"});
  REQUIRE(done.status == 0);
  CHECK(
      done.out.find("experiment 1: 2048 of the 2048 samples of a stimulus period were never measured of y_M, which is "
                    "left out") != done.out.npos);
  const HtfTable table(folder.path("h.csv"));
  CHECK(table.lines(0, "y_M").size() < table.lines(0, "v_M").size());
  for (const auto& [key, entry] : table.entries()) CHECK(std::abs(entry.value) > 0.0);
}

TEST_CASE("Few sections a cycle hold few harmonics") {
  const Folder folder;
  Sheet sheet = Sheet::small();
  sheet.with("sections-per-cycle", "# sections-per-cycle: 4");
  std::vector<Sheet::Row> kept;
  for (Sheet::Row row : sheet.rows) {
    const int section = std::stoi(row[2]);
    if (section % 8 != 0) continue;
    row[2] = std::to_string(section / 8);
    kept.push_back(row);
  }
  sheet.rows.swap(kept);
  folder.write("x.csv", sheet.text());
  REQUIRE(folder.run({"identify", "hopper", "--record", "x.csv", "--csv", "h.csv"}).status == 0);
  const HtfTable table(folder.path("h.csv"));
  CHECK_FALSE(table.lines(1, "y_M").empty());
  CHECK(table.lines(2, "y_M").empty());  // H_2 and H_-2 are the same here
}

TEST_CASE("A wrong record is refused by place and mend, with status 1 and nothing written") {
  const auto small = []() -> Sheet { return Sheet::small(); };
  struct Case {
    std::string says;
    std::string text;
  };
  std::vector<Case> cases;
  const auto add = [&](const std::string& says, const Sheet& sheet) { cases.push_back({says, sheet.text()}); };
  cases.push_back({":1:1: the file is empty; a record begins with `# saltus-record: 1`", ""});
  std::string bytes;
  for (int i = 0; i < 4096; ++i) bytes += static_cast<char>(i * 37 % 256);
  cases.push_back({":1:1: a zero byte: this is not text", bytes});
  {
    Sheet s = small();
    s.rows[100].emplace_back("1");
    add(s.place(100, 7) +
            ": this row has 8 cells, but there are 7 column names; leave a missing measurement's cell empty",
        s);
    s = small();
    s.rows[100].pop_back();
    add(":113:31: this row has 6 cells, but there are 7 column names", s);
    s = small();
    s.rows[7][5] = "high";
    add(s.place(7, 5) + ": `high` in column `y_M` is not a finite number", s);
    s = small();
    s.rows[9] = s.rows[8];
    add(s.place(9, 2) + ": the same experiment, cycle and section as line 21", s);
  }
  add(": nothing was measured of y_M where the machine is excited; fill its column",
      small().set(5, [](std::size_t) { return "nan"; }));
  add(": nothing was measured of y_M",
      small().set(5, [](std::size_t) { return ""; }).set(6, [](std::size_t) { return ""; }));
  add(": experiment 1 has inputs that no repeat tells; record more than one stimulus period, or fill",
      small().set(4, [](std::size_t) { return "nan"; }));
  add(": no experiment excites the machine on lines that can be told apart; record a stimulus",
      small().set(4, [](std::size_t) { return "0"; }));
  add(": no experiment excites the machine", small().set(4, [](std::size_t) { return "0.25"; }));
  add(": the input of experiment 1 does not repeat with the stimulus period; correct `# stimulus-period-cycles`",
      small().set(4, [](std::size_t i) { return std::to_string(0.1 * std::sin(0.001 * static_cast<double>(i * i))); }));
  add(": the input of experiment 1 does not repeat with the stimulus period",
      small().with("stimulus-period-cycles", "# stimulus-period-cycles: 60"));
  add(": it names no stimulus period; give `# stimulus-period-cycles: P`", small().with("stimulus-period-cycles", ""));
  add(":8:27: stimulus-period-cycles is `0`", small().with("stimulus-period-cycles", "# stimulus-period-cycles: 0"));
  add(": more than 256 sections a cycle or 512 cycles a stimulus period",
      small().with("stimulus-period-cycles", "# stimulus-period-cycles: 60000"));
  add(": no experiment has a whole stimulus period after its settling cycles; record longer, or correct",
      small().with("settle-cycles", "# settle-cycles: 120"));
  add(":4:23: sections-per-cycle is `1000000000`; write a whole number from 1 to 4096",
      small().with("sections-per-cycle", "# sections-per-cycle: 1000000000"));
  add(": its sections are not paced by a clock, as hopper is; give `# sections: clock`",
      small().with("sections:", "# sections: touchdown"));
  add(":5:19: cycle-period-s is `-1`", small().with("cycle-period-s", "# cycle-period-s: -1"));
  add(": its clock turns in 2 s, the model's in 1 s; set the model's clock rate, --set omega=3.14159",
      small().with("cycle-period-s", "# cycle-period-s: 2").set(3, [](std::size_t i) {
        return std::to_string(static_cast<double>(i) / 16.0);
      }));
  add(": it is a record of the model 'pogo', not of hopper", small().with("model", "# model: pogo"));
  add(": its outputs are v_M, y_M; those of hopper are y_M, v_M; correct the line `# outputs`",
      small().with("outputs", "# outputs: v_M [m/s], y_M [m]"));
  {
    Sheet s = small().with("outputs", "# outputs: y [m], v [m/s]");
    s.columns = "experiment,cycle,section,t,u,y,v";
    add(": its outputs are y, v; those of hopper are y_M, v_M", s);
    s = small();
    s.columns = "experiment,cycle,section,t,u,y_M,w_M";
    add(":7:21: no column `v_M`", s);
    s = small();
    s.columns = "experiment,cycle,section,t,force,y_M,v_M";
    add(":6:10: no column `u`", s);
    s = small().with("input", "# inputs: u [N], w [N]");
    s.columns = "experiment,cycle,section,t,u,w,y_M,v_M";
    for (Sheet::Row& row : s.rows) row.insert(row.begin() + 5, "0");
    add(": its inputs are u, w; those of hopper are u; correct the line `# inputs`", s);
  }
  add(": y_M is in mm; hopper has it in m; convert the column and correct its unit",
      small().with("outputs", "# outputs: y_M [mm], v_M [m/s]"));
  add(": u is in kN; hopper has it in N", small().with("input", "# inputs: u [kN]"));

  const Folder folder;
  for (const Case& c : cases) {
    INFO(c.says);
    folder.write("in.csv", c.text);
    const auto done = folder.run(
        {"identify", "hopper", "--record", "in.csv", "--csv", "x.csv", "--json", "x.json", "--pictures", "pictures"});
    CHECK(done.status == 1);
    INFO(done.err);
    CHECK(done.err.find("saltus: in.csv" + c.says) != done.err.npos);
    CHECK(done.out.empty());
    CHECK(folder.files() == std::vector<std::string>{"in.csv"});
  }
  CHECK(folder.run({"identify", "hopper", "--record", "nowhere.csv"}).err ==
        "saltus: nowhere.csv: there is no such file; check the path\n");
  CHECK(folder.run({"identify", "hopper", "--record", "."}).err ==
        "saltus: .: this is a directory, not a record; name a file in it\n");
  CHECK(folder.run({"identify", "hopper", "--record", "."}).status == 1);
}

TEST_CASE("A record without a model, units or settling is taken at its word") {
  const Folder folder;
  folder.write("x.csv", Sheet(Sheet::small()).with("model", "").with("outputs", "# outputs: y_M, v_M").text());
  CHECK(folder.run({"identify", "hopper", "--record", "x.csv"}).status == 0);
}

TEST_CASE("What drives a machine does not go with a record") {
  const Folder folder;
  folder.write("in.csv", Sheet::small().text());
  for (const std::vector<std::string>& option : {std::vector<std::string>{"--settle", "10"},
                                                 {"--save", "x.csv"},
                                                 {"--noise", "1,1"},
                                                 {"--sections", "kinematic"},
                                                 {"--protocol", "paper"},
                                                 {"--amplitude", "1"},
                                                 {"--seed", "2"},
                                                 {"--periods", "2"},
                                                 {"--subsets", "40"}}) {
    INFO(option[0]);
    std::vector<std::string> arguments{"identify", "hopper", "--record", "in.csv"};
    arguments.insert(arguments.end(), option.begin(), option.end());
    const auto done = folder.run(arguments);
    CHECK(done.status == 2);
    CHECK(done.err.find(option[0] + ": it says how to drive a machine") != done.err.npos);
  }
  CHECK(folder.files() == std::vector<std::string>{"in.csv"});
}
