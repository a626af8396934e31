#include "sim/models/kneed_biped.hpp"

#include <cmath>

#include "tests/support/chain.hpp"
#include "tests/support/laws.hpp"
#include "tests/support/malloc_guard.hpp"
#include "tests/support/orbit_laws.hpp"

using namespace saltus;
using test::angular_momentum;
using test::cycle_of;
using test::followed;
using test::has_multipliers;
using test::has_state;
using test::kinetic_energy;
using test::Masses;
using test::matrix_of;
using test::Moving;
using test::torque;

namespace {

constexpr int knee_strike = 0, foot_strike = 1;  // edges, and guards of the cycle
using WideMatrix = Mat<orbit_width, orbit_width>;

const std::vector<Complex> multipliers{
    {0.5883515198422658, 0.5084071030682252}, {0.5883515198422658, -0.5084071030682252}, {0.1685682819049621, 0.0}};

// The cycle with the knee strike first.
std::unique_ptr<test::FoundCycle> printed_cycle() {
  auto c = cycle_of(KneedBiped<>{});
  REQUIRE(c->fine.count == 2);
  REQUIRE(c->fine[0].edge == knee_strike);
  return c;
}

double distance(const WideMatrix& a, const WideMatrix& b) {
  return ((a - b).cwiseAbs().array() / (1.0 + b.cwiseAbs().array())).maxCoeff();
}

// The five masses, from the stance foot at rest upwards and down the other leg.
struct Walker {
  Moving hip, knee, foot;  // of the swing leg
  Masses stance, thigh, calf;

  Masses leg() const { return {thigh[0], calf[0]}; }
  Masses all() const {
    Masses r = stance;
    r.insert(r.end(), {thigh[0], calf[0]});
    return r;
  }
};
Walker walker(const KneedBiped<>& p, const Vec<3>& q, const Vec<3>& w, const Vec<3>& z = Vec<3>::Zero(),
              const Moving& pivot = {}) {
  const double half = p.leg_length / 2.0;
  const auto up = [&](double length) { return pivot.along(length, q[0], w[0], z[0]); };
  Walker r;
  r.hip = up(p.leg_length);
  r.knee = r.hip.along(-half, q[1], w[1], z[1]);
  r.foot = r.knee.along(-half, q[2], w[2], z[2]);
  r.stance = {{p.calf_mass, up(p.calf_com)}, {p.thigh_mass, up(half + p.thigh_com)}, {p.hip_mass, r.hip}};
  r.thigh = {{p.thigh_mass, r.hip.along(p.thigh_com - half, q[1], w[1], z[1])}};
  r.calf = {{p.calf_mass, r.knee.along(p.calf_com - half, q[2], w[2], z[2])}};
  return r;
}
Walker walker(const KneedBiped<>& p, const Vec<6>& x) { return walker(p, x.head<3>(), x.tail<3>()); }
Walker walker(const KneedBiped<>& p, const Vec<4>& x) {
  return walker(p, Vec<3>{x[0], x[1], x[1]}, Vec<3>{x[2], x[3], x[3]});
}
double mass_of(const KneedBiped<>& p) { return p.hip_mass + 2.0 * (p.thigh_mass + p.calf_mass); }

// What the two impacts of a step take away, [J]; and what the walker's descent along the slope brings.
double lost(const KneedBiped<>& p, const WideCycle& cycle) {
  double e = 0.0;
  for (int j = 0; j < cycle.count; ++j) {
    const auto& before = cycle[j].x;
    const auto& after = cycle[j].leg.x0;
    e += cycle[j].edge == knee_strike ? kinetic_energy(walker(p, Vec<6>(before.head<6>())).all()) -
                                            kinetic_energy(walker(p, Vec<4>(after.head<4>())).all())
                                      : kinetic_energy(walker(p, Vec<4>(before.head<4>())).all()) -
                                            kinetic_energy(walker(p, Vec<6>(after.head<6>())).all());
  }
  return e;
}
double gained(const KneedBiped<>& p, const WideCycle& cycle) {
  const double step = walker(p, Vec<4>(cycle[foot_strike].x.head<4>())).foot.r[0];
  return mass_of(p) * p.g * std::abs(step) * std::sin(p.slope);
}

KneedBiped<> another() {
  KneedBiped<> p;
  p.hip_mass = 5.5;
  p.thigh_mass = 4.8;
  p.calf_mass = 0.55;
  p.leg_length = 1.05;
  p.calf_com = 0.39;
  p.thigh_com = 0.18;
  p.slope = 0.052;
  p.g = 9.7;
  return p;
}

}  // namespace

