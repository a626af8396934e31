// saltus log: both ways, what is in one, and what it refuses.
#include "tests/support/background.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/network.hpp"

using namespace saltus::test;

TEST_CASE("a record becomes an event log and comes back as it was") {
  const Folder f;
  REQUIRE(f.run(short_campaign({"--save", "run.csv"})).status == 0);
  CHECK(f.run({"log", "run.csv", "run.lcm"}).status == 0);
  CHECK(f.run({"log", "run.lcm", "again.csv"}).status == 0);
  CHECK(f.read("again.csv") == f.read("run.csv"));
  const auto told = f.run({"log", "run.lcm"});
  CHECK(told.status == 0);
  CHECK(told.out.find("SALTUS_MEAS") != std::string::npos);
  CHECK(told.out.find("of the model hopper") != std::string::npos);

  // Cut in the middle of an event: what is whole is read.
  const std::string whole = f.read("run.lcm");
  f.write("cut.lcm", whole.substr(0, whole.size() / 2));
  CHECK(f.run({"log", "cut.lcm", "cut.csv"}).status == 0);
  CHECK(f.read("cut.csv").size() < f.read("run.csv").size());
  f.write("empty.lcm", "");
  CHECK(f.run({"log", "empty.lcm", "x.csv"}).status == 1);
  CHECK(f.run({"log", "missing.lcm"}).status == 1);
  CHECK(f.run({"log"}).status == 2);
}

TEST_CASE("the logger keeps every message that passes") {
  SALTUS_OWN_NETWORK();
  const Folder f;
  Background logger(f, "logger", {"log", "--link", "udpm://", "all.lcm"});
  REQUIRE(logger.says("keeps what is said"));
  Background rig(f, "rig", short_rig({}));
  REQUIRE(f.run(short_campaign({"--link", "udpm://", "--json", "link.json", "--save", "run.csv"})).status == 0);
  CHECK(rig.end(SIGINT).status == 0);
  CHECK(logger.end(SIGINT).status == 0);
  CHECK(f.run(short_campaign({"--link", "file://all.lcm", "--json", "replay.json"})).status == 0);
  CHECK(hash_in(f, "replay.json") == hash_in(f, "link.json"));
  const auto told = f.run({"log", "all.lcm"});
  CHECK(told.out.find("SALTUS_HTF") != std::string::npos);
}
