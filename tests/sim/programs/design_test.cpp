// The rules of Ankarali & Cowan 2014, section V, written out here once more and held against the tables.
#include "tests/support/catch.hpp"
#include "tests/support/program.hpp"

#include <nlohmann/json.hpp>

#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <sstream>
#include <tuple>

using saltus::test::Folder;

namespace {

struct Row {
  int experiment, line;
  double f, amplitude, phase;
};

std::vector<Row> table(const std::string& csv) {
  std::istringstream in(csv);
  std::string line;
  std::getline(in, line);
  CHECK(line == "experiment,line,f,amplitude,phase");
  std::vector<Row> rows;
  while (std::getline(in, line)) {
    Row r{};
    char c = 0;
    std::istringstream cells(line);
    REQUIRE((cells >> r.experiment >> c >> r.line >> c >> r.f >> c >> r.amplitude >> c >> r.phase));
    rows.push_back(r);
  }
  return rows;
}

// Rule (16): no line on a multiple of half the pumping frequency, which is line `period`.
bool half_multiple(int line, int period) {
  for (int m = 0; m * period <= 2 * line; ++m) {
    if (m * period == 2 * line) return true;
  }
  return false;
}

// The pairwise rule: neither sum nor difference on a multiple of the pumping frequency.
bool clash(int a, int b, int period) {
  for (int m = 0; m * period <= a + b; ++m) {
    if (a + b == m * period || a - b == m * period || b - a == m * period) return true;
  }
  return false;
}

// Every tone is allowed, no two of an experiment clash, every allowed line below `last` is there `times` times.
void check_rules(const std::vector<Row>& rows, int period, int last, int times) {
  std::map<int, std::vector<int>> experiments;
  std::map<int, int> met;
  int broken = 0;
  for (const Row& r : rows) {
    broken += half_multiple(r.line, period) ? 1 : 0;
    for (const int other : experiments[r.experiment]) broken += clash(r.line, other, period) ? 1 : 0;
    experiments[r.experiment].push_back(r.line);
    ++met[r.line];
    CHECK(std::abs(r.f - static_cast<double>(r.line) / period) < 1e-8);
  }
  CHECK(broken == 0);
  for (int q = 1; q <= last; ++q) {
    if (met[q] != (half_multiple(q, period) ? 0 : times)) FAIL("line " << q << " is there " << met[q] << " times");
  }
  CHECK(met.rbegin()->first <= last);
}

std::map<int, int> sizes(const std::vector<Row>& rows) {
  std::map<int, int> n;
  for (const Row& r : rows) ++n[r.experiment];
  return n;
}

}  // namespace

TEST_CASE("Twenty experiments of 31 tones cover all 620 lines, and no two tones of one clash") {
  const Folder folder;
  const auto done = folder.run({"design", "--csv", "tones.csv", "--json", "tones.json"});
  REQUIRE(done.status == 0);
  CHECK(done.out.find("620 lines") != done.out.npos);
  CHECK(done.out.find("no plan has fewer than 20") != done.out.npos);
  const auto rows = table(folder.read("tones.csv"));
  CHECK(rows.size() == 620);
  check_rules(rows, 64, 639, 1);
  const auto n = sizes(rows);
  CHECK(n.size() == 20);
  for (const auto& [experiment, tones] : n) CHECK(tones == 31);
  for (const Row& r : rows) {
    CHECK(r.amplitude == 0.01);
    CHECK((r.phase >= 0.0 && r.phase < 2.0 * std::numbers::pi));
  }
  const auto json = nlohmann::json::parse(folder.read("tones.json"));
  CHECK(json.at("lines") == 620);
  CHECK(json.at("least_experiments") == 20);
  REQUIRE(json.at("experiments").size() == 20);
  std::size_t i = 0;
  for (const auto& experiment : json.at("experiments")) {
    CHECK(experiment.at("crest_factor") > 1.4);
    for (const auto& tone : experiment.at("tones")) {
      CHECK(tone.at("line") == rows[i].line);
      CHECK(tone.at("phase") == rows[i].phase);  // the text holds every bit
      ++i;
    }
  }
  CHECK(i == 620);
}

