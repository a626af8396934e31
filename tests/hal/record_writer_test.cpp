#include <sys/resource.h>

#include <bit>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "hal/record.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;
namespace fs = std::filesystem;

namespace {

constexpr double absent = std::numeric_limits<double>::quiet_NaN();

std::string text_of(const Record& record) {
  std::ostringstream out;
  write_record(out, record);
  return out.str();
}

std::string content(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream all;
  all << in.rdbuf();
  return all.str();
}

// Why the record is not written; empty where it is.
std::string refusal(const Record& record) {
  try {
    (void)text_of(record);
    return "";
  } catch (const RecordError& error) {
    return error.what();
  }
}

std::string refusal(const fs::path& path, const Record& record) {
  try {
    write_record(path, record);
    return "";
  } catch (const RecordError& error) {
    return error.what();
  }
}

bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  if (a.size() != b.size()) return false;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const bool both_missing = std::isnan(a[i]) && std::isnan(b[i]);
    if (!both_missing && std::bit_cast<std::uint64_t>(a[i]) != std::bit_cast<std::uint64_t>(b[i])) return false;
  }
  return true;
}

void check_same(const Record& a, const Record& b) {
  CHECK(a.model == b.model);
  CHECK(a.sections == b.sections);
  CHECK(a.sections_per_cycle == b.sections_per_cycle);
  CHECK(a.cycle_period == b.cycle_period);
  CHECK(a.stimulus_period_cycles == b.stimulus_period_cycles);
  CHECK(a.settle_cycles == b.settle_cycles);
  CHECK(a.notes == b.notes);
  CHECK(a.experiment == b.experiment);
  CHECK(same_bits(a.t, b.t));
  CHECK(a.cycle == b.cycle);
  CHECK(a.section == b.section);
  CHECK(a.chart == b.chart);
  CHECK(a.chart_names == b.chart_names);
  REQUIRE(a.inputs.size() == b.inputs.size());
  REQUIRE(a.outputs.size() == b.outputs.size());
  const auto check_channel = [](const Channel& p, const Channel& q) {
    CHECK(p.name == q.name);
    CHECK(p.unit == q.unit);
    CHECK(same_bits(p.values, q.values));
  };
  for (std::size_t i = 0; i < a.inputs.size(); ++i) check_channel(a.inputs[i], b.inputs[i]);
  for (std::size_t i = 0; i < a.outputs.size(); ++i) check_channel(a.outputs[i], b.outputs[i]);
}

Record full() {
  Record r;
  r.model = "kneed_biped";
  r.sections = "clock";
  r.sections_per_cycle = 2;
  r.cycle_period = 0.1 + 0.2;
  r.stimulus_period_cycles = 3;
  r.settle_cycles = 0;
  r.notes = {{"origin", "https://example.org/a#b: c, d"}, {"zeta", ""}, {"alpha", "\xC2\xB5"}};
  r.experiment = {2, 2, 0};
  r.cycle = {5, 6, 0};
  r.section = {1, 0, 0};
  r.t = {1.0 / 3.0, 1.0 / 3.0 + 0.15, -7.0};
  r.chart_names = {"Locked", "Unlocked"};
  r.chart = {0, -1, 1};
  r.inputs = {{"u", "N", {absent, -0.0, 5e-324}}, {"tau", "", {1e22, 0.1, -1e-7}}};
  r.outputs = {{"q", "N, m", {1.7976931348623157e308, -absent, 2.0}}};
  return r;
}

// An empty folder of its own for a test.
struct Scratch {
  fs::path path;
  Scratch() : path(fs::temp_directory_path() / ("saltus-record-" + std::to_string(std::random_device{}()))) {
    fs::create_directory(path);
  }
  ~Scratch() { fs::remove_all(path); }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  std::ptrdiff_t files() const { return std::distance(fs::directory_iterator(path), fs::directory_iterator()); }
};

}  // namespace

