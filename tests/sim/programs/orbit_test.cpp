#include "tests/support/catch.hpp"
#include "tests/support/program.hpp"

#include <nlohmann/json.hpp>

#include <cmath>
#include <complex>

using nlohmann::json;
using saltus::test::Folder;

namespace {

using Complex = std::complex<double>;

json orbit(const Folder& folder, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "orbit");
  arguments.insert(arguments.end(), {"--json", "-"});
  const auto done = folder.run(arguments);
  INFO(done.err);
  REQUIRE(done.status == 0);
  CHECK(done.err.empty());
  return json::parse(done.out);
}

bool holds(const std::string& text, const std::vector<std::string>& words) {  // in this order
  std::size_t at = 0;
  for (const std::string& word : words) {
    at = text.find(word, at);
    if (at == text.npos) {
      UNSCOPED_INFO(word << " is missing in\n" << text);
      return false;
    }
    at += word.size();
  }
  return true;
}

// The multipliers are these and zeros, each within its error, by falling modulus.
void has_multipliers(const json& list, const std::vector<Complex>& expected, std::size_t dim) {
  REQUIRE(list.size() == dim);
  for (std::size_t i = 0; i < dim; ++i) {
    const Complex z(list[i].at("re"), list[i].at("im"));
    const Complex wanted = i < expected.size() ? expected[i] : 0.0;
    const double error = list[i].at("error");
    CHECK(std::abs(z - wanted) < error + 1e-11);
    CHECK(error < 1e-7);
  }
}

bool near(const json& numbers, const std::vector<double>& expected, double tolerance) {
  if (numbers.size() != expected.size()) return false;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    if (!(std::abs(numbers[i].get<double>() - expected[i]) < tolerance)) return false;
  }
  return true;
}

}  // namespace

TEST_CASE("orbit: the kneed biped's JSON holds what the interface promises, and the numbers computed elsewhere") {
  const Folder folder;
  const json j = orbit(folder, {"kneed_biped"});
  CHECK(j.at("model") == "kneed_biped");
  CHECK(j.at("stable") == true);
  CHECK(std::abs(j.at("period").get<double>() - 0.5425894986695377) < 1e-9);

  const json& events = j.at("events");
  REQUIRE(events.size() == 2);
  CHECK(events[0].at("edge") == "KneeStrike");
  CHECK(events[0].at("t") == 0.0);
  CHECK(events[1].at("edge") == "FootStrike");
  CHECK(std::abs(events[1].at("t").get<double>() - 0.1953605658288642) < 1e-9);
  CHECK(events[1].at("before").at("chart") == "Locked");
  CHECK(events[1].at("after").at("chart") == "Unlocked");

  const std::vector<double> state{0.02151023061709699, -0.2698948467938392, -0.2698948467938392,
                                  0.8290966251552227,  -0.4568272708949046, -11.45529862120729};
  CHECK(j.at("fixed_point").at("chart") == "Unlocked");
  CHECK(near(j.at("fixed_point").at("state"), state, 1e-9));
  CHECK(events[0].at("before") == j.at("fixed_point"));

  const std::vector<Complex> expected{
      {0.5883515198422658, 0.5084071030682252}, {0.5883515198422658, -0.5084071030682252}, 0.1685682819049621};
  has_multipliers(j.at("multipliers"), expected, 6);
  const json& u = j.at("charts").at("Unlocked");
  const json& l = j.at("charts").at("Locked");
  has_multipliers(u.at("multipliers"), expected, 6);
  has_multipliers(l.at("multipliers"), expected, 4);
  CHECK(j.at("charts").size() == 2);
  CHECK(u.at("dim") == 6);
  CHECK(u.at("rank") == 3);
  CHECK(u.at("rank_bounds") == json({3, 3}));
  CHECK(u.at("trivial") == 3);
  CHECK(l.at("dim") == 4);
  CHECK(l.at("rank") == 3);
  CHECK(l.at("rank_bounds") == json({1, 3}));
  CHECK(l.at("trivial") == 1);
  CHECK(u.at("zeros").at("section") == 1);
  CHECK(u.at("zeros").at("dimension") == 2);
  CHECK(u.at("flow_multiplier_error").get<double>() < 1e-9);
  CHECK(j.at("spread").at("value") <= j.at("spread").at("allowed"));
  for (const json& edge : j.at("edges")) CHECK(edge.at("constant_rank") == true);
  CHECK(j.at("legs").size() == 2);
  CHECK(j.at("periodicity").at("same_order") == true);
  CHECK(folder.files().empty());
}

