#include "hal/record.hpp"

#include <cmath>
#include <cstddef>
#include <sstream>
#include <string>

#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

Record read(const std::string& text) {
  std::istringstream in(text);
  return read_record(in, "test.csv");
}

const std::string small =
    "# saltus-record: 1\n"
    "# model: hopper\n"
    "# origin: a bench: two masses\n"
    "# inputs: u [N]\n"
    "# outputs: y_M [m], v_M [m/s]\n"
    "# licence: MIT\n"
    "experiment,t,chart,u,y_M,v_M\n"
    "0,0,Flight,0.5,1.25,-2\n"
    "0,0.1,Stance,-0.5,1.5,2e-3\n"
    "1,-3,,0,1,.5\n";

}  // namespace

TEST_CASE("a record is read column by column") {
  const Record r = read(small);
  CHECK(r.name == "test.csv");
  CHECK(r.model == "hopper");
  CHECK(r.sections.empty());
  CHECK_FALSE(r.sections_per_cycle);
  CHECK_FALSE(r.clock_paced());
  REQUIRE(r.notes.size() == 2);
  CHECK(r.notes[0] == std::pair<std::string, std::string>("origin", "a bench: two masses"));
  CHECK(r.notes[1] == std::pair<std::string, std::string>("licence", "MIT"));
  CHECK(r.rows() == 3);
  CHECK(r.experiment == std::vector<int>{0, 0, 1});
  CHECK(r.t == std::vector<double>{0.0, 0.1, -3.0});
  CHECK(r.cycle.empty());
  CHECK(r.section.empty());
  CHECK(r.chart == std::vector<int>{0, 1, -1});
  CHECK(r.chart_names == std::vector<std::string>{"Flight", "Stance"});
  REQUIRE(r.inputs.size() == 1);
  CHECK(r.inputs[0].name == "u");
  CHECK(r.inputs[0].unit == "N");
  CHECK(r.inputs[0].values == std::vector<double>{0.5, -0.5, 0.0});
  REQUIRE(r.outputs.size() == 2);
  CHECK(r.outputs[1].name == "v_M");
  CHECK(r.outputs[1].unit == "m/s");
  CHECK(r.outputs[1].values == std::vector<double>{-2.0, 2e-3, 0.5});
}

TEST_CASE("a byte-order mark, CRLF, spaces, empty lines and a missing last line end change nothing") {
  std::string text = "\xEF\xBB\xBF";
  for (const char c : small) {
    if (c == '\n') {
      text += " \t\r\n\r\n";
    } else if (c == ',') {
      text += " ,\t ";
    } else {
      text += c;
    }
  }
  text.resize(text.size() - 6);
  const Record a = read(small);
  const Record b = read(text);
  CHECK(b.model == a.model);
  CHECK(b.notes == a.notes);
  CHECK(b.t == a.t);
  CHECK(b.chart == a.chart);
  CHECK(b.chart_names == a.chart_names);
  CHECK(b.inputs[0].unit == a.inputs[0].unit);
  CHECK(b.outputs[0].values == a.outputs[0].values);
  CHECK(b.outputs[1].values == a.outputs[1].values);
}

TEST_CASE("an empty cell or nan is a missing value, of an output or of an input") {
  const Record r = read(
      "# saltus-record: 1\n# input: u\n# output: y\nexperiment,t,u,y\n"
      "0,0,1,\n0,1,,2\n0,2,nan,NaN\n0,3,+1, -nan \n");
  CHECK(r.inputs[0].unit.empty());
  const auto missing = [](const Channel& c, std::size_t row) { return std::isnan(c.values[row]); };
  CHECK_FALSE(missing(r.inputs[0], 0));
  CHECK(missing(r.outputs[0], 0));
  CHECK(missing(r.inputs[0], 1));
  CHECK_FALSE(missing(r.outputs[0], 1));
  CHECK(missing(r.inputs[0], 2));
  CHECK(missing(r.outputs[0], 2));
  CHECK(r.inputs[0].values[3] == 1.0);
  CHECK(missing(r.outputs[0], 3));
}