TEST_CASE("The paper's 80 random subsets obey the rules, and fewer than 20 are refused with the reason") {
  const Folder folder;
  REQUIRE(folder.run({"design", "--subsets", "80", "--csv", "a.csv"}).status == 0);
  const auto rows = table(folder.read("a.csv"));
  check_rules(rows, 64, 639, 1);
  const auto n = sizes(rows);
  CHECK(n.size() == 80);
  for (const auto& [experiment, tones] : n) CHECK((tones == 7 || tones == 8));

  REQUIRE(folder.run({"design", "--subsets", "80", "--csv", "b.csv"}).status == 0);
  REQUIRE(folder.run({"design", "--subsets", "80", "--seed", "2", "--csv", "c.csv"}).status == 0);
  CHECK(folder.read("a.csv") == folder.read("b.csv"));
  const auto other = table(folder.read("c.csv"));
  check_rules(other, 64, 639, 1);
  int moved = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) moved += rows[i].line != other[i].line ? 1 : 0;
  CHECK(moved > 500);

  const Folder empty;
  const auto refused = empty.run({"design", "--subsets", "19", "--csv", "x.csv"});
  CHECK(refused.status == 2);
  CHECK(refused.err.find("--subsets 19: give at least 20") != refused.err.npos);
  CHECK(refused.err.find("20 lines exclude one another") != refused.err.npos);
  CHECK(empty.run({"design", "--subsets", "621", "--csv", "x.csv"}).status == 2);
  CHECK(empty.files().empty());
}

TEST_CASE("The rules hold for other periods and bands, odd ones too") {
  const Folder folder;
  for (const int period : {3, 5, 12, 33, 63, 100, 127, 128}) {
    for (const double band : {0.9, 3.0, 7.3}) {
      INFO(period << " cycles, below " << band);
      const auto done =
          folder.run({"design", "--period", std::to_string(period), "--band", std::to_string(band), "--csv", "x.csv"});
      REQUIRE(done.status == 0);
      const auto rows = table(folder.read("x.csv"));
      int last = 0;
      while (static_cast<double>(last + 1) / period < band - 1e-9) ++last;
      check_rules(rows, period, last, 1);
      // No plan has fewer experiments than there are lines that answer on one set of lines.
      std::size_t clique = 0;
      for (int q = 1; q <= last; ++q) {
        std::size_t together = half_multiple(q, period) ? 0 : 1;
        for (int p = 1; p <= last; ++p) together += p != q && !half_multiple(q, period) && clash(p, q, period) ? 1 : 0;
        clique = std::max(clique, together);
      }
      CHECK(sizes(rows).size() == clique);
    }
  }
}

TEST_CASE("Half multiples join the twenty experiments, a quarter turn apart, whatever else is asked for") {
  const Folder folder;
  const auto done = folder.run({"design", "--half-multiples", "--csv", "x.csv", "--json", "x.json"});
  REQUIRE(done.status == 0);
  CHECK(done.out.find("640 lines") != done.out.npos);
  CHECK(done.out.find("20 experiments of 32 to 33 tones; no plan has fewer than 20") != done.out.npos);
  CHECK(nlohmann::json::parse(folder.read("x.json")).at("least_experiments") == 20);
  REQUIRE(folder
              .run({"design", "--half-multiples", "--crest", "--peak", "0.04", "--realisations", "2", "--tones", "12",
                    "--period", "128", "--band", "2", "--csv", "y.csv"})
              .status == 0);
  for (const auto& [file, period, realisations] : {std::tuple("x.csv", 64, 1), std::tuple("y.csv", 128, 2)}) {
    const auto rows = table(folder.read(file));
    const auto experiments = static_cast<int>(sizes(rows).size());
    std::map<std::pair<int, int>, std::vector<Row>> played;  // by realisation and line
    std::map<int, std::vector<int>> lines;
    for (const Row& r : rows) {
      played[{r.experiment / (experiments / realisations), r.line}].push_back(r);
      for (const int other : lines[r.experiment]) CHECK_FALSE(clash(r.line, other, period));
      lines[r.experiment].push_back(r.line);
    }
    for (const auto& [key, plays] : played) {
      const int q = key.second;
      REQUIRE(plays.size() == (q != 0 && half_multiple(q, period) ? 2u : 1u));
      if (q == 0) CHECK(plays[0].phase == 0.0);
      if (plays.size() == 2) CHECK(std::abs(std::cos(plays[1].phase - plays[0].phase)) < 1e-14);
    }
  }
  CHECK(folder.run({"design", "--half-multiples", "--period", "128"}).status == 2);
  CHECK(folder.run({"design", "--half-multiples", "--period", "128", "--tones", "64"}).status == 0);
}

