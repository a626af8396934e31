// saltus link-test.
#include "tests/support/background.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/network.hpp"

using namespace saltus::test;

TEST_CASE("a link in order is measured, here and to an echo elsewhere") {
  SALTUS_OWN_NETWORK();
  const Folder f;
  const auto here = f.run({"link-test", "--count", "200", "--json", "a.json"});
  INFO(here.err);
  CHECK(here.status == 0);
  for (const char* words : {"round trip", "median", "lost", "overtaken"})
    CHECK(here.out.find(words) != std::string::npos);
  CHECK(f.read("a.json").find("\"round_trip_us\"") != std::string::npos);

  Background echo(f, "echo", {"link-test", "--echo"});
  REQUIRE(echo.says("echoes on"));
  CHECK(f.run({"link-test", "--remote", "--count", "200"}).status == 0);
  CHECK(echo.end(SIGINT).status == 0);
  const auto nobody = f.run({"link-test", "--remote", "--count", "200"});
  CHECK(nobody.status == 1);
  CHECK(nobody.err.find("nothing came back") != std::string::npos);
  CHECK(f.run({"link-test", "--link", "udpm://10.0.0.1:1"}).status == 1);
}
