#include "tests/support/catch.hpp"
#include "tests/support/htf_table.hpp"
#include "tests/support/program.hpp"

#include <nlohmann/json.hpp>

using namespace saltus::test;

namespace {

std::vector<int> all_lines() {
  std::vector<int> q;
  for (int i = 1; i <= 640; ++i) q.push_back(i);
  return q;
}

}  // namespace

TEST_CASE("The exact harmonics are the reference's, every one, for both families of sections") {
  const Folder folder;
  REQUIRE(folder.run({"htf", "hopper", "--csv", "clock.csv"}).status == 0);
  REQUIRE(folder.run({"htf", "hopper", "--sections", "kinematic", "--csv", "kinematic.csv"}).status == 0);
  const HtfTable clock(folder.path("clock.csv")), kinematic(folder.path("kinematic.csv"));
  CHECK(clock.header() == "m,f,output,re,im");
  const auto lines = all_lines();
  const auto compare = [&](const HtfTable& table, const HtfTable& reference, double tolerance) {
    CHECK(table.entries().size() == 7 * 640 * 2);
    for (const char* output : {"y_M", "v_M"}) {
      const double norm = reference.size(0, output, lines).norm;
      for (int m = -3; m <= 3; ++m) {
        INFO(output << ", m = " << m);
        CHECK(table.error(reference, m, output, lines).norm < tolerance * norm);
      }
    }
  };
  compare(clock, reference_isochrons(), 1e-8);
  compare(kinematic, reference_kinematic(), 1e-8);

  // What the second halves the first: a projection, the mean of cos^2.
  for (const auto& [output, gain] : {std::pair{"y_M", 2.0231}, std::pair{"v_M", 1.9945}}) {
    CHECK(std::abs(clock.size(0, output, lines).norm / kinematic.size(0, output, lines).norm - gain) < 5e-5);
  }
}

TEST_CASE("The table gives the norms and the peak to the figures known") {
  const Folder folder;
  const auto holds = [](const std::string& text, const std::vector<std::string>& words) {
    std::size_t at = 0;
    for (const std::string& word : words) {  // in this order
      INFO(word << " in " << text);
      at = text.find(word, at);
      CHECK(at != text.npos);
    }
  };
  const auto clock = folder.run({"htf", "hopper", "--harmonics", "2"});
  REQUIRE(clock.status == 0);
  holds(clock.out, {"isochrons", "640 lines", "\n  y_M ", "0.00406", "0.09899", "1.00000", "0.01300", "0.00157",
                    "\n  v_M ", "0.01506", "0.17307", "1.00000", "0.05217", "0.01157", "y_M 0.502819 m/N at f = 0.29"});
  const auto kinematic = folder.run({"htf", "hopper", "--harmonics", "2", "--sections", "kinematic"});
  REQUIRE(kinematic.status == 0);
  holds(kinematic.out, {"kinematic phase", "\n  y_M ", "0.64889", "0.09297", "1.00000", "0.07757", "0.36857",
                        "\n  v_M ", "2.08518", "0.18870", "1.00000", "0.22247", "1.17287"});
}

TEST_CASE("JSON holds what CSV holds") {
  const Folder folder;
  REQUIRE(
      folder.run({"htf", "hopper", "--band", "2", "--harmonics", "1", "--csv", "x.csv", "--json", "x.json"}).status ==
      0);
  const auto written = nlohmann::json::parse(folder.read("x.json"));
  const HtfTable table(folder.path("x.csv"));
  CHECK(written.at("model") == "hopper");
  CHECK(written.at("sections") == "clock");
  CHECK(written.at("sections_per_cycle") == 32);
  CHECK(std::abs(written.at("period").get<double>() - 1.0) < 1e-15);
  CHECK(written.at("htf").size() == 3 * 128 * 2);
  REQUIRE(table.entries().size() == 3 * 128 * 2);
  double worst = 0.0;
  for (const auto& row : written.at("htf")) {
    const int line = static_cast<int>(std::lround(row.at("f").get<double>() * 64));
    const auto& entry = table.at(row.at("m"), line, row.at("output"));
    worst = std::max(worst, std::abs(entry.value - std::complex<double>(row.at("re"), row.at("im"))));
  }
  CHECK(worst < 1e-15);
}

