// Campaigns on the emulated hopper, from the command line, against the reference tables.
#include "tests/support/catch.hpp"
#include "tests/support/htf_table.hpp"
#include "tests/support/program.hpp"

#include <nlohmann/json.hpp>

using nlohmann::json;
using namespace saltus::test;

namespace {

const std::complex<double> multiplier{-0.248983334736, 0.699333251798};

// The 620 lines below f = 10 that are no multiples of 1/2.
std::vector<int> campaign_lines() {
  std::vector<int> lines;
  for (int q = 1; q < 640; ++q) {
    if (q % 32 != 0) lines.push_back(q);
  }
  return lines;
}

// Root of the sum of squares over the 620 lines, of the difference from the reference over its H_0.
void check_norms(const HtfTable& table, const HtfTable& reference, double tolerance,
                 const std::vector<int>& harmonics = {-1, 0, 1}) {
  const auto lines = campaign_lines();
  for (const char* output : {"y_M", "v_M"}) {
    const double norm = reference.size(0, output, lines).norm;
    for (const int m : harmonics) {
      INFO(output << ", m = " << m);
      REQUIRE(table.lines(m, output) == lines);
      const double error = table.error(reference, m, output, lines).norm / norm;
      INFO(error);
      CHECK(error < tolerance);
    }
  }
}

// Every line of every harmonic, over the largest abs(H_0).
void check_every_line(const HtfTable& table, const HtfTable& reference, double tolerance) {
  const auto lines = campaign_lines();
  for (const char* output : {"y_M", "v_M"}) {
    const double largest = reference.size(0, output, lines).largest;
    for (int m = -3; m <= 3; ++m) {
      INFO(output << ", m = " << m);
      REQUIRE(table.lines(m, output) == lines);
      const double error = table.error(reference, m, output, lines).largest / largest;
      INFO(error);
      CHECK(error < tolerance);
    }
  }
}

// |fitted - true| of one form and output.
double fit_error(const json& campaign, const std::string& form, const std::string& output) {
  for (const json& fit : campaign.at("fits")) {
    if (fit.at("form") == form && fit.at("output") == output) {
      return std::abs(std::complex<double>(fit.at("re"), fit.at("im")) - multiplier);
    }
  }
  return std::nan("");
}

double best_error(const json& campaign) {
  const json& m = campaign.at("multipliers");
  REQUIRE(m.size() == 2);
  CHECK(std::abs(m[1].at("im").get<double>() + m[0].at("im").get<double>()) < 1e-12);
  return std::abs(std::complex<double>(m[0].at("re"), m[0].at("im")) - multiplier);
}

// The last number of the first line that begins so.
double last_number(const std::string& text, const std::string& start) {
  const auto at = text.find("\n" + start);
  if (at == text.npos) return std::nan("");
  const std::string line = text.substr(at + 1, text.find('\n', at + 1) - at - 1);
  return std::stod(line.substr(line.rfind(' ')));
}

}  // namespace