TEST_CASE("a record is written in a fixed form") {
  CHECK(text_of(full()) ==
        "# saltus-record: 1\n# model: kneed_biped\n# sections: clock\n# sections-per-cycle: 2\n"
        "# cycle-period-s: 0.30000000000000004\n# inputs: u [N], tau\n# outputs: q [N, m]\n"
        "# stimulus-period-cycles: 3\n# settle-cycles: 0\n# origin: https://example.org/a#b: c, d\n# zeta: \n"
        "# alpha: \xC2\xB5\n"
        "experiment,cycle,section,t,chart,u,tau,q\n"
        "2,5,1,0.3333333333333333,Locked,nan,1e+22,1.7976931348623157e+308\n"
        "2,6,0,0.4833333333333333,,-0,0.1,nan\n"
        "0,0,0,-7,Unlocked,5e-324,-1e-07,2\n");
}

TEST_CASE("what is written is read back, every bit of it") {
  std::istringstream in(text_of(full()));
  check_same(read_record(in, "test.csv"), full());

  Record random;
  random.outputs = {{"y", "m", {}}};
  std::mt19937_64 draw(1);
  for (int i = 0; i < 20'000; ++i) {
    const double value = std::bit_cast<double>(draw());
    random.experiment.push_back(0);
    random.t.push_back(0.1 * i);
    random.outputs[0].values.push_back(std::isinf(value) ? 0.0 : value);
  }
  std::istringstream again(text_of(random));
  check_same(read_record(again, "test.csv"), random);
}

TEST_CASE("a record of a hopper survives a file") {
  const Scratch scratch;
  const fs::path path = scratch.path / "copy.csv";
  const fs::path original = SALTUS_TEST_DATA "/hopper/open-none.csv";
  const Record r = read_record(original);
  write_record(path, r);
  check_same(read_record(path), r);
  CHECK(scratch.files() == 1);
  std::string expected = content(original);
  expected.replace(expected.find("# input:"), 8, "# inputs:");
  CHECK(content(path) == expected);
}

TEST_CASE("what could not be read back is not written") {
  const auto with = [](auto&& spoil) {
    Record r = full();
    spoil(r);
    return r;
  };
  const auto contains = [](const std::string& text, const std::string& part) { return text.find(part) != text.npos; };
  CHECK(refusal(full()).empty());
  CHECK(contains(refusal(with([](Record& r) { r.outputs[0].values.pop_back(); })),
                 "record: the column `q` has 2 rows, but t has 3; fill every column for every row"));
  CHECK(contains(refusal(with([](Record& r) { r.experiment.pop_back(); })), "the column `experiment` has 2 rows"));
  CHECK(contains(refusal(with([](Record& r) { r.cycle.pop_back(); })), "the column `cycle` has 2 rows"));
  CHECK(
      contains(refusal(with([](Record& r) { r.chart[0] = 2; })), "record: chart 2 has no name; add it to chart_names"));
  CHECK(contains(refusal(with([](Record& r) { r.cycle.clear(); })), "no columns `cycle` and `section`"));
  CHECK(contains(refusal(with([](Record& r) { r.outputs.clear(); })), "the header declares no outputs"));
  CHECK(contains(refusal(with([](Record& r) { r.outputs[0].values[1] = HUGE_VAL; })),
                 "`inf` in column `q` is not a finite number"));
  CHECK(contains(refusal(with([](Record& r) { r.t[2] = absent; })), "without its time"));
  CHECK(contains(refusal(with([](Record& r) { r.section[1] = 7; })), "`7` in column `section`"));
  CHECK(contains(refusal(with([](Record& r) { r.outputs[0].name = "t"; })), "does not name an input or output"));
  CHECK(contains(refusal(Record{}), "; "));

  const std::string lossy = "a name, unit or note would not be read back as it is";
  CHECK(contains(refusal(with([](Record& r) { r.model = "two "; })), lossy));
  CHECK(contains(refusal(with([](Record& r) { r.model = "a\n# more: b"; })), lossy));
  CHECK(contains(refusal(with([](Record& r) { r.notes[0].first = "a:b"; })), lossy));
  CHECK(contains(refusal(with([](Record& r) { r.inputs[0].unit = " N"; })), lossy));
  CHECK(contains(refusal(with([](Record& r) { r.chart_names[0] = " Locked"; })), lossy));
  CHECK(contains(refusal(with([](Record& r) { r.notes[0] = {"model", "other"}; })), "again"));
  CHECK_FALSE(refusal(with([](Record& r) { r.chart_names[0] = "a,b"; })).empty());
}