TEST_CASE("the columns may stand in any order, and a machine may have no input") {
  const Record r = read(
      "#saltus-record:1\n#outputs:angle [\xC2\xB0], rate[rad/s] ,torque [N, m]\n"
      "torque,t,rate,angle,experiment\n3,0,2,1,7\n");
  CHECK(r.inputs.empty());
  REQUIRE(r.outputs.size() == 3);
  CHECK(r.outputs[0].unit == "\xC2\xB0");
  CHECK(r.outputs[1].name == "rate");
  CHECK(r.outputs[2].unit == "N, m");
  CHECK(r.outputs[0].values[0] == 1.0);
  CHECK(r.outputs[1].values[0] == 2.0);
  CHECK(r.outputs[2].values[0] == 3.0);
  CHECK(r.experiment[0] == 7);
}

TEST_CASE("every digit of a number counts, whatever the locale of the stream") {
  const Record r = read(
      "# saltus-record: 1\n# outputs: y\nexperiment,t,y\n"
      "0,0,0.1\n0,1,1.7976931348623157e308\n0,2,4.9406564584124654e-324\n0,3,-0\n");
  CHECK(r.outputs[0].values[0] == 0.1);
  CHECK(r.outputs[0].values[1] == 1.7976931348623157e308);
  CHECK(r.outputs[0].values[2] == 4.9406564584124654e-324);
  CHECK(std::signbit(r.outputs[0].values[3]));
}

TEST_CASE("a stream that throws is read all the same") {
  std::istringstream in(small);
  in.exceptions(std::ios::failbit | std::ios::badbit | std::ios::eofbit);
  CHECK(read_record(in, "test.csv").rows() == 3);
}

TEST_CASE("experiments are runs of rows") {
  const auto list = experiments(read(small));
  REQUIRE(list.size() == 2);
  CHECK(list[0].id == 0);
  CHECK(list[0].first_row == 0);
  CHECK(list[0].rows == 2);
  CHECK(list[1].id == 1);
  CHECK(list[1].first_row == 2);
  CHECK(list[1].rows == 1);
  CHECK(experiments(Record{}).empty());
}

TEST_CASE("a clock-paced record of a hopper is read whole") {
  const Record r = read_record(SALTUS_TEST_DATA "/hopper/open-none.csv");
  CHECK(r.model == "hopper");
  CHECK(r.clock_paced());
  CHECK(r.sections_per_cycle == 32);
  CHECK(r.cycle_period == 1.0);
  CHECK(r.stimulus_period_cycles == 64);
  CHECK(r.settle_cycles == 40);
  CHECK(r.notes == std::vector<std::pair<std::string, std::string>>{{"repeats", "4"}, {"experiments", "7"}});
  REQUIRE(r.rows() == 66304);  // 7 experiments of 296 cycles of 32 sections
  CHECK(r.outputs[0].values.front() == 1.853805);
  CHECK(r.outputs[1].values.back() == -1.907674);
  const auto list = experiments(r);
  REQUIRE(list.size() == 7);
  for (const Experiment& e : list) CHECK(e.rows == 9472);

  // Sums of the columns, summed exactly by another program.
  const auto sum = [](const auto& column, bool magnitudes) {
    long double total = 0.0L;
    for (const auto v : column)
      total += magnitudes ? std::abs(static_cast<long double>(v)) : static_cast<long double>(v);
    return static_cast<double>(total);
  };
  CHECK(sum(r.experiment, false) == 198912.0);
  CHECK(sum(r.cycle, false) == 9779840.0);
  CHECK(sum(r.section, false) == 1027712.0);
  CHECK(sum(r.t, false) == 9811956.0);
  CHECK(std::abs(sum(r.inputs[0].values, false) - 0.498317) < 1e-9);
  CHECK(std::abs(sum(r.inputs[0].values, true) - 18599.225145) < 1e-9);
  CHECK(std::abs(sum(r.outputs[0].values, true) - 126760.775794) < 1e-9);
  CHECK(std::abs(sum(r.outputs[1].values, false) + 0.12533584525) < 1e-9);
  CHECK(std::abs(sum(r.outputs[1].values, true) - 81489.48900960667) < 1e-8);
}