TEST_CASE("The paper's campaign gives the reference's harmonics and multipliers for both families of sections") {
  const Folder folder;
  const auto done = folder.run({"identify", "hopper", "--protocol", "paper", "--csv", "x.csv", "--json", "x.json"});
  REQUIRE(done.status == 0);
  CHECK(done.err.empty());
  CHECK(folder.files() == std::vector<std::string>{"x-kinematic.csv", "x.csv", "x.json"});
  const HtfTable clock(folder.path("x.csv")), kinematic(folder.path("x-kinematic.csv"));
  CHECK(clock.header() == "m,f,output,re,im,sigma,cycles");
  CHECK(clock.entries().size() == 620 * 7 * 2);
  for (const auto& [key, entry] : clock.entries()) CHECK((entry.cycles == 64 && std::isnan(entry.sigma)));
  check_norms(clock, reference_isochrons(), 2e-4);
  check_norms(kinematic, reference_kinematic(), 2e-3);

  const json campaigns = json::parse(folder.read("x.json"));
  REQUIRE(campaigns.size() == 2);
  CHECK(campaigns[0].at("sections") == "clock");
  CHECK(campaigns[1].at("sections") == "kinematic");
  CHECK(best_error(campaigns[0]) < 1e-5);
  CHECK(best_error(campaigns[1]) < 5e-5);
  for (const json& campaign : campaigns) {
    CHECK(campaign.at("samples") == 80 * 64 * 32);
    CHECK(campaign.at("status") == "ok");
    CHECK(
        (fit_error(campaign, "2 poles, 1 zero", "y_M") > 2e-3 && fit_error(campaign, "2 poles, 1 zero", "y_M") < 3e-3));
    CHECK(std::abs(fit_error(campaign, "2 poles, 1 zero", "v_M") - 1e-2) < 2e-3);
    const std::string note = campaign.at("notes").at(0);
    CHECK(note.find("after 20 settling cycles 2.6e-03 of the first transient is left") != note.npos);
  }
  for (const char* output : {"y_M", "v_M"}) CHECK(fit_error(campaigns[0], "image poles", output) < 1e-5);

  // The printed table: the first line of a name is the isochrons'. The lines are 620 here, 640 in the reference's
  // norms.
  CHECK(done.out.find("80 experiments of 20 + 64 cycles, 620 lines below f = 10, 0.01 N a tone") != done.out.npos);
  CHECK(std::abs(last_number(done.out, "  norm of H_-1 over H_0, y_M") - 0.0990) < 1e-3);
  CHECK(std::abs(last_number(done.out, "  norm of H_1 over H_0, y_M") - 0.0130) < 1e-3);
  CHECK(std::abs(last_number(done.out, "gain of H_0, isochrons over kinematic, y_M") - 2.0231) < 1e-3);
  CHECK(std::abs(last_number(done.out, "gain of H_0, isochrons over kinematic, v_M") - 1.9945) < 1e-3);
  for (const char* words :
       {"0.25 +- 0.70 i", "-0.248983 +- 0.699333 i", "0.502819 at f = 0.297", "0.64842", "2.09177"}) {
    INFO(words);
    CHECK(done.out.find(words) != done.out.npos);
  }
}

TEST_CASE("With 80 settling cycles the paper's campaign is ten times closer") {
  const Folder folder;
  REQUIRE(folder
              .run({"identify", "hopper", "--protocol", "paper", "--sections", "clock", "--settle", "80", "--csv",
                    "x.csv", "--json", "x.json"})
              .status == 0);
  CHECK(folder.files() == std::vector<std::string>{"x.csv", "x.json"});
  const HtfTable table(folder.path("x.csv"));
  check_norms(table, reference_isochrons(), 2e-5, {0});
  check_norms(table, reference_isochrons(), 1e-4, {-1, 1});  // without opposites, even-order distortion stays
  const json campaign = json::parse(folder.read("x.json"));
  CHECK(campaign.at("notes").empty());
  CHECK(best_error(campaign) < 1e-5);
}

TEST_CASE("Twenty experiments and their opposites give every line of every harmonic") {
  const Folder folder;
  REQUIRE(folder.run({"identify", "hopper", "--sections", "both", "--csv", "x.csv", "--json", "x.json"}).status == 0);
  const HtfTable clock(folder.path("x.csv")), kinematic(folder.path("x-kinematic.csv"));
  check_every_line(clock, reference_isochrons(), 2e-5);
  check_every_line(kinematic, reference_kinematic(), 2e-4);
  for (const auto& [key, entry] : clock.entries()) CHECK(entry.cycles == 128);  // each line twice
  const json campaigns = json::parse(folder.read("x.json"));
  for (const json& campaign : campaigns) {
    CHECK(campaign.at("samples") == 40 * 64 * 32);
    CHECK(best_error(campaign) < 1e-5);
    for (const char* output : {"y_M", "v_M"}) CHECK(fit_error(campaign, "image poles", output) < 1e-5);
    CHECK(campaign.at("multipliers")[0].at("sigma").is_null());  // nothing was repeated
    for (const json& h : campaign.at("harmonics")) CHECK(h.at("error") < 2e-4);
  }
}

