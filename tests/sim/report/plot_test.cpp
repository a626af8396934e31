#include "sim/report/plot.hpp"

#include <cmath>
#include <filesystem>
#include <stdexcept>

#include "sim/report/htf_figures.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/program.hpp"

using namespace saltus;
using saltus::test::Folder;

namespace {

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t n = 0;
  for (auto at = text.find(what); at != text.npos; at = text.find(what, at + 1)) ++n;
  return n;
}

// A picture is whole: SVG from its first element to its last.
bool whole(const std::string& svg) {
  return svg.find("<svg") != svg.npos && count(svg, "<svg") == 1 && count(svg, "</svg>") == 1;
}

Figure line() { return {1, 400, 300, {{"title", "x", "y", {{"curve", "lines", {{0, 1}, {1, 3}, {2, 2}}}}, ""}}}; }

}  // namespace

TEST_CASE("A figure is one whole SVG of the size asked for, with its words in it") {
  const std::string svg = line().svg();
  CHECK(whole(svg));
  CHECK(svg.find("viewBox=\"0 0 400 300\"") != svg.npos);
  for (const char* word : {">title<", ">x<", ">y<", ">curve<"}) {
    INFO(word);
    CHECK(svg.find(word) != svg.npos);
  }
}

TEST_CASE("Words are words: quotes, backquotes and the like reach neither gnuplot nor a shell") {
  const Folder folder;
  const auto before = std::filesystem::current_path();
  std::filesystem::current_path(folder.path());
  Figure figure = line();
  figure.panels[0].title = "it's `touch run` \"$(touch run)\" ; !touch run";
  figure.panels[0].curves[0].title = "'; system('touch run'); print '";
  const std::string name = "a `touch run` '\"$(touch run);.svg";
  figure.write_svg(name);
  std::filesystem::current_path(before);
  CHECK(folder.files() == std::vector<std::string>{name});
  CHECK(whole(folder.read(name)));
  CHECK(folder.read(name).find("s `touch run` \"$(touch run)\" ; !touch run") != std::string::npos);
}

TEST_CASE("What is not a number breaks a line, and a curve of nothing else is left out") {
  const double nan = std::nan("");
  Figure figure = line();
  figure.panels[0].curves.push_back({"broken", "lines", {{0, 1}, {1, nan}, {2, 1}, {INFINITY, 1}}});
  figure.panels[0].curves.push_back({"none", "lines", {{0, nan}, {nan, 1}}});
  figure.panels[0].curves.push_back({"empty", "lines", {}});
  figure.panels.push_back({"blank", "x", "y", {{"nothing", "lines", {}}}, "set logscale y"});
  const std::string svg = figure.svg();
  CHECK(whole(svg));
  CHECK(svg.find(">broken<") != svg.npos);
  CHECK(svg.find(">none<") == svg.npos);
  CHECK(svg.find(">empty<") == svg.npos);
}

TEST_CASE("A picture that fails, or cannot be put anywhere, leaves nothing and says what to do") {
  const Folder folder;
  Figure figure = line();
  figure.panels[0].settings = "no such command";
  CHECK_THROWS_AS(figure.write_svg(folder.path("x.svg").string()), std::runtime_error);
  CHECK_THROWS_AS(line().write_svg(folder.path("missing/x.svg").string()), std::runtime_error);
  CHECK(folder.files().empty());
}

TEST_CASE("The figures of harmonics draw whatever there is of them") {
  HtfPanel full{"y_M", "m/N", "isochrons", {}, {}, {}};
  for (const int m : {-1, 0, 1}) {
    HtfCurve curve{m, {}};
    for (int q = 1; q < 100; ++q) curve.points.emplace_back(q / 64.0, std::polar(1.0 / (1.0 + q), 0.2 * m * q));
    full.exact.push_back(curve);
    full.identified.push_back(curve);
    if (m == 0) full.fit = curve.points;
  }
  HtfPanel zero = full;  // harmonics that are nothing, as a machine without a cycle of its own has them
  for (const std::size_t i : {std::size_t{0}, std::size_t{2}}) {
    for (auto& [f, h] : zero.exact[i].points) h = 0.0;
    for (auto& [f, h] : zero.identified[i].points) h = 0.0;
  }
  HtfPanel none{"v_M", "m/s/N", "isochrons", {}, {}, {}};
  HtfPanel one = none;
  one.identified = {{0, {{0.5, {0.1, 0.0}}}}};
  for (const std::vector<HtfPanel>& panels :
       {std::vector<HtfPanel>{full}, {full, full}, {full, zero, none, one}, {none}, {one}}) {
    INFO(panels.size() << " panels");
    CHECK(whole(magnitude_figure(panels).svg()));
    CHECK(whole(fit_figure(panels).svg()));
  }
  const std::string svg = magnitude_figure({full}).svg();
  CHECK(svg.find("cycles per cycle") != svg.npos);
  CHECK(svg.find("isochrons") != svg.npos);
}