TEST_CASE("orbit: the table says it to people, with the paper's own numbers where they differ") {
  const Folder folder;
  const auto biped = folder.run({"orbit", "kneed_biped"});
  CHECK(biped.status == 0);
  CHECK(biped.err.empty());
  CHECK(holds(biped.out, {"period 0.54258949",
                          "stable (largest modulus 0.77758298",
                          "Definition 4: a second round has the same",
                          "energy is kept",
                          "0.195360565",
                          "FootStrike",
                          "0.58835151",
                          "0.50840710",
                          "0.16856828",
                          "3 times 0",
                          "Unlocked (KneeStrike)",
                          "[3, 3]",
                          "1 section projection, 2 drop of dimension",
                          "Locked (FootStrike)",
                          "[1, 3]",
                          "(A2)",
                          "(A3)",
                          "m = 1",
                          "3 of 4",
                          "1.27650738",
                          "0.41285598",
                          "-0.23482987",
                          "5 of 6",
                          "note: Wendel & Ames 2010, sec. 5.2",
                          "0.58775 +- 0.50861i, 0.16871",
                          "0.58836 +- 0.50742i, 0.16930"}));
  const auto zero = folder.run({"orbit", "zero_rank"});
  CHECK(zero.status == 0);
  CHECK(holds(zero.out, {"period 3.14159265", "superstable", "D1 (E1)", "1 composition", "D2 (E2)", "1 nilpotent",
                         "print rank 0 for both return maps", "DP_2 has rank 1"}));
  // The note is about the paper's parameters only.
  const auto steeper = folder.run({"orbit", "kneed_biped", "--set", "slope=0.052"});
  CHECK(steeper.status == 0);
  CHECK(steeper.out.find("Wendel") == steeper.out.npos);
}

TEST_CASE("orbit: the ranks of the zero-rank example, and that it is superstable") {
  const Folder folder;
  const json j = orbit(folder, {"zero_rank"});
  CHECK(std::abs(j.at("period").get<double>() - 3.141592653589793) < 1e-9);
  CHECK(j.at("superstable") == true);
  CHECK(j.at("stable") == true);
  has_multipliers(j.at("multipliers"), {}, 2);
  CHECK(j.at("charts").at("D1").at("rank") == 0);
  CHECK(j.at("charts").at("D2").at("rank") == 1);
  CHECK(j.at("charts").at("D1").at("passages_to_forget") == 1);
  CHECK(j.at("charts").at("D2").at("passages_to_forget") == 2);
  CHECK(j.at("charts").at("D2").at("zeros").at("nilpotent") == 1);
  CHECK(j.at("notes").size() == 1);
}

TEST_CASE("orbit: the hopper on its clock, on its kinematic phase and at its edges has the same multipliers") {
  const Folder folder;
  const std::vector<Complex> expected{{-0.248983334736, 0.699333251798}, {-0.248983334736, -0.699333251798}};
  const json clock = orbit(folder, {"hopper"});
  CHECK(clock.at("sections") == "clock");
  CHECK(near(clock.at("fixed_point").at("state"),
             {1.8561810757180, -1.9213776705096, 0.0, 0.7061913261653, 1.0822766978996}, 1e-9));
  CHECK(std::abs(clock.at("events")[0].at("t").get<double>() - 0.350981787094387) < 1e-9);
  CHECK(std::abs(clock.at("events")[1].at("t").get<double>() - 0.516314426971245) < 1e-9);
  CHECK(clock.at("spread").at("sections_met") == 32);
  has_multipliers(clock.at("multipliers"), expected, 5);
  has_multipliers(orbit(folder, {"hopper", "--sections", "kinematic"}).at("multipliers"), expected, 5);
  has_multipliers(orbit(folder, {"hopper", "--sections", "Touchdown"}).at("multipliers"), expected, 5);
  has_multipliers(orbit(folder, {"hopper", "--sections", "Liftoff"}).at("multipliers"), expected, 3);
}