TEST_CASE("kneed biped: keeps the laws of models and of cycles") {
  const KneedBiped<> p;
  obeys_laws(p, 400, 19, 256);
  test::obeys_cycle_laws(p, *printed_cycle());
}

TEST_CASE("kneed biped: states and durations are those computed elsewhere, and near those the paper prints") {
  const auto c = printed_cycle();
  const auto& knee = c->fine[knee_strike];
  const auto& foot = c->fine[foot_strike];
  const double exact = 1e-9;
  has_state(knee.x, exact, 0.02151023061709699, -0.2698948467938392, -0.2698948467938392, 0.8290966251552227,
            -0.4568272708949046, -11.45529862120729);
  has_state(knee.leg.x0, exact, 0.02151023061709699, -0.2698948467938392, 0.7742371628772308, -1.191426903596560);
  has_state(foot.x, exact, 0.2372067621116812, -0.2372067621116812, 1.516294513041198, 1.602312361575119);
  has_state(foot.leg.x0, exact, -0.2372067621116812, 0.2372067621116812, 0.2372067621116812, 1.130401536939771,
            -0.05519358750468769, 3.716377853805438);
  CHECK(std::abs(foot.leg.duration - 0.3472289328406736) < exact);
  CHECK(std::abs(knee.leg.duration - 0.1953605658288642) < exact);
  CHECK(std::abs(c->fine.period() - 0.5425894986695377) < exact);

  const double printed = 1.5e-3;
  has_state(knee.x, printed, 0.021462, -0.26990, -0.26990, 0.82882, -0.45645, -11.454);
  has_state(foot.x, printed, 0.23720, -0.23720, 1.5163, 1.6023);
}

TEST_CASE("kneed biped: the derivatives of legs and return maps are those computed elsewhere") {
  const auto c = printed_cycle();
  const double tolerance = 1e-8;
  CHECK(distance(total_derivative(c->fine[knee_strike].leg), matrix_of("biped/Dphi_l.csv")) < tolerance);
  CHECK(distance(total_derivative(c->fine[foot_strike].leg), matrix_of("biped/Dphi_u.csv")) < tolerance);
  const WideMatrix u = return_map(c->fine, knee_strike);
  const WideMatrix l = return_map(c->fine, foot_strike);
  CHECK(distance(u, matrix_of("biped/DP_u.csv")) < tolerance);
  CHECK(distance(l, matrix_of("biped/DP_l.csv")) < tolerance);

  // On the tangent spaces of the guards, where ns = k and s = -ns.
  WideMatrix on_u = WideMatrix::Zero();
  for (int i = 0; i < 5; ++i) {
    for (int j = 0; j < 5; ++j) on_u(i, j) = u(i < 2 ? i : i + 1, j < 2 ? j : j + 1);
    on_u(i, 1) += u(i < 2 ? i : i + 1, 2);
  }
  CHECK(distance(on_u, matrix_of("biped/DP_u_TG.csv")) < tolerance);
  WideMatrix on_l = WideMatrix::Zero();
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) on_l(i, j) = l(i == 0 ? 0 : i + 1, j == 0 ? 0 : j + 1);
    on_l(i, 0) -= l(i == 0 ? 0 : i + 1, 1);
  }
  CHECK(distance(on_l, matrix_of("biped/DP_l_TG.csv")) < tolerance);
}

