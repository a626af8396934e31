#include <string>

#include "tests/support/catch.hpp"
#include "tests/support/program.hpp"

using saltus::test::Folder;

TEST_CASE("The demonstration needs nothing, closes the loop on a machine of its own, and tells where the report lies") {
  const Folder folder;
  const auto done = folder.run({"demo"});
  REQUIRE(done.status == 0);
  CHECK(done.err.empty());
  for (const char* words : {"vertical hopper", "620 frequencies", "isochrons", "kinematic", "multipliers of the model",
                            "-0.2489833347 +- 0.6993332518 i", "Verdict: effect found", "quadratic_drag@body = 0.03"}) {
    INFO(words);
    CHECK(done.out.find(words) != done.out.npos);
  }
  // It ends with the error before and after, and the report.
  double before = 0.0, after = 0.0;
  const auto line = done.out.find("Error on held-out data, in units of the noise: before ");
  REQUIRE(line != done.out.npos);
  REQUIRE(std::sscanf(done.out.c_str() + line, "Error on held-out data, in units of the noise: before %lf, after %lf",
                      &before, &after) == 2);
  CHECK(before > 1.3);
  CHECK(after < 1.05);
  const std::string last = "Report: saltus-demo/index.html\n";
  CHECK(done.out.substr(done.out.size() - last.size()) == last);

  CHECK(folder.files() == std::vector<std::string>{"saltus-demo", "saltus-demo/fit.svg", "saltus-demo/htf.svg",
                                                   "saltus-demo/index.html", "saltus-demo/record.csv"});
  for (const char* picture : {"saltus-demo/fit.svg", "saltus-demo/htf.svg"}) {
    CHECK(folder.read(picture).find("</svg>") != std::string::npos);
  }
  const std::string page = folder.read("saltus-demo/index.html");
  CHECK(page.find("</html>") != page.npos);
  CHECK(page.find("quadratic_drag@body") != page.npos);
}