TEST_CASE("orbit: a --start finds the other gait, which is unstable, and --returns a doubled period") {
  const Folder folder;
  const json shorter = orbit(folder, {"simplest_walker", "--start", "0.194,-0.204,0.388,-0.015"});
  CHECK(std::abs(shorter.at("period").get<double>() - 3.096105868078) < 1e-9);
  CHECK(shorter.at("stable") == false);
  has_multipliers(shorter.at("multipliers"), {4.003864358929, 0.459589589798}, 4);
  const auto table = folder.run({"orbit", "simplest_walker", "--start", "0.194,-0.204,0.388,-0.015"});
  CHECK(holds(table.out, {"unstable (largest modulus 4.0038643"}));
  // What the notes of the models promise.
  for (const auto& [model, period] :
       {std::pair{"simplest_walker", 3.0961}, {"compass_gait", 0.5822}, {"kneed_biped", 0.4978}}) {
    const std::string note = orbit(folder, {model}).at("notes").back();
    const auto at = note.find("--start ") + 8;
    const json other = orbit(folder, {model, "--start", note.substr(at, note.find(' ', at) - at)});
    CHECK(std::abs(other.at("period").get<double>() - period) < 1e-4);
    CHECK(other.at("stable") == false);
  }
  const json two = orbit(folder, {"simplest_walker", "--set", "slope=0.0152", "--returns", "2"});
  CHECK(two.at("events").size() == 2);
  CHECK(two.at("stable") == true);
  const json twice = orbit(folder, {"simplest_walker", "--returns", "2"});
  CHECK(twice.at("notes").dump().find("--returns is too large") != std::string::npos);
}

TEST_CASE("orbit: of a cycle run through several times the multipliers are powers, and the ranks are the same") {
  const Folder folder;
  struct Case {
    std::vector<std::string> arguments;
    double modulus;  // the largest, of one return
    int returns, rank;
  };
  for (const Case& c :
       {Case{{"simplest_walker"}, 0.589113185463, 8, 2}, Case{{"kneed_biped"}, 0.777582981, 6, 3},
        Case{{"hopper"}, 0.742333953, 5, 2}, Case{{"hopper"}, 0.742333953, 6, 2}, Case{{"bouncing_ball"}, 0.8, 12, 2},
        Case{{"simplest_walker", "--set", "slope=0.0152"}, 1.024126404, 8, 2}}) {
    auto arguments = c.arguments;
    arguments.insert(arguments.end(), {"--count", "4", "--returns", std::to_string(c.returns)});
    const json j = orbit(folder, arguments);
    INFO(j.at("model") << " " << c.returns);
    const json& largest = j.at("multipliers")[0];
    const double got = std::abs(Complex(largest.at("re"), largest.at("im")));
    CHECK(std::abs(got - std::pow(c.modulus, c.returns)) < 1e-6);
    CHECK(largest.at("error").get<double>() < 1e-6);
    CHECK(j.at("stable") == (c.modulus < 1.0));
    CHECK(j.at("superstable") == false);
    for (const json& chart : j.at("charts")) CHECK(chart.at("rank") == c.rank);
    // Sections in the middle of the legs are compared too, though the cycle may have as many events as there is room
    // for.
    const int events = static_cast<int>(j.at("events").size());
    const json& spread = j.at("spread");
    CHECK(spread.at("compared") ==
          2 * events + (spread.at("sections_met") > 1 ? spread.at("sections_met").get<int>() : 0));
  }
}