TEST_CASE("kneed biped: spectra, equal at both guards, and near those the paper prints") {
  const auto c = printed_cycle();
  const auto& a = c->analysis;
  const double error = 1e-8;
  has_multipliers(a.leg[knee_strike].eigenvalues, {1.276507380588798, 0.4128559797220082, -0.2348298748862198}, error);
  has_multipliers(a.leg[foot_strike].eigenvalues,
                  {3.517037430379143,
                   -0.9901407397866038,
                   {-0.1350109411170741, 0.6636976171345357},
                   {-0.1350109411170741, -0.6636976171345357},
                   0.2337552432527635},
                  error);
  has_multipliers(a.guard[knee_strike].spectrum, multipliers, error);
  has_multipliers(a.guard[foot_strike].spectrum, multipliers, error);
  CHECK(a.spread <= a.allowed);
  CHECK(a.allowed < 1e-8);

  const double printed = 1.5e-3;
  const auto near = [&](const WideMultipliers& m, std::vector<Complex> paper) {
    for (std::size_t i = 0; i < paper.size(); ++i) CHECK(std::abs(m.value[i] - paper[i]) < printed);
  };
  near(a.leg[knee_strike].eigenvalues, {1.2765, 0.41277, -0.23479});
  near(a.guard[knee_strike].spectrum, {{0.58775, 0.50861}, {0.58775, -0.50861}, 0.16871});
  near(a.guard[foot_strike].spectrum, {{0.58836, 0.50742}, {0.58836, -0.50742}, 0.16930});
}

TEST_CASE("kneed biped: the flow's total derivative conjugates the return maps of two sections of one chart") {
  // Remark 4: DP' = Q DP Q^-1 on the tangent spaces of two sections, Q = Dphi from the one to the other.
  const KneedBiped<> p;
  const auto c = printed_cycle();
  const int j = foot_strike;  // then the knee is unlocked
  const double dt = c->search.dt / 2.0;
  const double whole = c->fine[j].leg.duration;
  WideCycle a = c->fine;
  WideCycle b = c->fine;
  REQUIRE(cut_leg(p, dt, a, j, 0.3 * whole));
  REQUIRE(cut_leg(p, dt, b, j, 0.7 * whole));
  const auto between =
      follow_leg<orbit_width>(p, point_in<KneedBiped<>>(a[j + 1].chart, a[j + 1].x), dt, 0.4 * whole, true);
  CHECK((between.x1 - b[j + 1].x).norm() < 1e-9);
  const WideMatrix q = total_derivative(between);
  const auto svd = decompose<orbit_width>(q);
  CHECK(svd.sigma[4] > 1e-2);  // a diffeomorphism of the sections
  CHECK(svd.sigma[5] < 1e-9);
  WideMatrix back = WideMatrix::Zero();
  for (int i = 0; i < 5; ++i) back += svd.v.col(i) * svd.u.col(i).transpose() / svd.sigma[static_cast<std::size_t>(i)];
  const WideMatrix here = return_map(a, j + 1) * onto_guard(a, j + 1);
  const WideMatrix there = return_map(b, j + 1) * onto_guard(b, j + 1);
  CHECK((here - there).norm() > 0.1 * there.norm());
  CHECK((q * here * back - there).norm() < 1e-8 * there.norm());
}

