// What experiments identify can play and read beyond the plain campaign, from the command line.
#include "tests/support/catch.hpp"
#include "tests/support/htf_table.hpp"
#include "tests/support/program.hpp"

#include <nlohmann/json.hpp>

using nlohmann::json;
using namespace saltus::test;

namespace {

const std::complex<double> paper_multiplier{-0.248983334736, 0.699333251798};

// saltus identify hopper with these, its JSON.
json identify(const Folder& folder, std::vector<std::string> more) {
  std::vector<std::string> all{"identify", "hopper", "--json", "x.json"};
  all.insert(all.end(), more.begin(), more.end());
  const auto done = folder.run(all);
  INFO(done.err);
  REQUIRE(done.status == 0);
  return json::parse(folder.read("x.json"));
}

// Root of the mean square of identified - model over that of H_0, worst output.
double error_of(const json& j, int m) {
  double worst = 0.0;
  for (const json& h : j.at("harmonics")) {
    if (h.at("m") == m) worst = std::max(worst, h.at("error").get<double>());
  }
  return worst;
}

std::complex<double> number_of(const json& z) { return {z.at("re").get<double>(), z.at("im").get<double>()}; }

}  // namespace

TEST_CASE("identify plays the designs that saltus design makes") {
  const Folder folder;
  const json j = identify(folder, {"--period", "16", "--band", "2", "--odd", "--detection", "1", "--crest", "--tones",
                                   "2", "--realisations", "2", "--harmonics", "1"});
  CHECK(j.at("htf").size() == 2 * 3 * 16);  // 16 odd lines below 32
  for (const json& h : j.at("htf")) {
    const double line = 16.0 * h.at("f").get<double>();
    CHECK(std::fmod(std::round(line), 2.0) == 1.0);
    CHECK(h.at("cycles") == 64);  // two realisations, both signs
  }
  CHECK(error_of(j, 0) < 1e-4);
  CHECK(folder.run({"identify", "hopper", "--period", "15", "--odd"}).status == 2);
}

TEST_CASE("identify finds multiples of half the pumping frequency, and a record of them does") {
  const Folder folder;
  const std::vector<std::string> plan{
      "--half-multiples", "--period", "16", "--band", "2", "--save", "r.csv", "--csv", "x.csv", "--amplitude", "0.001"};
  const json j = identify(folder, plan);
  CHECK(j.at("notes").empty());
  CHECK(j.at("htf").size() == 2 * 7 * 32);  // lines 0 to 31
  CHECK(error_of(j, 0) < 1e-4);
  CHECK(error_of(j, 1) < 1e-4);
  REQUIRE(folder.run({"identify", "hopper", "--record", "r.csv", "--csv", "y.csv", "--json", "y.json"}).status == 0);
  const json again = json::parse(folder.read("y.json"));
  REQUIRE(again.at("htf").size() == j.at("htf").size());
  CHECK(error_of(again, 0) < 1e-4);
  const auto refused = folder.run({"identify", "hopper", "--record", "r.csv", "--half-multiples"});
  CHECK(refused.status == 2);
  CHECK(refused.err.find("--half-multiples") != refused.err.npos);
  CHECK(folder.run({"identify", "hopper", "--half-multiples", "--stimulus", "prbs"}).status == 2);
}

TEST_CASE("identify tells distortion by order, harmonic by harmonic") {
  const Folder folder;
  const json j = identify(folder, {"--distortion", "--sections", "kinematic", "--period", "32", "--amplitude", "1",
                                   "--noise", "0.001,0.006", "--settle", "60"});
  CHECK(j.at("distortion").size() == 2 * 7);
  CHECK(j.at("outputs").at("y_M").at("even_found") == true);
  CHECK(j.at("outputs").at("y_M").at("odd_found") == true);
  const json quiet = identify(folder, {"--distortion", "--sections", "kinematic", "--period", "32", "--noise",
                                       "0.001,0.006", "--settle", "60"});
  for (const char* output : {"y_M", "v_M"}) {
    CHECK(quiet.at("outputs").at(output).at("even_found") == false);
    CHECK(quiet.at("outputs").at(output).at("odd_found") == false);
  }
}

TEST_CASE("a ladder of amplitudes takes the distortion of a strong stimulus away") {
  const Folder folder;
  const std::vector<std::string> plain{"--period", "16", "--band", "1", "--harmonics", "0", "--settle", "100"};
  auto with = [&](std::vector<std::string> more) {
    more.insert(more.end(), plain.begin(), plain.end());
    return identify(folder, more);
  };
  const json strong = with({"--amplitude", "0.06"});
  const json zero = with({"--ladder", "0.04,0.06,0.09"});
  CHECK(error_of(zero, 0) < 0.3 * error_of(strong, 0));
  CHECK(zero.at("ladder").at("amplitudes").size() == 3);
  CHECK(folder.run({"identify", "hopper", "--ladder", "0.1"}).status == 2);
  CHECK(folder.run({"identify", "hopper", "--ladder", "0.1,-1"}).status == 2);
}