TEST_CASE("orbit: where numbers cannot tell a rank a theorem does, or it is not told, though stability may be") {
  const Folder folder;
  // Three multipliers over eight decades: the last singular value is no more than rounding, the rank is the theorem's.
  for (const auto& [slope, largest] : {std::pair{"slope=0.09", -216.3468523}, {"slope=0.086", 74.8207037}}) {
    const json j = orbit(folder, {"compass_gait", "--set", slope, "--returns", "4"});
    CHECK(std::abs(j.at("multipliers")[0].at("re").get<double>() - largest) < 1e-5);
    CHECK(j.at("stable") == false);
    CHECK(j.at("charts").at("Swing").at("rank") == 3);
    CHECK(j.at("charts").at("Swing").at("rank_bounds") == json({3, 3}));
    CHECK(j.at("charts").at("Swing").at("nonzero") == 3);
  }
  const auto proved = folder.run({"orbit", "compass_gait", "--set", "slope=0.09", "--returns", "4"});
  CHECK(holds(proved.out, {"unstable (largest modulus 216.34", "3 (>= 2)", "numerically the rank is at least n"}));
  for (const std::string set : {"m=0.1", "m=0.01", "b=50"}) {
    const json j = orbit(folder, {"hopper", "--set", set, "--ticks", "2048", "--count", "4"});
    CHECK(j.at("charts").at("Flight").at("rank") == 2);
    CHECK(j.at("charts").at("Stance").at("rank") == 2);
    CHECK(j.at("stable") == true);
  }
  // Rank 3 and an unstable multiplier: at these steps the one is not told, the other is.
  const std::vector<std::string> steep{"orbit", "kneed_biped", "--set", "slope=0.15", "--returns", "4", "--json", "-"};
  const auto vague = folder.run(steep);
  CHECK(vague.status == 1);
  CHECK(holds(vague.err, {"too near its error", "try --ticks 2048"}));
  CHECK(json::parse(vague.out).at("stable") == false);
  CHECK(json::parse(vague.out).at("multipliers").is_null());
  const json clear = orbit(folder, {"kneed_biped", "--set", "slope=0.15", "--returns", "4", "--ticks", "1024"});
  CHECK(clear.at("charts").at("Locked").at("rank") == 3);
  CHECK(std::abs(clear.at("multipliers")[0].at("re").get<double>() - 21.91772479) < 1e-6);
  // An image that the flow crosses, as smaller steps show.
  const std::vector<std::string> light{"orbit", "compass_gait", "--set", "leg_mass=0.001", "--ticks", "32"};
  const auto coarse = folder.run(light);
  CHECK(coarse.status == 1);
  CHECK(holds(coarse.err, {"whether the flow crosses the image of Impact cannot be told", "try --ticks 128"}));
  CHECK(holds(coarse.out, {"stable (largest modulus 0.5644"}));
  const json fine = orbit(folder, {"compass_gait", "--set", "leg_mass=0.001", "--ticks", "512"});
  CHECK(fine.at("edges")[0].at("image_transverse") == true);
  CHECK(fine.at("edges")[0].at("image_tolerance").get<double>() < 1e-5);
  CHECK(fine.at("edges")[0].at("constant_rank_margin").get<double>() > 1e6);
  CHECK(fine.at("charts").at("Swing").at("rank") == 3);
  // Multipliers on the unit circle.
  CHECK(orbit(folder, {"bouncing_ball", "--set", "e=1"}).at("stable").is_null());
}

TEST_CASE("orbit: twice as many steps change nothing but the errors") {
  const Folder folder;
  const json a = orbit(folder, {"kneed_biped", "--ticks", "64"});
  const json b = orbit(folder, {"kneed_biped", "--ticks", "1024"});
  for (std::size_t i = 0; i < 3; ++i) {
    const Complex za(a.at("multipliers")[i].at("re"), a.at("multipliers")[i].at("im"));
    const Complex zb(b.at("multipliers")[i].at("re"), b.at("multipliers")[i].at("im"));
    CHECK(std::abs(za - zb) < a.at("multipliers")[i].at("error"));
    CHECK(b.at("multipliers")[i].at("error") < a.at("multipliers")[i].at("error"));
  }
}