TEST_CASE("kneed biped: ranks, bounds, and why each zero is zero") {
  const auto c = printed_cycle();
  const auto& a = c->analysis;
  CHECK(a.leg[knee_strike].total.value == 3);
  CHECK(a.leg[foot_strike].total.value == 5);
  const auto& u = a.guard[knee_strike];
  const auto& l = a.guard[foot_strike];
  CHECK(u.rank.value == 3);
  CHECK(l.rank.value == 3);
  CHECK(u.bounds == Bounds{3, 3});
  CHECK(l.bounds == Bounds{1, 3});

  // Three zeros with the knee free: the section, and two for the chart of two dimensions less. One with it locked.
  CHECK(u.zeros.total() == 3);
  CHECK(u.zeros.section == 1);
  CHECK(u.zeros.dimension == 2);
  CHECK(l.zeros.total() == 1);
  CHECK(l.zeros.section == 1);
  CHECK(u.spectrum.index == 1);
  CHECK(l.spectrum.index == 1);

  // The knee strike is the one decreasing edge. Of the resets on the tangent spaces of their guards, it forgets one
  // direction of five, the foot strike none of three.
  CHECK(a.edge[knee_strike].rank.decreasing());
  CHECK_FALSE(a.edge[foot_strike].rank.decreasing());
  CHECK(a.edge[knee_strike].reset.value == 4);
  CHECK(a.edge[foot_strike].reset.value == 3);
  CHECK(a.edge[foot_strike].rank.transverse);
  CHECK(a.edge[knee_strike].map.value == 3);
  CHECK(a.edge[foot_strike].map.value == 3);
  CHECK(a.edge[knee_strike].bounds == Bounds{3, 3});
  CHECK(a.edge[foot_strike].bounds == Bounds{3, 3});
}

TEST_CASE("kneed biped: a step gains by its descent what its impacts take") {
  const KneedBiped<> p;
  const auto c = printed_cycle();
  const double step = walker(p, Vec<4>(c->fine[foot_strike].x.head<4>())).foot.r[0];
  CHECK(std::abs(step - 0.46997704924608524) < 1e-9);
  CHECK(std::abs(gained(p, c->fine) - 16.0 * 9.81 * 0.46997704924608524 * std::sin(0.0504)) < 1e-9);
  CHECK(std::abs(lost(p, c->fine) - gained(p, c->fine)) < 1e-9);
}

TEST_CASE("kneed biped: after foot strike the knee stands at its guard, and rises from it") {
  const KneedBiped<> p;
  const auto c = printed_cycle();
  const Vec<6> x = c->fine[foot_strike].leg.x0.head<6>();
  CHECK(std::abs(p.guard(kneed_biped::KneeStrike{}, x, Vec<0>{})) < 1e-12);
  CHECK(std::abs(x[5] - x[4] - 3.7715714413) < 1e-9);
}

TEST_CASE("kneed biped: the equations of motion are Newton's law of five masses") {
  const KneedBiped<> p = another();
  const Vec<2> gravity{p.g * std::sin(p.slope), -p.g * std::cos(p.slope)};
  const Vec<6> x{0.13, -0.32, -0.71, 0.9, -1.4, 2.3};
  const Vec<6> f = p.flow(kneed_biped::Unlocked{}, x, Vec<0>{});
  CHECK(f.head<3>() == x.tail<3>());
  const Walker w = walker(p, x.head<3>(), x.tail<3>(), f.tail<3>());
  CHECK(std::abs(torque(w.all(), Vec<2>::Zero(), gravity)) < 1e-11);
  CHECK(std::abs(torque(w.leg(), w.hip.r, gravity)) < 1e-11);
  CHECK(std::abs(torque(w.calf, w.knee.r, gravity)) < 1e-11);

  const Vec<4> y{0.13, -0.32, 0.9, -1.4};
  const Vec<4> g = p.flow(kneed_biped::Locked{}, y, Vec<0>{});
  CHECK(g.head<2>() == y.tail<2>());
  const Walker v = walker(p, {y[0], y[1], y[1]}, {y[2], y[3], y[3]}, {g[2], g[3], g[3]});
  CHECK(std::abs(torque(v.all(), Vec<2>::Zero(), gravity)) < 1e-11);
  CHECK(std::abs(torque(v.leg(), v.hip.r, gravity)) < 1e-11);
  CHECK(std::abs(torque(v.calf, v.knee.r, gravity)) > 0.1);  // the lock bears it
  CHECK(std::abs(p.guard(kneed_biped::FootStrike{}, y, Vec<0>{}) - v.foot.r[1]) < 1e-15);
  CHECK(std::abs(p.guard(kneed_biped::KneeStrike{}, x, Vec<0>{}) + 0.39) < 1e-15);
}