TEST_CASE("A design for two inputs says what each gets") {
  const Folder folder;
  REQUIRE(folder
              .run({"design", "--inputs", "2", "--share", "1,0.5", "--period", "8", "--band", "2", "--csv", "x.csv",
                    "--samples", "s.csv", "--json", "x.json"})
              .status == 0);
  std::istringstream in(folder.read("x.csv"));
  std::string line;
  std::getline(in, line);
  CHECK(line == "experiment,line,f,amplitude,phase,input");
  double sums[3] = {};
  while (std::getline(in, line)) {
    std::vector<std::string> cells;
    std::istringstream row(line);
    for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
    REQUIRE(cells.size() == 6);
    sums[cells[5] == "1" ? 1 : 2] += std::stod(cells[3]);
  }
  CHECK(std::abs(sums[1] - 0.01 * 2 * 12) < 1e-12);  // 12 lines, each in two plays
  CHECK(std::abs(sums[2] - 0.5 * sums[1]) < 1e-12);
  CHECK(folder.read("s.csv").find("experiment,sample,u1,u2\n") == 0);
  CHECK(nlohmann::json::parse(folder.read("x.json")).at("least_experiments") == 8);
  CHECK(folder.run({"design", "--inputs", "9"}).status == 2);
}

TEST_CASE("Opposed experiments come in pairs that add up to nothing, and samples are the sum of the tones") {
  const Folder folder;
  REQUIRE(folder
              .run({"design", "--opposed", "--period", "8", "--band", "2", "--amplitude", "0.25", "--csv", "t.csv",
                    "--samples", "s.csv"})
              .status == 0);
  const auto rows = table(folder.read("t.csv"));
  check_rules(rows, 8, 15, 2);
  std::map<int, std::vector<double>> samples;
  std::istringstream in(folder.read("s.csv"));
  std::string line;
  std::getline(in, line);
  CHECK(line == "experiment,sample,u");
  int experiment = 0;
  std::size_t n = 0;
  double u = 0.0;
  for (char c = 0; in >> experiment >> c >> n >> c >> u;) {
    CHECK(samples[experiment].size() == n);
    samples[experiment].push_back(u);
  }
  REQUIRE(samples.size() == sizes(rows).size());
  for (const auto& [e, series] : samples) {
    REQUIRE(series.size() == 256);  // 32 sections by 8 cycles
    for (std::size_t i = 0; i < series.size(); ++i) {
      double sum = 0.0;
      for (const Row& r : rows) {
        if (r.experiment != e) continue;
        sum += r.amplitude * std::cos(2.0 * std::numbers::pi * r.line * static_cast<double>(i) / 256.0 + r.phase);
      }
      if (std::abs(series[i] - sum) > 1e-13) FAIL("experiment " << e << ", sample " << i);
      if (std::abs(series[i] + samples[e ^ 1][i]) > 1e-14) FAIL("experiments " << e << " and its opposite, " << i);
    }
  }
}

TEST_CASE("A plan that cannot be is refused by the option's name") {
  const Folder folder;
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases{
      {{"--band", "100"}, "--band: lines lie between 0 and half the sections a cycle, 16"},
      {{"--band", "0"}, "--band"},
      {{"--band", "-1"}, "--band"},
      {{"--band", "nan"}, "--band"},
      {{"--band", "0.01"}, "no line lies in the band"},
      {{"--period", "2"}, "--period"},
      {{"--period", "1e9"}, "--period"},
      {{"--period", "129"}, "--period"},
      {{"--amplitude", "0"}, "--amplitude: give a positive number"},
      {{"--amplitude", "-0.01"}, "--amplitude"},
      {{"--amplitude", "nan"}, "--amplitude"},
      {{"--amplitude", "inf"}, "--amplitude"},
      {{"--seed", "-1"}, "--seed"},
      {{"--subsets", "0"}, "--subsets"},
      {{"--subsets", "5000"}, "--subsets"},
      {{"--sections-per-cycle", "1"}, "--sections-per-cycle"},
      {{"--sections-per-cycle", "4096", "--period", "128", "--band", "2048"}, "more than 16384 lines lie in the band"}};
  for (auto [arguments, words] : cases) {
    INFO(arguments[0] << " " << arguments[1]);
    arguments.insert(arguments.begin(), "design");
    arguments.insert(arguments.end(), {"--csv", "x.csv"});
    const auto done = folder.run(arguments);
    CHECK(done.status == 2);
    INFO(done.err);
    CHECK(done.err.find(words) != done.err.npos);
  }
  CHECK(folder.files().empty());
}