TEST_CASE("a stream that takes nothing is an error") {
  std::ostringstream out;
  out.setstate(std::ios::badbit);
  CHECK_THROWS_AS(write_record(out, full()), RecordError);
}

TEST_CASE("a file is replaced as a whole or left as it was") {
  const Scratch scratch;
  const fs::path path = scratch.path / "r.csv";
  std::ofstream(path) << "old";

  Record bad = full();
  bad.outputs[0].values[0] = HUGE_VAL;
  const std::string message = refusal(path, bad);
  CHECK(message.substr(0, path.string().size() + 1) == path.string() + ":");
  CHECK(content(path) == "old");
  CHECK(scratch.files() == 1);

  CHECK(refusal(path, full()).empty());
  CHECK(content(path) == text_of(full()));
  CHECK(scratch.files() == 1);
}

TEST_CASE("where the room runs out, the old file stays and no part of the new one") {
  const Scratch scratch;
  const fs::path path = scratch.path / "r.csv";
  std::ofstream(path) << "old";
  Record longer = full();
  longer.notes.emplace_back("long", std::string(5000, 'x'));

  rlimit room{};
  REQUIRE(getrlimit(RLIMIT_FSIZE, &room) == 0);
  const rlimit little{1000, room.rlim_max};  // [B] of any file
  const auto former = std::signal(SIGXFSZ, SIG_IGN);
  REQUIRE(setrlimit(RLIMIT_FSIZE, &little) == 0);
  const std::string message = refusal(path, longer);
  REQUIRE(setrlimit(RLIMIT_FSIZE, &room) == 0);
  std::signal(SIGXFSZ, former);

  CHECK(message.find(": the file cannot be written (") != message.npos);
  CHECK(content(path) == "old");
  CHECK(scratch.files() == 1);
}

TEST_CASE("a place that cannot be written is named") {
  const Scratch scratch;
  CHECK(refusal(scratch.path, full()) == scratch.path.string() + ": this is a directory; name a file in it");
  const std::string nowhere = (scratch.path / "none" / "r.csv").string();
  const std::string message = refusal(nowhere, full());
  CHECK(message.substr(0, nowhere.size() + 28) == nowhere + ": the file cannot be written");
  CHECK(message.find("; check the directory, its rights and its room") != std::string::npos);
  CHECK(scratch.files() == 0);
}

TEST_CASE("a symbolic link stays one, and a device is not replaced") {
  const Scratch scratch;
  const fs::path target = scratch.path / "target.csv";
  const fs::path link = scratch.path / "link.csv";
  std::ofstream(target) << "old";
  fs::create_symlink(target, link);
  write_record(link, full());
  CHECK(fs::is_symlink(link));
  CHECK(content(target) == text_of(full()));
  CHECK(scratch.files() == 2);

  const fs::path loop = scratch.path / "loop.csv";
  fs::create_symlink(loop, loop);
  CHECK(refusal(loop, full()).find(loop.string() + ": the file cannot be written (") == 0);
  CHECK(fs::is_symlink(loop));
  CHECK(scratch.files() == 3);

  write_record("/dev/null", full());
  CHECK(fs::is_character_file("/dev/null"));
  if (fs::exists("/dev/full")) {
    CHECK(refusal("/dev/full", full()).find("the file cannot be written") != std::string::npos);
    CHECK(fs::is_character_file("/dev/full"));
  }
}