TEST_CASE("A record that was saved gives the harmonics it was saved from") {
  const Folder folder;
  for (const bool noisy : {false, true}) {
    INFO("with noise: " << noisy);
    std::vector<std::string> arguments{"identify", "hopper", "--save", "run.csv", "--csv", "a.csv", "--json", "a.json"};
    if (noisy) arguments.insert(arguments.end(), {"--noise", "0.001,0.006", "--periods", "2", "--period", "32"});
    REQUIRE(folder.run(arguments).status == 0);
    const auto read = folder.run({"identify", "hopper", "--record", "run.csv", "--csv", "b.csv", "--json", "b.json"});
    REQUIRE(read.status == 0);
    const HtfTable a(folder.path("a.csv")), b(folder.path("b.csv"));
    CHECK(a.header() == b.header());
    REQUIRE(a.entries().size() == b.entries().size());
    double worst = 0.0, sigma = 0.0;
    for (const auto& [key, entry] : a.entries()) {
      const HtfEntry& other = b.entries().at(key);
      worst = std::max(worst, std::abs(entry.value - other.value));
      CHECK(entry.cycles == other.cycles);
      CHECK(std::isfinite(entry.sigma) == noisy);
      CHECK(std::isfinite(other.sigma) == noisy);
      if (noisy) sigma = std::max(sigma, std::abs(entry.sigma - other.sigma) / entry.sigma);
    }
    INFO(worst);
    CHECK(worst < 2e-12);  // of values up to 1: rounding of the sums over what is kept to the last bit
    CHECK(sigma < 2e-4);   // of the four digits written
    const json left = json::parse(folder.read("a.json")), right = json::parse(folder.read("b.json"));
    CHECK(left.at("samples") == right.at("samples"));
    CHECK(right.at("missing") == 0);
    CHECK(right.at("record") == "run.csv");
    CHECK(std::abs(best_error(left) - best_error(right)) < 1e-9);
  }
  const std::string text = folder.read("run.csv").substr(0, 400);
  for (const char* line :
       {"# saltus-record: 1", "# model: hopper", "# sections: clock", "# sections-per-cycle: 32",
        "# stimulus-period-cycles: 32", "# settle-cycles: 80", "# inputs: u [N]", "# outputs: y_M [m], v_M [m/s]"}) {
    INFO(line);
    CHECK(text.find(line) != text.npos);
  }
}

TEST_CASE("The same seed gives the same bytes, another seed other noise") {
  const Folder folder;
  const auto run = [&](const std::string& seed) {
    const auto done = folder.run({"identify", "hopper", "--period", "8", "--settle", "10", "--noise", "0.001,0.006",
                                  "--seed", seed, "--csv", "-"});
    REQUIRE(done.status == 0);
    return done.out;
  };
  const std::string first = run("7");
  CHECK(first == run("7"));
  CHECK(first != run("8"));
}

TEST_CASE("A machine that is its model stays within the noise that is watched") {
  const Folder folder;
  const auto done = folder.run({"identify", "hopper", "--period", "8", "--noise", "0.001,0.006", "--json", "-"});
  REQUIRE(done.status == 0);
  CHECK(json::parse(done.out).at("drifts").empty());
  CHECK(done.err.find("drift") == done.err.npos);
  // Nothing is watched where there is no noise to watch against; a machine noisier than said is found out.
  const auto exact = folder.run({"identify", "hopper", "--period", "8", "--json", "-"});
  CHECK_FALSE(json::parse(exact.out).contains("drifts"));
  const auto noisier = folder.run({"identify", "hopper", "--period", "8", "--noise", "0.001,0.006", "--watch",
                                   "0.001,0.005", "--json", "-"});
  REQUIRE(noisier.status == 0);
  CHECK_FALSE(json::parse(noisier.out).at("drifts").empty());
  CHECK(noisier.err.find("saltus: drift: experiment ") != noisier.err.npos);
}

TEST_CASE("Machines read JSON from standard output whatever else is asked for") {
  const Folder folder;
  const auto done = folder.run({"identify", "hopper", "--period", "8", "--json", "-", "--csv", "x.csv", "--pictures",
                                "pictures", "--save", "run.csv"});
  REQUIRE(done.status == 0);
  const json campaign = json::parse(done.out);
  CHECK(campaign.at("model") == "hopper");
  CHECK(campaign.at("stimulus_period_cycles") == 8);
  CHECK(folder.files() ==
        std::vector<std::string>{"pictures", "pictures/fit.svg", "pictures/htf.svg", "run.csv", "x.csv"});
}

TEST_CASE("Few harmonics and few lines are drawn and printed too") {
  const Folder folder;
  const auto done = folder.run(
      {"identify", "hopper", "--harmonics", "0", "--protocol", "paper", "--period", "16", "--pictures", "pictures"});
  REQUIRE(done.status == 0);
  CHECK(done.out.find("H_1 ") == done.out.npos);
  CHECK(done.out.find("nan") == done.out.npos);
  CHECK(folder.read("pictures/htf.svg").find("</svg>") != std::string::npos);
  const auto least = folder.run({"identify", "hopper", "--period", "3", "--band", "0.5", "--pictures", "one"});
  REQUIRE(least.status == 0);
  CHECK(least.out.find("1 lines") != least.out.npos);
  CHECK(least.out.find("nan") == least.out.npos);
}

