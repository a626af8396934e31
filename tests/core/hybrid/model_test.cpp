#include "core/hybrid/model.hpp"

#include <array>

#include "sim/models/hopper.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/laws.hpp"
#include "tests/support/worlds.hpp"

using namespace saltus;
using namespace saltus::worlds;

TEST_CASE("model: the worlds of the tests keep the laws of models") {
  obeys_laws(Ball<>{});
  obeys_laws(Wall<>{});
  obeys_laws(Pendulum<>{});
  obeys_laws(Fork<>{});
  obeys_laws(Box<>{});
  obeys_laws(Sawtooth<>{});
  obeys_laws(Relaxation<>{});
  obeys_laws(Metronome<>{});
  obeys_laws(Weave<>{});
}

namespace {

struct A : Chart<2> {};
struct B : Chart<5>, Clock<3> {};
struct C : Chart<1> {};
namespace inner {
struct Deep : Edge<A, B> {};
}  // namespace inner

}  // namespace

TEST_CASE("charts: positions, clocks and names") {
  using Charts = List<A, B>;
  static_assert(Charts::size == 2);
  static_assert(index_of<A>(Charts{}) == 0);
  static_assert(index_of<B>(Charts{}) == 1);
  static_assert(index_of<C>(Charts{}) == -1);
  static_assert(clock_of<A>() == -1);
  static_assert(clock_of<B>() == 3);
  static_assert(largest_dim(Charts{}) == 5);
  static_assert(any_clock(Charts{}));
  static_assert(!any_clock(List<A, C>{}));
  CHECK(type_name<A>() == "A");
  CHECK(type_name<inner::Deep>() == "Deep");
  CHECK(type_name<hopper::Touchdown>() == "Touchdown");

  int dim = 0;
  int visits = 0;
  const auto see = [&](auto c) {
    dim = decltype(c)::dim;
    ++visits;
  };
  visit_at(Charts{}, 1, see);
  CHECK(dim == 5);
  CHECK(visits == 1);
  visit_at(Charts{}, 2, see);
  visit_at(Charts{}, -1, see);
  CHECK(visits == 1);
  visit_each(Charts{}, see);
  CHECK(visits == 3);
}

TEST_CASE("model: the same model over another scalar") {
  static_assert(std::is_same_v<Rebind<Hopper<>, Dual<3>>, Hopper<Dual<3>>>);
  static_assert(std::is_same_v<Rebind<Hopper<Dual<3>>, double>, Hopper<>>);
  static_assert(std::is_same_v<ScalarOf<Hopper<Dual<2>>>, Dual<2>>);
  static_assert(std::is_same_v<Input<Hopper<>>, Vec<1>>);
  static_assert(std::is_same_v<Output<Hopper<>>, Vec<2>>);
  static_assert(max_dim<Hopper<>> == 5);
  static_assert(input_count<Fork<>> == 0);
  static_assert(parameter_count<Box<>> == 0);
  static_assert(clocked<Hopper<>> && !clocked<Ball<>>);

  Hopper<> m;
  m.k = 11.0;
  m.omega = 5.0;
  const auto lifted = lift<Dual<2>>(m);
  CHECK(lifted.k.value == 11.0);
  CHECK(lifted.omega.value == 5.0);
  CHECK(lifted.k.gradient == std::array<double, 2>{});

  // In float, for a small target.
  const auto small = lift<float>(Fork<>{});
  static_assert(std::is_same_v<decltype(small), const Fork<float>>);
  CHECK(small.guard(fork::ToRight{}, Vec<2, float>(0.25F, 0.5F), Vec<0, float>()) == 0.75F);
}

TEST_CASE("model: parameters are visited in order, and may be set by name") {
  Hopper<> m;
  std::string names;
  visit_parameters(m, [&](std::string_view name, std::string_view, double& value) {
    names += std::string(name) + " ";
    if (name == "b") value = 4.5;
  });
  CHECK(names == "m M k b l0 a omega g ");
  CHECK(m.b == 4.5);
}
