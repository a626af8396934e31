#include "sim/orbit_report.hpp"

#include <set>

#include "sim/models/bouncing_ball.hpp"
#include "sim/models/kneed_biped.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/orbit_laws.hpp"

using namespace saltus;
using saltus::SearchOutcome;

namespace {

const std::vector<std::string> edges{"KneeStrike", "FootStrike"};

bool says(const std::string& text, const std::string& words) { return text.find(words) != text.npos; }

}  // namespace

TEST_CASE("orbit report: every way to fail has a sentence of its own, and success none") {
  std::set<std::string> told;
  Search s;
  s.after = 1;
  s.met = 1;
  s.expected = 0;
  for (const SearchOutcome o :
       {SearchOutcome::no_convergence, SearchOutcome::other_event, SearchOutcome::no_event, SearchOutcome::fell,
        SearchOutcome::no_cycle, SearchOutcome::too_many, SearchOutcome::collapsed}) {
    s.outcome = o;
    told.insert(explain(s, edges));
  }
  CHECK(told.size() == 7);
  s.outcome = SearchOutcome::trouble;
  for (const Status status : {Status::zeno, Status::escaped, Status::diverged, Status::failed}) {
    s.status = status;
    told.insert(explain(s, edges));
  }
  CHECK(told.size() == 11);
  s.status = Status::escaped;
  for (const int behind : {0, 1}) {  // another guard, and the one that it came from
    s.behind = behind;
    told.insert(explain(s, edges));
  }
  CHECK(told.size() == 13);
  CHECK(told.count("") == 0);
  s.outcome = SearchOutcome::found;
  CHECK(explain(s, edges).empty());

  OrbitReport r;
  r.edges = edges;
  r.fine.count = 2;
  r.fine[0].edge = 0;
  r.fine[1].edge = 1;
  std::set<std::string> doubts;
  for (const Doubt d :
       {Doubt::other_order, Doubt::grazing, Doubt::coarse, Doubt::undecided_rank, Doubt::undecided_image,
        Doubt::outside_bounds, Doubt::unequal_spectra, Doubt::not_isolated, Doubt::not_periodic, Doubt::rank_changes}) {
    r.analysis.doubt = d;
    doubts.insert(explain(r));
  }
  r.analysis.doubt = Doubt::not_periodic;
  r.periodicity.same_order = true;
  doubts.insert(explain(r));
  CHECK(doubts.size() == 11);
  CHECK(doubts.count("") == 0);
  r.analysis.doubt = Doubt::none;
  CHECK(explain(r).empty());
}

TEST_CASE("orbit report: a sentence names the events it is about") {
  Search s;
  s.after = 1;
  s.expected = 0;
  s.met = 1;
  s.outcome = SearchOutcome::other_event;
  CHECK(explain(s, edges) ==
        "after FootStrike FootStrike comes where KneeStrike should: the gait changes its order of events");
  s.after = -1;
  s.outcome = SearchOutcome::fell;
  CHECK(explain(s, edges) == "from the start it falls");
}

TEST_CASE("orbit report: smaller steps are recommended only where they would help") {
  OrbitReport r;
  r.edges = edges;
  r.ticks = 512;
  r.fine.count = 1;
  r.fine[0].edge = 0;
  r.analysis.doubt = Doubt::undecided_rank;
  r.analysis.finer = true;
  CHECK(says(explain(r), "try --ticks 2048"));
  r.analysis.finer = false;
  CHECK_FALSE(says(explain(r), "--ticks"));
}

TEST_CASE("orbit report: stable, unstable and superstable are said of numbers with their errors, zeros included") {
  OrbitReport r;
  CHECK_FALSE(r.stable().has_value());  // nothing is known yet
  WideMultipliers& m = r.multipliers;
  m.dim = 3;
  m.nonzero = 2;
  m.value = {0.9, 0.5};
  m.error = {0.05, 0.05, 0.05};
  CHECK(r.stable() == true);
  m.error[1] = 0.6;  // not the largest one, but it may be
  CHECK_FALSE(r.stable().has_value());
  m.error = {0.05, 0.05, 1.2};  // nor is a zero one any more
  CHECK_FALSE(r.stable().has_value());
  m.value[0] = 1.1;
  CHECK(r.stable() == false);
  m.nonzero = 0;
  m.untold = 1;
  CHECK_FALSE(r.superstable());
  m.untold = 0;
  CHECK(r.superstable());
}

TEST_CASE("orbit report: a walker that falls, and a ball that comes to rest, are told apart") {
  const KneedBiped<> biped;
  WideCycle cycle;
  auto start = start_of(biped);
  start.x[3] = 0.1;  // pushed too little
  CHECK(says(explain(find_cycle(biped, start, 256, cycle), edges), "falls"));

  BouncingBall<> ball;
  ball.A = 0.0;  // the table rests, and so does the ball at last
  const Search rest = find_cycle(ball, start_of(ball), 256, cycle);
  CHECK(rest.outcome != SearchOutcome::found);
  CHECK(says(explain(rest, {"Impact"}), "comes to rest"));

  ball = {};
  ball.e = 0.5;  // thrown up once a turn, it bounces ever lower until it lies on the table, which is rising
  const Search lies = find_cycle(ball, start_of(ball), 512, cycle);
  CHECK(lies.behind == lies.after);
  CHECK(says(explain(lies, {"Impact"}), "events accumulate (chattering)"));
}

TEST_CASE("orbit report: a cycle that grazes its guard, or misses it with half the step, is a doubt with a mend") {
  const KneedBiped<> biped;
  const auto c = test::cycle_of(biped);
  OrbitReport r;
  r.edges = edges;
  r.ticks = 512;
  r.coarse = c->coarse;
  r.fine = c->fine;
  r.coarse[1].leg.rate = r.fine[1].leg.rate = 1e-9;  // the knee locks at no speed
  r.analysis = analyse(r.coarse, r.fine);
  CHECK(says(explain(r), "KneeStrike is met almost tangentially"));
  r.coarse = c->coarse;
  r.fine = c->fine;
  r.coarse.count = 1;
  r.analysis = analyse(r.coarse, r.fine);
  CHECK(says(explain(r), "another order of events"));
  CHECK(says(explain(r), "try --ticks 2048"));
}
