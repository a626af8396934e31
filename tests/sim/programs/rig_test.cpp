// saltus rig and saltus identify --link, as two programs.
#include "tests/support/background.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/network.hpp"

#include <nlohmann/json.hpp>

using namespace saltus::test;

TEST_CASE("in this process, over LCM to another one, and replayed from either log, an experiment gives the same bits") {
  SALTUS_OWN_NETWORK();
  const Folder f;
  REQUIRE(f.run(short_campaign({"--json", "here.json"})).status == 0);
  Background rig(f, "rig", short_rig({"--log", "rig.lcm"}));
  REQUIRE(rig.says("lockstep"));
  const auto over =
      f.run(short_campaign({"--link", "udpm://", "--log", "run.lcm", "--json", "link.json", "--save", "run.csv"}));
  INFO(over.err);
  REQUIRE(over.status == 0);
  const auto ended = rig.end(SIGINT);
  CHECK(ended.status == 0);
  CHECK(ended.out.find("messages heard") != std::string::npos);
  const std::string hash = hash_in(f, "here.json");
  CHECK(hash.size() == 16);
  CHECK(hash_in(f, "link.json") == hash);
  for (const char* log : {"file://run.lcm", "file://rig.lcm"}) {
    const auto replay = f.run(short_campaign({"--link", log, "--json", "replay.json"}));
    INFO(replay.err);
    CHECK(replay.status == 0);
    CHECK(hash_in(f, "replay.json") == hash);
  }

  // The log is a record too, to the bit the one that was saved.
  CHECK(f.run({"log", "run.lcm", "log.csv"}).status == 0);
  const auto rows = [](const std::string& text) { return text.substr(text.find("\nexperiment,")); };
  CHECK(rows(f.read("log.csv")) == rows(f.read("run.csv")));
  for (const char* record : {"run.lcm", "run.csv"}) {
    CHECK(f.run({"identify", "hopper", "--record", record, "--csv", std::string(record) + ".htf"}).status == 0);
  }
  CHECK(f.read("run.lcm.htf") == f.read("run.csv.htf"));

  // Other options are another experiment, and are refused.
  const auto other = f.run(short_campaign({"--link", "file://run.lcm", "--amplitude", "0.02"}));
  CHECK(other.status == 1);
  CHECK(other.err.find("another stimulus") != std::string::npos);
}

TEST_CASE("an experimenter waits for a rig, is refused a foreign model, a held machine, and a second rig is refused") {
  SALTUS_OWN_NETWORK();
  const Folder f;
  Background identify(f, "identify", short_campaign({"--link", "udpm://", "--json", "a.json", "--patience", "200"}));
  Background rig(f, "rig", short_rig({}));
  CHECK(identify.end(0).status == 0);
  CHECK(hash_in(f, "a.json").size() == 16);

  Background second(f, "second", short_rig({}));
  const auto refused = second.end(0);
  CHECK(refused.status == 1);
  CHECK(refused.err.find("is the machine there already") != std::string::npos);
  CHECK(refused.err.find("rig@") != std::string::npos);

  Background holder(f, "holder", short_campaign({"--link", "udpm://", "--settle", "100000", "--json", "b.json"}));
  REQUIRE(rig.says("in an experiment, number 0"));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  const auto busy = f.run(short_campaign({"--link", "udpm://"}));
  INFO(busy.err);
  CHECK(busy.status == 1);
  CHECK(busy.err.find("held by identify@") != std::string::npos);
  const auto stopped = holder.end(SIGTERM);
  CHECK(stopped.status == 1);
  CHECK(stopped.err.find("interrupted; the machine has been told to stop") != std::string::npos);
  CHECK(rig.end(SIGTERM).status == 0);

  const auto silent = f.run(short_campaign({"--link", "udpm://", "--patience", "0.2"}));
  CHECK(silent.status == 1);
  CHECK(silent.err.find("no machine answers") != std::string::npos);
}

TEST_CASE("what a rig does that the model does not is cried out while the experiment runs, with chart and phase") {
  SALTUS_OWN_NETWORK();
  const Folder f;
  Background rig(f, "rig", short_rig({"--effect", "viscous_drag@body=0.1"}));
  REQUIRE(rig.says("lockstep"));
  const auto done = f.run(short_campaign({"--link", "udpm://", "--watch", "0.001,0.006", "--json", "a.json"}));
  INFO(done.err);
  REQUIRE(done.status == 0);
  CHECK(done.err.find("saltus: drift: experiment 0, cycle ") != std::string::npos);
  const auto drifts = nlohmann::json::parse(f.read("a.json")).at("drifts");
  REQUIRE_FALSE(drifts.empty());
  const auto& first = drifts[0];
  CHECK(first.at("experiment") == 0);
  REQUIRE(first.contains("chart"));
  const double phase = first.at("phase");
  CHECK(first.at("chart") == (phase > 0.36 && phase < 0.51 ? "Stance" : "Flight"));
}