TEST_CASE("Finer steps change the harmonics no more, and parameters change them") {
  const Folder folder;
  REQUIRE(folder.run({"htf", "hopper", "--csv", "a.csv"}).status == 0);
  REQUIRE(folder.run({"htf", "hopper", "--ticks", "2048", "--csv", "b.csv"}).status == 0);
  REQUIRE(folder.run({"htf", "hopper", "--set", "k=10.5", "--set", "b=5.2", "--csv", "c.csv"}).status == 0);
  const HtfTable a(folder.path("a.csv")), b(folder.path("b.csv")), c(folder.path("c.csv"));
  const auto lines = all_lines();
  CHECK(b.error(a, 0, "y_M", lines).norm < 1e-8 * a.size(0, "y_M", lines).norm);
  CHECK(c.error(a, 0, "y_M", lines).norm > 1e-2 * a.size(0, "y_M", lines).norm);
}

TEST_CASE("Pictures are drawn whole") {
  const Folder folder;
  for (const std::string harmonics : {"0", "3"}) {
    REQUIRE(folder.run({"htf", "hopper", "--harmonics", harmonics, "--picture", "x.svg"}).status == 0);
    CHECK(folder.files() == std::vector<std::string>{"x.svg"});
    CHECK(folder.read("x.svg").find("</svg>") != std::string::npos);
  }
  // One line, a single point: H_0 is there, and nothing is drawn where nothing is.
  CHECK(folder.run({"htf", "hopper", "--resolution", "1", "--band", "1", "--picture", "x.svg"}).status == 0);
}

TEST_CASE("Without gnuplot there is a message, and no file at all") {
  const Folder folder;
  std::filesystem::create_directory(folder.path("nothing"));
  const auto done = folder.run({"htf", "hopper", "--csv", "x.csv", "--picture", "x.svg"}, "nothing");
  CHECK(done.status == 1);
  CHECK(done.err.find("install the package gnuplot-nox") != done.err.npos);
  CHECK(folder.files() == std::vector<std::string>{"nothing"});
}

TEST_CASE("Questions without an answer are refused") {
  const Folder folder;
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases{
      {{"--band", "0.001"}, "no line lies in the band"},
      {{"--band", "100"}, "--band"},
      {{"--band", "nan"}, "--band"},
      {{"--harmonics", "16"}, "--harmonics"},
      {{"--harmonics", "-1"}, "--harmonics"},
      {{"--resolution", "0"}, "--resolution"},
      {{"--resolution", "1e9"}, "--resolution"},
      {{"--sections", "both"}, "--sections"},
      {{"--kinematic", "1.9,0,0.3,1.9"}, "add --sections kinematic"},
      {{"--sections", "kinematic", "--kinematic", "1.9,0,0.3"}, "--kinematic"},
      {{"--sections", "kinematic", "--kinematic", "1.9,0,0,1.9"}, "the scales s_p and s_v must be positive"},
      {{"--sections", "kinematic", "--kinematic", "nan,0,1,1"}, "give four finite numbers"},
      {{"--sections", "kinematic", "--kinematic", "1.9,0,inf,1"}, "give four finite numbers"}};
  for (auto [arguments, words] : cases) {
    INFO(words);
    arguments.insert(arguments.begin(), {"htf", "hopper", "--csv", "x.csv"});
    const auto done = folder.run(arguments);
    CHECK(done.status == 2);
    INFO(done.err);
    CHECK(done.err.find(words) != done.err.npos);
    CHECK(done.out.empty());
  }
  // The orbit does not go round this point: its sections are never met.
  const auto outside = folder.run({"htf", "hopper", "--sections", "kinematic", "--kinematic", "50,0,1,1"});
  CHECK(outside.status == 1);
  CHECK(outside.err.find("--kinematic where the orbit does not circle its point") != outside.err.npos);
  CHECK(folder.files().empty());
}