TEST_CASE("orbit: pictures are drawn whole, for every kind of model") {
  const Folder folder;
  for (const std::string model : {"hopper", "zero_rank", "kneed_biped", "simplest_walker"}) {
    INFO(model);
    REQUIRE(folder.run({"orbit", model, "--picture", "x.svg"}).status == 0);
    CHECK(folder.files() == std::vector<std::string>{"x.svg"});
    const std::string svg = folder.read("x.svg");
    CHECK(svg.find("</svg>") != svg.npos);
    CHECK(svg.find("phase portrait") != svg.npos);
    CHECK(svg.find("multipliers on section 0") != svg.npos);
    CHECK(svg.find("nan") == svg.npos);
  }
  const auto out = folder.run({"orbit", "zero_rank", "--picture", "-"});
  CHECK(out.status == 0);
  CHECK(out.out.find("<?xml") == 0);
}

TEST_CASE("orbit: without gnuplot there is a message, and no file at all") {
  const Folder folder;
  std::filesystem::create_directory(folder.path("nothing"));
  const auto done = folder.run({"orbit", "zero_rank", "--json", "x.json", "--picture", "x.svg"}, "nothing");
  CHECK(done.status == 1);
  CHECK(holds(done.err, {"install the package gnuplot-nox"}));
  CHECK(folder.files() == std::vector<std::string>{"nothing"});
}

TEST_CASE("orbit: questions without an answer are refused, saying what may be asked") {
  const Folder folder;
  const std::vector<std::pair<std::vector<std::string>, std::vector<std::string>>> cases{
      {{"walker"}, {"there is no model 'walker'", "hopper", "kneed_biped"}},
      {{}, {"MODEL"}},
      {{"kneed_biped", "--set", "knee=1"}, {"kneed_biped has no parameter 'knee'", "hip_mass", "slope"}},
      {{"zero_rank", "--set", "a=1"}, {"zero_rank has no parameter 'a'; it has none"}},
      {{"kneed_biped", "--set", "slope=steep"}, {"--set slope=steep", "not a finite number"}},
      {{"kneed_biped", "--set", "slope"}, {"--set slope", "NAME=VALUE"}},
      {{"hopper", "--ticks", "-64"}, {"--ticks", "-64"}},
      {{"hopper", "--ticks", "100"}, {"--ticks", "multiple of 32"}},
      {{"kneed_biped", "--sections", "clock"}, {"kneed_biped has kinematic, KneeStrike, FootStrike"}},
      {{"hopper", "--sections", "Kneestrike"}, {"hopper has clock, kinematic, Touchdown, Liftoff"}},
      {{"hopper", "--count", "0"}, {"--count"}},
      {{"hopper", "--returns", "0"}, {"--returns"}},
      {{"hopper", "--kinematic", "1.9,0,0.3,1.9"}, {"add --sections kinematic"}},
      {{"hopper", "--sections", "kinematic", "--kinematic", "1.9,0,0.3"}, {"--kinematic"}},
      {{"hopper", "--sections", "kinematic", "--kinematic", "1.9,0,0,1.9"}, {"must be positive"}},
      {{"hopper", "--sections", "kinematic", "--kinematic", "1.9,0,inf,1.9"}, {"finite"}},
      {{"compass_gait", "--start", "0.1,0.2"}, {"starts in Swing", "4 coordinates; 2 are given"}},
      {{"compass_gait", "--start", "nan,0,0,0"}, {"--start: give finite numbers"}},
      {{"compass_gait", "--set", "hip_mass=-1"}, {"--set hip_mass=-1", "[kg]", "must be positive"}},
      {{"kneed_biped", "--set", "leg_length=0"}, {"--set leg_length=0", "[m]", "must be positive"}},
      {{"bouncing_ball", "--set", "g=-9.81"}, {"--set g=-9.81", "must be positive"}},
      {{"kneed_biped", "--ticks", "1048576"}, {"--ticks 1048576", "at most 65536"}},
      {{"kneed_biped", "--ticks", "16384", "--returns", "5"}, {"at most 13088 with so many --returns"}},
      {{"hopper", "--picture", "-"}, {"goes to standard output already"}}};
  for (auto [arguments, words] : cases) {
    arguments.insert(arguments.begin(), "orbit");
    arguments.insert(arguments.end(), {"--json", arguments.back() == "-" ? "-" : "x.json"});
    const auto done = folder.run(arguments);
    CHECK(done.status == 2);
    CHECK(holds(done.err, words));
    CHECK(done.out.empty());
  }
  CHECK(folder.files().empty());
}