TEST_CASE("Campaigns that cannot be run say why, and leave nothing") {
  struct Case {
    std::vector<std::string> arguments;
    int status;
    std::string says;
  };
  const std::vector<Case> cases{
      {{"--amplitude", "0"}, 2, "--amplitude: give a positive number"},
      {{"--amplitude", "nan"}, 2, "--amplitude: give a positive number"},
      {{"--amplitude", "1e9"}, 1, "the machine left its cycle during the campaign; lower --amplitude"},
      {{"--amplitude", "1e9", "--sections", "both"}, 1, "lower --amplitude"},
      {{"--amplitude", "1e308"}, 1, "lower --amplitude"},
      {{"--amplitude", "1e6", "--period", "8"}, 1, "lower --amplitude"},  // flies away, and breaks no guard
      {{"--band", "100"}, 2, "--band: lines lie between 0 and half the sections a cycle, 16"},
      {{"--band", "nan"}, 2, "--band"},
      {{"--period", "2"}, 2, "--period"},
      {{"--period", "1e9"}, 2, "--period"},
      {{"--harmonics", "99"}, 2, "--harmonics"},
      {{"--settle", "-1"}, 2, "--settle"},
      {{"--settle", "1e9"}, 2, "--settle"},
      {{"--periods", "0"}, 2, "--periods"},
      {{"--subsets", "19"}, 2, "--subsets 19: give at least 20"},
      {{"--noise", "0.001"}, 2, "--noise: hopper has 2 outputs; give one number for each"},
      {{"--noise", "0.001,0.006,1"}, 2, "--noise: hopper has 2 outputs"},
      {{"--noise", "0.001,-1"}, 2, "--noise -1: a standard deviation is a finite number, 0 or above"},
      {{"--noise", "nan,nan"}, 2, "--noise nan"},
      {{"--noise", "inf,0"}, 2, "--noise inf"},
      {{"--watch", "0.001"}, 2, "--watch: hopper has 2 outputs; give the noise of each"},
      {{"--watch", "0.001,0"}, 2, "--watch 0: the noise of an output is a finite number above 0"},
      {{"--false-alarm", "0"}, 2, "--false-alarm"},
      {{"--noise", "a,b"}, 2, "--noise"},
      {{"--seed", "-3"}, 2, "--seed: -3 is negative"},
      {{"--sections", "round"}, 2, "--sections"},
      {{"--kinematic", "1.9,0,0.3,1.9"}, 2, "add --sections kinematic"},
      {{"--sections", "kinematic", "--kinematic", "50,0,1,1"}, 1, "--kinematic where the orbit does not circle"},
      {{"--protocol", "papers"}, 2, "--protocol"},
      {{"--set", "a=4"}, 1, "does not attract"},
      {{"--sections", "kinematic", "--save", "run.csv"}, 2, "--save: name a file, and use --sections clock"},
      {{"--protocol", "paper", "--save", "run.csv"}, 2, "--save"},
      {{"--save", "-"}, 2, "--save: name a file"}};
  const Folder folder;
  for (const Case& c : cases) {
    std::vector<std::string> arguments{"identify", "hopper", "--csv", "x.csv", "--json", "x.json"};
    arguments.insert(arguments.end(), c.arguments.begin(), c.arguments.end());
    INFO(c.arguments[0] << " " << c.arguments[1]);
    const auto done = folder.run(arguments);
    CHECK(done.status == c.status);
    INFO(done.err);
    CHECK(done.err.find(c.says) != done.err.npos);
  }
  const auto both = folder.run({"identify", "hopper", "--protocol", "paper", "--csv", "-"});
  CHECK(both.status == 2);
  CHECK(both.out.empty());
  folder.write("taken", "kept\n");
  const auto pictures = folder.run({"identify", "hopper", "--period", "8", "--csv", "x.csv", "--pictures", "taken"});
  CHECK(pictures.status == 1);
  CHECK(pictures.err.find("taken: the folder cannot be made") != pictures.err.npos);
  CHECK(folder.files() == std::vector<std::string>{"taken"});
  CHECK(folder.read("taken") == "kept\n");
}