TEST_CASE("kneed biped: a torque at a joint is borne there and nowhere else") {
  const KneedBiped<> p;
  // Without speed and weight, so that what a torque of 1 N m does is all there is.
  const Vec<3> q{0.13, -0.32, -0.71};
  Vec<6> x = Vec<6>::Zero();
  x.head<3>() = q;
  const auto bears = [&](const Vec<6>& rate, double ankle, double hip, double knee) {
    const Walker w = walker(p, q, Vec<3>::Zero(), rate.tail<3>());
    // Angles are counted clockwise, moments the other way.
    CHECK(std::abs(torque(w.all(), Vec<2>::Zero(), Vec<2>::Zero()) + ankle) < 1e-12);
    CHECK(std::abs(torque(w.leg(), w.hip.r, Vec<2>::Zero()) + hip) < 1e-12);
    CHECK(std::abs(torque(w.calf, w.knee.r, Vec<2>::Zero()) + knee) < 1e-12);
  };
  bears(p.port(kneed_biped::Ankle{}, kneed_biped::Unlocked{}, x).per_force, 1.0, 0.0, 0.0);
  bears(p.port(kneed_biped::Hip{}, kneed_biped::Unlocked{}, x).per_force, 0.0, 1.0, 0.0);
  bears(p.port(kneed_biped::Knee{}, kneed_biped::Unlocked{}, x).per_force, 0.0, 0.0, 1.0);
}

TEST_CASE("kneed biped: an impact keeps the moment of momentum of all that hangs on each joint") {
  const KneedBiped<> p = another();
  // The knee locks: about the foot, and of the swing leg about the hip.
  const Vec<6> bent{0.03, -0.27, -0.27, 0.8, -0.5, -11.0};
  const Walker before = walker(p, bent);
  const Walker after = walker(p, p.reset(kneed_biped::KneeStrike{}, bent, Vec<0>{}));
  CHECK(std::abs(angular_momentum(before.all(), Vec<2>::Zero()) - angular_momentum(after.all(), Vec<2>::Zero())) <
        1e-12);
  CHECK(std::abs(angular_momentum(before.leg(), before.hip.r) - angular_momentum(after.leg(), after.hip.r)) < 1e-12);
  CHECK((before.foot.r - after.foot.r).norm() < 1e-15);

  // The foot strikes: of all about the new foot, of the old stance leg about the hip, of its calf about its knee.
  const Vec<4> straight{0.24, -0.24, 1.5, 1.6};
  const Walker coming = walker(p, straight);
  const Vec<6> x = p.reset(kneed_biped::FootStrike{}, straight, Vec<0>{});
  Moving pivot;
  pivot.r = coming.foot.r;
  const Walker gone = walker(p, x.head<3>(), x.tail<3>(), Vec<3>::Zero(), pivot);
  CHECK((gone.hip.r - coming.hip.r).norm() < 1e-15);
  CHECK(gone.foot.r.norm() < 1e-15);
  CHECK(std::abs(angular_momentum(coming.all(), pivot.r) - angular_momentum(gone.all(), pivot.r)) < 1e-12);
  const Masses trailing{coming.stance[0], coming.stance[1]};
  CHECK(std::abs(angular_momentum(trailing, coming.hip.r) - angular_momentum(gone.leg(), gone.hip.r)) < 1e-12);
  CHECK(std::abs(angular_momentum({trailing[0]}, gone.knee.r) - angular_momentum(gone.calf, gone.knee.r)) < 1e-12);
}