TEST_CASE("orbit: no cycle, or one whose numbers mean nothing, is a message and exit status 1") {
  const Folder folder;
  const std::vector<std::pair<std::vector<std::string>, std::vector<std::string>>> cases{
      {{"compass_gait", "--start", "-0.32,0.22,-0.4,0.3"}, {"no limit cycle found", "it falls"}},
      {{"simplest_walker", "--set", "slope=-0.001"}, {"no limit cycle found", "lost after", "fold", "it falls"}},
      {{"bouncing_ball", "--set", "A=0.05"}, {"lost after 40.7 %", "ends in a fold", "give a --start"}},
      {{"hopper", "--set", "k=0"}, {"no limit cycle found", "leaves its chart without an event"}},
      {{"kneed_biped", "--set", "slope=0.02"},
       {"from the model's own start after KneeStrike", "the guard of FootStrike is passed already",
        "the gait changes its order of events"}},
      {{"kneed_biped", "--set", "slope=0.02", "--start", "-0.2,0.2,0.2,1.2,0.3,3"}, {"from the --start given"}},
      {{"bouncing_ball", "--set", "e=0.5"}, {"stays on the guard of Impact", "events accumulate (chattering)"}},
      {{"bouncing_ball", "--set", "e=0"}, {"events accumulate (chattering)"}},
      {{"kneed_biped", "--returns", "7"}, {"more than 12 events"}},
      {{"hopper", "--sections", "kinematic", "--kinematic", "1.9,50,0.3,1.9"}, {"section 0 is not met"}}};
  for (auto [arguments, words] : cases) {
    arguments.insert(arguments.begin(), "orbit");
    arguments.insert(arguments.end(), {"--json", "x.json", "--picture", "x.svg"});
    const auto done = folder.run(arguments);
    CHECK(done.status == 1);
    CHECK(holds(done.err, words));
    CHECK(done.out.empty());
    CHECK(done.err.find("nan") == done.err.npos);
  }
  CHECK(folder.files().empty());

  // Found, but not to be trusted: said in the file too, in the place of the numbers.
  const auto level = folder.run({"orbit", "compass_gait", "--set", "slope=0", "--json", "level.json"});
  CHECK(level.status == 1);
  CHECK(holds(level.err, {"a multiplier is 1 but for rounding"}));
  CHECK(level.out.find("stable") == level.out.npos);
  const json j = json::parse(folder.read("level.json"));
  CHECK(j.at("stable").is_null());
  CHECK(j.at("multipliers").is_null());
  CHECK(j.at("doubt").get<std::string>().find("1 but for rounding") != std::string::npos);
}

TEST_CASE("orbit: far from the default parameters another cycle may be found, and is said to be another") {
  const Folder folder;
  const json followed = orbit(folder, {"kneed_biped", "--set", "slope=0.055"});
  CHECK(followed.at("notes").empty());
  CHECK(followed.at("charts").at("Unlocked").at("rank_bounds") == json({3, 3}));
  const json other = orbit(folder, {"kneed_biped", "--set", "calf_mass=3"});
  CHECK(holds(other.at("notes").dump(), {"this is another cycle", "which is lost after 8.89 % of the way", "fold"}));
}
