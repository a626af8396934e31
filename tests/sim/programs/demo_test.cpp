#include "tests/support/catch.hpp"
#include "tests/support/program.hpp"

using saltus::test::Folder;

TEST_CASE("The demonstration needs nothing, tells its story and draws it") {
  const Folder folder;
  const auto done = folder.run({"demo"});
  REQUIRE(done.status == 0);
  CHECK(done.err.empty());
  for (const char* words : {"vertical hopper", "620 frequencies", "isochrons", "kinematic", "multipliers of the model",
                            "-0.2489833347 +- 0.6993332518 i"}) {
    INFO(words);
    CHECK(done.out.find(words) != done.out.npos);
  }
  CHECK(folder.files() == std::vector<std::string>{"saltus-demo", "saltus-demo/fit.svg", "saltus-demo/htf.svg"});
  for (const char* picture : {"saltus-demo/fit.svg", "saltus-demo/htf.svg"}) {
    CHECK(folder.read(picture).find("</svg>") != std::string::npos);
  }
}
