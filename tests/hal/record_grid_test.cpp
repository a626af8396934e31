#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "hal/record.hpp"
#include "tests/support/catch.hpp"

using namespace saltus;

namespace {

constexpr double absent = std::numeric_limits<double>::quiet_NaN();

Record read(const std::string& text) {
  std::istringstream in(text);
  return read_record(in, "test.csv");
}

// Equal, where NaN is equal to NaN.
bool same(const std::vector<double>& a, const std::vector<double>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](double p, double q) { return p == q || (std::isnan(p) && std::isnan(q)); });
}

std::string header(const std::string& more) {
  return "# saltus-record: 1\n# inputs: u\n# outputs: y\n# sections-per-cycle: 2\n" + more +
         "experiment,cycle,section,t,u,y\n";
}

// Why the experiment is refused; empty where it is laid out.
std::string refusal(const Record& record, const Experiment& experiment) {
  try {
    (void)on_grid(record, experiment);
    return "";
  } catch (const RecordError& error) {
    return error.what();
  }
}

// Takes one row in `every` out of a record, at random, and the input of one more.
void damage(Record& r, int every, std::size_t& rows, std::size_t& inputs) {
  std::mt19937 draw(7);
  const auto drop = [&draw, every] { return draw() % static_cast<unsigned>(every) == 0; };
  Record kept = r;
  kept.experiment.clear();
  kept.t.clear();
  kept.cycle.clear();
  kept.section.clear();
  kept.inputs[0].values.clear();
  for (Channel& c : kept.outputs) c.values.clear();
  for (std::size_t row = 0; row < r.rows(); ++row) {
    const bool first_or_last = r.t[row] == 0.0 || r.t[row] == 295.96875;
    if (!first_or_last && drop()) {
      ++rows;
      continue;
    }
    const bool no_input = drop();
    inputs += no_input ? 1 : 0;
    kept.experiment.push_back(r.experiment[row]);
    kept.t.push_back(r.t[row]);
    kept.cycle.push_back(r.cycle[row]);
    kept.section.push_back(r.section[row]);
    kept.inputs[0].values.push_back(no_input ? absent : r.inputs[0].values[row]);
    for (std::size_t c = 0; c < r.outputs.size(); ++c) kept.outputs[c].values.push_back(r.outputs[c].values[row]);
  }
  r = std::move(kept);
}

}  // namespace

TEST_CASE("an experiment is laid out over whole cycles, with NaN where there is no row") {
  const Record r = read(header("") + "0,0,0,0,9,9\n3,7,1,0,1,10\n3,8,0,1,2,\n3,9,1,2,,30\n4,0,0,0,9,9\n");
  const auto list = experiments(r);
  REQUIRE(list.size() == 3);
  const Grid g = on_grid(r, list[1]);
  CHECK(g.sections == 2);
  CHECK(g.first_cycle == 7);
  CHECK(g.cycles == 3);
  REQUIRE(g.inputs.size() == 1);
  REQUIRE(g.outputs.size() == 1);
  CHECK(same(g.inputs[0], {absent, 1, 2, absent, absent, absent}));
  CHECK(same(g.outputs[0], {absent, 10, absent, absent, absent, 30}));
  CHECK(g.missing_rows == 3);
  CHECK(g.filled_inputs == 0);  // the header has no stimulus period
  CHECK(g.missing_inputs == 4);
}

TEST_CASE("a missing input is that of another repeat: the nearest before it, or else the first after it") {
  const Record r = read(header("# stimulus-period-cycles: 1\n") +
                        "0,0,1,0.5,11,0\n0,1,0,1,20,0\n0,2,1,2.5,13,0\n0,3,0,3,,0\n0,4,1,4.5,15,0\n");
  const Grid g = on_grid(r, experiments(r)[0]);
  CHECK(same(g.inputs[0], {20, 11, 20, 11, 20, 13, 20, 13, 20, 15}));
  CHECK(same(g.outputs[0], {absent, 0, 0, absent, absent, 0, 0, absent, absent, 0}));
  CHECK(g.missing_rows == 5);
  CHECK(g.filled_inputs == 6);
  CHECK(g.missing_inputs == 0);
}

TEST_CASE("an input missing in every repeat stays missing") {
  const Record r =
      read(header("# stimulus-period-cycles: 2\n") + "0,0,0,0,1,0\n0,1,0,1,2,0\n0,2,0,2,,0\n0,2,1,3,5,0\n");
  const Grid g = on_grid(r, experiments(r)[0]);
  CHECK(same(g.inputs[0], {1, 5, 2, absent, 1, 5}));
  CHECK(g.filled_inputs == 2);
  CHECK(g.missing_inputs == 1);
  const Record longer = read(header("# stimulus-period-cycles: 65536\n") + "0,0,0,0,1,0\n0,1,0,1,2,0\n");
  CHECK(on_grid(longer, experiments(longer)[0]).missing_inputs ==
        2);  // a period longer than the record repeats nothing
}