TEST_CASE("kneed biped: steeper, and with another build, its cycle keeps the laws and the energy") {
  KneedBiped<> steeper;
  steeper.slope = 0.055;
  for (const KneedBiped<>& p : {steeper, another()}) {
    const auto c = followed(KneedBiped<>{}, p);
    test::obeys_cycle_laws(p, *c);
    CHECK(std::abs(lost(p, c->fine) - gained(p, c->fine)) < 1e-9);
    const int knee = c->fine[0].edge == knee_strike ? 0 : 1;
    CHECK(c->analysis.guard[static_cast<std::size_t>(knee)].bounds == Bounds{3, 3});
    CHECK(c->analysis.guard[static_cast<std::size_t>(1 - knee)].bounds == Bounds{1, 3});
    CHECK(c->analysis.guard[0].spectrum.nonzero == 3);
    CHECK(std::abs(c->analysis.guard[0].spectrum.value[0] - multipliers[0]) > 1e-3);
  }
}

TEST_CASE("kneed biped: there is a second, shorter gait, unstable, that keeps the laws and the energy") {
  const KneedBiped<> p;
  const auto start = at<KneedBiped<>>(kneed_biped::Unlocked{}, Vec<6>{-0.235, 0.235, 0.235, 1.22, 0.27, 3.17});
  const auto c = cycle_of(p, start);
  test::obeys_cycle_laws(p, *c);
  CHECK(c->fine.period() < 0.5);
  CHECK(c->analysis.guard[0].spectrum.value[0].real() > 2.0);
  CHECK(c->analysis.guard[0].rank.value == 3);
  CHECK(std::abs(lost(p, c->fine) - gained(p, c->fine)) < 1e-9);
}

TEST_CASE("kneed biped: in other units it is the same walker") {
  // Twice as heavy, 1.21 times as tall and as much slower: the same angles and multipliers.
  KneedBiped<> p;
  for (double* mass : {&p.hip_mass, &p.thigh_mass, &p.calf_mass}) *mass *= 2.0;
  for (double* length : {&p.leg_length, &p.calf_com, &p.thigh_com}) *length *= 1.21;
  const auto c = followed(KneedBiped<>{}, p);
  REQUIRE(c->fine[0].edge == knee_strike);
  CHECK(std::abs(c->fine.period() - 1.1 * 0.5425894986695377) < 1e-9);
  has_state(c->fine[foot_strike].x, 1e-9, 0.2372067621116812, -0.2372067621116812, 1.516294513041198 / 1.1,
            1.602312361575119 / 1.1);
  has_multipliers(c->analysis.guard[0].spectrum, multipliers, 1e-8);
}

TEST_CASE("kneed biped: its states and multipliers are of fourth order, with both events inside the steps") {
  const KneedBiped<> p;
  const test::Halved ratio = test::halved(p, 128);
  INFO("states " << ratio.states << ", multipliers " << ratio.multipliers);
  CHECK(std::abs(ratio.states - 16.0) < 2.0);
  CHECK(std::abs(ratio.multipliers - 16.0) < 2.0);
}

TEST_CASE("kneed biped: its search and analysis do not allocate") {
  const KneedBiped<> p;
  const auto c = printed_cycle();
  const double period = c->fine.period();
  const test::AllocationCount allocated;
  const Search search = shoot(p, period / 128.0, 8.0 * period, c->coarse);
  shoot(p, period / 256.0, 8.0 * period, c->fine);
  c->analysis = analyse(c->coarse, c->fine);
  const Periodicity again = repeat(p, period / 256.0, c->fine);
  const auto sample = sample_reset(p, c->fine[0], 1e-3);
  CHECK(allocated() == 0);
  CHECK(search.outcome == SearchOutcome::found);
  CHECK(again.same_order);
  CHECK(sample.points == 12);
}