TEST_CASE("a chirp and a binary sequence are played, saved, and read again to the same numbers") {
  const Folder folder;
  for (const char* stimulus : {"chirp", "prbs"}) {
    const std::vector<std::string> lines{"--period", "16", "--band", "9", "--harmonics", "1"};
    std::vector<std::string> play{"--stimulus",    stimulus,   "--amplitude", "0.05",   "--noise",
                                  "0.0002,0.0012", "--cycles", "400",         "--save", "x.csv"};
    play.insert(play.end(), lines.begin(), lines.end());
    const json played = identify(folder, play);
    const json& z = played.at("multipliers").at(0);
    CHECK(std::abs(number_of(z) - paper_multiplier) < 4.0 * z.at("sigma").get<double>());
    CHECK(played.at("any_stimulus").at("condition").get<double>() > 1.0);
    CHECK(std::abs(played.at("any_stimulus").at("noise").at("y_M").get<double>() / 2e-4 - 1.0) < 0.1);
    std::vector<std::string> read{"--record", "x.csv", "--any"};
    read.insert(read.end(), lines.begin(), lines.end());
    const json again = identify(folder, read);
    CHECK(again.at("multipliers") == played.at("multipliers"));
    CHECK(again.at("htf") == played.at("htf"));
    const auto refused = folder.run({"identify", "hopper", "--record", "x.csv"});
    CHECK(refused.status == 1);
    CHECK(refused.err.find("names no stimulus period") != refused.err.npos);
  }
}

TEST_CASE("a transient that settling leaves is modelled where that is better, and the choice is told") {
  const Folder folder;
  const std::vector<std::string> plain{"--period", "16", "--band",      "2", "--tones",     "4",
                                       "--settle", "2",  "--harmonics", "1", "--amplitude", "0.004"};
  auto with = [&](std::vector<std::string> more) {
    more.insert(more.end(), plain.begin(), plain.end());
    return identify(folder, more);
  };
  const json automatic = with({}), dropped = with({"--transient", "drop"});
  CHECK(automatic.at("transient").at("modelled") == true);
  CHECK(automatic.at("transient").at("expected_error_modelled") <
        automatic.at("transient").at("expected_error_dropped"));
  CHECK(std::abs(number_of(automatic.at("transient").at("multipliers").at(0)) - paper_multiplier) < 1e-3);
  CHECK(error_of(dropped, 0) > 0.05);
  CHECK(error_of(automatic, 0) < 1e-4);
  CHECK_FALSE(dropped.contains("transient"));
  // Settled: nothing to choose, and the bits of the plain estimate.
  const json settled = identify(folder, {"--period", "16", "--band", "2"});
  CHECK_FALSE(settled.contains("transient"));
  CHECK(settled.at("htf_hash") ==
        identify(folder, {"--period", "16", "--band", "2", "--transient", "drop"}).at("htf_hash"));
}

TEST_CASE("a ramp changes no estimate once the machine has settled") {
  const Folder folder;
  const json j = identify(folder, {"--period", "16", "--band", "2", "--ramp", "10"});
  CHECK(error_of(j, 0) < 1e-4);
  CHECK(folder.run({"identify", "hopper", "--ramp", "20", "--settle", "10"}).status == 2);
}

TEST_CASE("scattering instants are reported") {
  const Folder folder;
  const json j = identify(folder, {"--period", "16", "--band", "2", "--noise", "0.001,0.006", "--jitter", "0.005"});
  const json& t = j.at("timing_jitter_s");
  CHECK(t.at("found") == true);
  CHECK(std::abs(t.at("value").get<double>() - 0.005) < 3.0 * t.at("sigma").get<double>());
  const json still = identify(folder, {"--period", "16", "--band", "2", "--noise", "0.001,0.006"});
  CHECK(still.at("timing_jitter_s").at("found") == false);
}

TEST_CASE("coherence is what of a line's power repeats") {
  const Folder folder;
  const json j =
      identify(folder, {"--period", "16", "--band", "2", "--noise", "0.001,0.006", "--coherence", "--csv", "x.csv"});
  for (const json& h : j.at("htf")) {
    const double c = h.at("coherence"), s = h.at("sigma"), power = std::norm(number_of(h));
    const double periods = h.at("cycles").get<double>() / 16.0;
    CHECK((c >= 0.0 && c < 1.0));
    if (power > s * s) CHECK(std::abs(c - (power - s * s) / (power + (periods - 1.0) * s * s)) < 1e-9);
  }
  CHECK(folder.read("x.csv").rfind("m,f,output,re,im,sigma,cycles,coherence\n", 0) == 0);
}