TEST_CASE("a whole record lies on its grid as it stands in the file") {
  const Record r = read_record(SALTUS_TEST_DATA "/hopper/open-none.csv");
  for (const Experiment& e : experiments(r)) {
    const Grid g = on_grid(r, e);
    CHECK(g.first_cycle == 0);
    CHECK(g.cycles == 296);
    CHECK(g.missing_rows == 0);
    CHECK(g.filled_inputs == 0);
    CHECK(g.missing_inputs == 0);
    const auto begin = static_cast<std::ptrdiff_t>(e.first_row);
    const auto& y = r.outputs[1].values;
    CHECK(std::equal(g.outputs[1].begin(), g.outputs[1].end(), y.begin() + begin));
  }
}

TEST_CASE("rows taken out of a record leave gaps in its outputs, and its inputs are restored exactly") {
  const Record whole = read_record(SALTUS_TEST_DATA "/hopper/open-none.csv");
  Record r = whole;
  std::size_t dropped_rows = 0;
  std::size_t dropped_inputs = 0;
  damage(r, 100, dropped_rows, dropped_inputs);
  REQUIRE(dropped_rows > 500);
  const auto list = experiments(r);
  const auto whole_list = experiments(whole);
  REQUIRE(list.size() == 7);
  std::size_t missing_rows = 0;
  std::size_t filled = 0;
  std::size_t wrong = 0;
  std::size_t gaps = 0;
  for (std::size_t e = 0; e < list.size(); ++e) {
    const Grid g = on_grid(r, list[e]);
    const Grid full = on_grid(whole, whole_list[e]);
    REQUIRE(g.cycles == 296);
    CHECK(g.missing_inputs == 0);
    CHECK(g.inputs == full.inputs);
    missing_rows += g.missing_rows;
    filled += g.filled_inputs;
    for (std::size_t i = 0; i < g.outputs[0].size(); ++i) {
      const double y = g.outputs[0][i];
      gaps += std::isnan(y) ? 1 : 0;
      wrong += std::isnan(y) || y == full.outputs[0][i] ? 0 : 1;
    }
  }
  CHECK(missing_rows == dropped_rows);
  CHECK(filled == dropped_rows + dropped_inputs);
  CHECK(gaps == dropped_rows);
  CHECK(wrong == 0);
}

TEST_CASE("what cannot be laid out is refused") {
  const Record free = read("# saltus-record: 1\n# outputs: y\nexperiment,t,y\n0,0,0\n");
  CHECK(refusal(free, experiments(free)[0]) ==
        "test.csv: the record is not sampled at sections of a cycle; give it the columns `cycle` and `section`, and `# "
        "sections-per-cycle: N`");

  const Record good = read(header("") + "0,0,0,0,1,1\n0,0,1,1,2,2\n0,1,0,2,3,3\n");
  const Experiment all{0, 0, 3};
  CHECK(refusal(good, all).empty());
  const std::string no_rows =
      "test.csv: experiment 0: it has no rows, or not in every column; take it from experiments";
  const auto begins = [](const std::string& text, const std::string& with) {
    return text.substr(0, with.size()) == with;
  };
  CHECK(begins(refusal(good, {0, 0, 0}), no_rows));
  CHECK(begins(refusal(good, {0, 1, 3}), no_rows));
  CHECK(begins(refusal(good, {0, 2, std::numeric_limits<std::size_t>::max()}), no_rows));

  // Records made by a program, which nobody has checked.
  Record r = good;
  r.outputs[0].values.pop_back();
  CHECK(begins(refusal(r, all), no_rows));
  const auto with = [&good](auto&& spoil) {
    Record spoiled = good;
    spoil(spoiled);
    return spoiled;
  };
  const std::string order = "test.csv: experiment 0: its rows are not in order; ";
  CHECK(begins(refusal(with([](Record& x) { x.section[1] = 2; }), all), order));
  CHECK(begins(refusal(with([](Record& x) { x.section[1] = -1; }), all), order));
  CHECK(begins(refusal(with([](Record& x) { x.section[1] = 0; }), all), order));
  CHECK(begins(refusal(with([](Record& x) { x.cycle[1] = 5; }), all), order));
  CHECK(begins(refusal(with([](Record& x) { x.cycle[1] = -5; }), all), order));
  const std::string span = "test.csv: experiment 0: its cycles span no grid; ";
  CHECK(begins(refusal(with([](Record& x) { x.cycle[2] = -1; }), all), span));
  CHECK(begins(refusal(with([](Record& x) { x.cycle[2] = std::numeric_limits<int>::max(); }), all), span));
  CHECK(begins(refusal(with([](Record& x) { x.sections_per_cycle = 0; }), all), span));
}