TEST_CASE("a killed rig or experimenter loses no logged data, and a restarted rig lets the experiment begin again") {
  SALTUS_OWN_NETWORK();
  const Folder f;
  REQUIRE(f.run(short_campaign({"--json", "here.json", "--settle", "400"})).status == 0);
  Background identify(f, "identify",
                      short_campaign({"--settle", "400", "--link", "udpm://", "--log", "run.lcm", "--json", "a.json"}));
  {
    Background first(f, "first", short_rig({"--log", "first.lcm"}));
    REQUIRE(first.says("in an experiment, number 0"));
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    CHECK(first.end(SIGKILL).status == 128 + SIGKILL);
  }
  Background rig(f, "rig", short_rig({"--log", "rig.lcm"}));
  const auto done = identify.end(0);
  INFO(done.err);
  CHECK(done.status == 0);
  CHECK(hash_in(f, "a.json") == hash_in(f, "here.json"));
  // What the killed rig wrote is whole, but for an event that was being written: the system may cut a write at a page.
  const auto damaged = [&](const std::string& log) {
    CHECK(f.run({"log", log + ".lcm", "--json", log + ".json"}).status == 0);
    return nlohmann::json::parse(f.read(log + ".json")).at("damaged_bytes").get<int>();
  };
  constexpr int event = 512;  // [B] the largest a campaign writes, and more
  CHECK(damaged("first") < event);

  Background killed(f, "killed", short_campaign({"--settle", "100000", "--link", "udpm://", "--log", "killed.lcm"}));
  std::this_thread::sleep_for(std::chrono::milliseconds(1000));
  CHECK(killed.end(SIGKILL).status == 128 + SIGKILL);
  CHECK(damaged("killed") < event);
  // Its successor waits out the lease and has the machine.
  CHECK(f.run(short_campaign({"--settle", "400", "--link", "udpm://", "--json", "b.json"})).status == 0);
  CHECK(hash_in(f, "b.json") == hash_in(f, "here.json"));
  CHECK(rig.end(SIGINT).status == 0);
}

TEST_CASE("paced, a rig and an experimenter keep time, and without the experimenter the rig goes to zero and stops") {
  SALTUS_OWN_NETWORK();
  const Folder f;
  Background rig(f, "rig", short_rig({"--rate", "1000", "--fail-safe", "200"}));
  const auto done =
      f.run(short_campaign({"--link", "udpm://", "--rate", "1000", "--fail-safe", "2000", "--json", "a.json"}));
  INFO(done.err);
  CHECK(done.status == 0);
  Background gone(f, "gone", short_campaign({"--link", "udpm://", "--rate", "1000", "--settle", "100000"}));
  std::this_thread::sleep_for(std::chrono::milliseconds(700));
  CHECK(gone.end(SIGKILL).status == 128 + SIGKILL);
  CHECK(rig.says("holds zero, for no commands come"));
  CHECK(rig.says("stopped, for no commands came"));
  // And the other way round.
  Background left(f, "left", short_campaign({"--link", "udpm://", "--rate", "1000", "--settle", "100000"}));
  std::this_thread::sleep_for(std::chrono::milliseconds(700));
  const auto ended = rig.end(SIGINT);
  CHECK(ended.status == 0);
  CHECK(ended.out.find("without a command of their own") != std::string::npos);
  CHECK(left.end(0).status == 1);
}

TEST_CASE("a rig takes no place where there is no network, and says what to do") {
  SALTUS_OWN_NETWORK(Multicasting::unrouted);
  const Folder f;
  for (const auto& arguments :
       {short_rig({}), short_campaign({"--link", "udpm://"}), std::vector<std::string>{"link-test"}}) {
    const auto done = f.run(arguments);
    CHECK(done.status == 1);
    CHECK(done.err.find("ip route add 224.0.0.0/4 dev lo") != std::string::npos);
  }
  CHECK(f.run(short_campaign({})).status == 0);  // in this process it always works
  CHECK(f.run(short_rig({"--link", "inproc"})).status == 2);
  CHECK(f.run(short_rig({"--link", "tcpq://127.0.0.1"})).status == 1);
}
