// Finds a limit cycle and all that is asked about it, for any model.
#pragma once

#include <cmath>
#include <memory>
#include <numbers>

#include "../../core/orbit/section.hpp"
#include "../eigenvalues.hpp"
#include "../orbit_report.hpp"
#include "orbit_portrait.hpp"
#include "program.hpp"

namespace saltus::program {

// What is asked about a limit cycle.
struct OrbitOptions {
  ModelChoice model;
  std::string sections;  // empty: the model's usual ones
  int count = 32;
  int returns = 1;
  std::vector<double> start, kinematic;
  bool portrait = false;
};

template <class L>
std::vector<std::string> type_names(L list) {
  std::vector<std::string> r;
  visit_each(list, [&](auto t) { r.emplace_back(type_name<decltype(t)>()); });
  return r;
}

// Section `index` of the family asked for; one type for both, so that the flow is compiled once.
struct SectionOnCycle {
  bool clock = false;
  ClockPhases phases{};
  KinematicPhases kinematic{};
  int index = 0;

  template <class M, class C>
  ScalarOf<M> value(const M& m, C c, const Vec<C::dim, ScalarOf<M>>& x, const Input<M>& u) const noexcept {
    if constexpr (HasClock<C>) {
      if (clock) return phases.value(index, m, c, x, u);
    }
    if constexpr (output_count<M> >= 2) return kinematic.value(index, m, c, x, u);
    return 1.0;
  }
};

template <class M>
class OrbitSearch {
 public:
  OrbitSearch(const M& m, const OrbitOptions& o) : m_(m), o_(o), cut_(std::make_unique<Cycles>()) {
    r_.model = M::name;
    r_.charts = type_names(typename M::Charts{});
    r_.edges = type_names(typename M::Edges{});
    r_.ticks = o.model.ticks;
    r_.returns = o.returns;
    check_ranges();
  }

  OrbitReport report() {
    choose_sections();
    find();
    halve_the_step();
    check_assumptions();
    place_sections();
    if (r_.analysis.doubt == Doubt::none) {
      compare_sections();
    } else if (r_.analysis.doubt == Doubt::undecided_rank || r_.analysis.doubt == Doubt::undecided_image) {
      r_.multipliers = multipliers_at(r_.coarse, r_.fine, 0);  // their errors hold: for stability
    }
    add_energy();
    if (o_.portrait) Portrait<M>(m_, r_).draw();
    add_notes();
    return std::move(r_);
  }

 private:
  static constexpr int width = orbit_width;
  static_assert(max_dim<M> <= width, "raise orbit_width");
  struct Cycles {
    WideCycle coarse, fine;  // with section 0 among the guards
  };

  [[noreturn]] void fail(const std::string& why) const { throw RunError(std::string(M::name) + ": " + why); }

  // What has no meaning is refused by its unit: a mass, a length or gravity that is not positive.
  void check_ranges() const {
    visit_parameters(m_, [&](auto name, auto unit, double value) {
      if ((unit == "kg" || unit == "m" || unit == "m/s^2") && !(value > 0.0)) {
        throw UsageError("--set " + std::string(name) + "=" + number(value) + " [" + std::string(unit) +
                         "]: it must be positive");
      }
    });
  }

  Point<M> start() const {
    Point<M> p = start_of(m_);
    if (o_.start.empty()) return p;
    const int dim = dim_of(p);
    if (static_cast<int>(o_.start.size()) != dim) {
      throw UsageError("--start: " + std::string(M::name) + " starts in " +
                       r_.charts[static_cast<std::size_t>(p.chart)] + ", which has " + std::to_string(dim) +
                       " coordinates; " + std::to_string(o_.start.size()) + " are given");
    }
    for (const double x : o_.start) {
      if (!std::isfinite(x)) throw UsageError("--start: give finite numbers");
    }
    for (int i = 0; i < dim; ++i) p.x[i] = o_.start[static_cast<std::size_t>(i)];
    return p;
  }

  void choose_sections() {
    r_.sections = o_.sections;
    if (r_.sections.empty()) {
      if (clocked<M>) {
        r_.sections = "clock";
      } else if (!r_.edges.empty()) {
        r_.sections = r_.edges.front();
      }
    }
    std::string known = clocked<M> ? "clock, " : "";
    known += "kinematic";
    bool fits = r_.sections == "kinematic" ? output_count<M> >= 2 : clocked<M> && r_.sections == "clock";
    for (const std::string& e : r_.edges) {
      known += ", " + e;
      fits = fits || r_.sections == e;
    }
    if (r_.sections != "kinematic" && !o_.kinematic.empty()) {
      throw UsageError("--kinematic: the sections are those of " + r_.sections + "; add --sections kinematic");
    }
    for (const double x : o_.kinematic) {
      if (!std::isfinite(x)) throw UsageError("--kinematic: give four finite numbers");
    }
    if (!fits) throw UsageError("--sections " + r_.sections + ": " + std::string(M::name) + " has " + known);
  }

  // A cycle ends where one of its multipliers reaches 1: it meets another one there, and neither goes on.
  static std::string near_fold(const WideCycle& cycle) {
    const int n = cycle[0].dim;
    for (const Complex& z : eigenvalues(return_map(cycle, 0).topLeftCorner(n, n))) {
      if (std::abs(z - 1.0) < 0.2)
        return "; a multiplier is " + number(z.real(), "%.3f") + " there, near 1: the cycle ends in a fold";
    }
    return {};
  }

  // By Newton's method from the start; with parameters set, along the way from the default ones.
  void find() {
    WideCycle& cycle = r_.coarse;
    const bool directly = o_.model.settings.empty() || !o_.start.empty() || o_.returns > 1;
    if (directly) {
      r_.search = find_cycle(m_, start(), o_.model.ticks, cycle, o_.returns);
      if (r_.search.outcome == SearchOutcome::found) return;
    }
    if (o_.model.settings.empty()) fail("no limit cycle found: " + explain(r_.search, r_.edges));
    const M usual{};
    double reached = 0.0;
    Search along = find_cycle(usual, start(), o_.model.ticks, cycle, o_.returns);
    if (along.outcome == SearchOutcome::found) along = follow_cycle(usual, m_, o_.model.ticks, cycle, reached);
    if (along.outcome == SearchOutcome::found) {
      r_.search = along;
      return;
    }
    std::string lost = "lost at once: ";
    if (reached > 0.0) lost = "lost after " + number(100.0 * reached, "%.3g") + " % of the way, where ";
    lost += explain(along, r_.edges);
    if (reached > 0.0 && along.outcome == SearchOutcome::no_convergence) lost += near_fold(cycle);
    if (!directly) r_.search = find_cycle(m_, start(), o_.model.ticks, cycle, o_.returns);
    if (r_.search.outcome != SearchOutcome::found) {
      std::string again = explain(r_.search, r_.edges);
      if (const std::string known = "from the start "; again.rfind(known, 0) == 0) again.erase(0, known.size());
      fail("no limit cycle found at these parameters: followed from the default ones it is " + lost +
           (o_.start.empty() ? "; from the model's own start " : "; from the --start given ") + again +
           "; set values nearer to the default ones, or give a --start near the cycle");
    }
    r_.notes.push_back("this is another cycle than that of the default parameters, which is " + lost);
  }

  void halve_the_step() {
    r_.fine = r_.coarse;
    const double patience = 8.0 * r_.coarse.period();
    const Search half = shoot(m_, r_.search.dt / 2.0, patience, r_.fine);
    if (half.outcome != SearchOutcome::found) {
      fail("with half the step " + explain(half, r_.edges) + ": an event was missed; try --ticks " +
           std::to_string(4 * o_.model.ticks));
    }
    r_.search.residual = half.residual;
    r_.analysis = analyse(r_.coarse, r_.fine);
  }

  void doubt(Doubt d, int at) {
    if (r_.analysis.doubt != Doubt::none) return;
    r_.analysis.doubt = d;
    r_.analysis.at = at;
  }

  void check_assumptions() {
    const WideCycle& cycle = r_.fine;
    r_.periodicity = repeat(m_, r_.search.dt / 2.0, cycle);
    if (!r_.periodicity.holds()) doubt(Doubt::not_periodic, 0);
    r_.reset_reach = 1e-3;
    for (int j = 0; j < cycle.count; ++j) {
      r_.resets.push_back(sample_reset(m_, cycle[j], r_.reset_reach));
      const int rank = r_.analysis.edge[static_cast<std::size_t>(j)].reset.value;
      if (rank >= 0 && !r_.resets.back().constant(rank)) doubt(Doubt::rank_changes, j);
    }
  }

  SectionOnCycle section(int index) const {
    SectionOnCycle s;
    s.clock = r_.sections == "clock";
    s.phases.sections = o_.count;
    s.kinematic = kinematic_;
    s.index = index;
    return s;
  }

  // Cuts both cycles at the section; the map that starts there, or -1.
  int cut(const SectionOnCycle& s, WideCycle& coarse, WideCycle& fine) const {
    const double dt = r_.search.dt;
    for (int j = 0; j < r_.fine.count; ++j) {
      coarse = r_.coarse;
      fine = r_.fine;
      if (cut_leg(m_, dt / 2.0, fine, j, fine[j].leg.duration, s) &&
          cut_leg(m_, dt, coarse, j, 1.5 * coarse[j].leg.duration, s)) {
        return j + 1;
      }
    }
    return -1;
  }

  OrbitReport::State state_of(int chart, const Vec<width>& x) const {
    OrbitReport::State s;
    visit_at(typename M::Charts{}, chart, [&](auto c) {
      using C = decltype(c);
      s.chart = type_name<C>();
      s.x.assign(x.data(), x.data() + C::dim);
      if constexpr (HasClock<C>) {
        constexpr double turn = 2.0 * std::numbers::pi;
        double& angle = s.x[static_cast<std::size_t>(clock_of<C>())];
        angle = std::remainder(angle, turn);
        if (angle < -1e-9) angle += turn;
      }
    });
    return s;
  }

  void place_sections() {
    int first = 0;
    const WideCycle* cycle = &r_.fine;
    if (r_.sections == "clock" || r_.sections == "kinematic") {
      if (r_.sections == "kinematic") set_kinematic_phase();
      r_.sections_asked = o_.count;
      r_.sections_met = 0;
      first = cut(section(0), cut_->coarse, cut_->fine);
      if (first < 0) {
        fail("--sections " + r_.sections +
             ": section 0 is not met; it may lie in the jump of an event. Use --sections " +
             (r_.edges.empty() ? std::string("clock") : r_.edges.front()));
      }
      cycle = &cut_->fine;
    } else {
      for (first = 0;
           first < cycle->count && r_.edges[static_cast<std::size_t>((*cycle)[first].edge)] != r_.sections;) {
        ++first;
      }
      if (first == cycle->count) {
        fail("--sections " + r_.sections + ": this edge is not taken on the limit cycle; its first one is " +
             r_.edges[static_cast<std::size_t>((*cycle)[0].edge)]);
      }
    }
    r_.fixed_point = state_of((*cycle)[first].chart, (*cycle)[first].x);
    double t = 0.0;
    for (int j = 0; j < cycle->count; ++j) {
      const EdgeMap<width>& map = (*cycle)[first + j];
      if (map.edge >= 0) {
        r_.events.push_back({r_.edges[static_cast<std::size_t>(map.edge)], t, state_of(map.chart, map.x),
                             state_of(map.leg.chart, map.leg.x0)});
      }
      t += map.leg.duration;
    }
  }

  void note_spectrum(const WideMultipliers& s) {
    if (s.status != Status::ok) return;
    ++r_.compared;
    r_.spread = std::fmax(r_.spread, spectral_distance(r_.multipliers, s));
    r_.allowed = std::fmax(r_.allowed, allowed_distance(r_.multipliers, s));
  }

  // The non-zero multipliers at the sections asked for, at every guard, and on a section in the middle of every leg.
  void compare_sections() {
    const auto spectrum = [&](int map) {
      // Up to the next guard it is one chart, and its flow a diffeomorphism: the rank is the one there (Remark 4).
      const int rank = r_.analysis.guard[static_cast<std::size_t>(map % r_.fine.count)].rank.value;
      return multipliers_at(cut_->coarse, cut_->fine, map, {rank, rank});
    };
    if (r_.sections_met == 0) {
      for (int i = 0; i < o_.count; ++i) {
        const int map = cut(section(i), cut_->coarse, cut_->fine);
        if (map < 0) continue;
        ++r_.sections_met;
        const WideMultipliers s = spectrum(map);
        if (i == 0) r_.multipliers = s;
        note_spectrum(s);
      }
    } else {
      for (int j = 0; j < r_.fine.count; ++j) {
        if (r_.edges[static_cast<std::size_t>(r_.fine[j].edge)] != r_.sections) continue;
        r_.multipliers = r_.analysis.guard[static_cast<std::size_t>(j)].spectrum;
        break;
      }
    }
    if (r_.multipliers.status != Status::ok) {
      fail("the multipliers on section 0 cannot be told; try --ticks " + std::to_string(4 * o_.model.ticks));
    }
    for (int j = 0; j < r_.fine.count; ++j) note_spectrum(r_.analysis.guard[static_cast<std::size_t>(j)].spectrum);
    for (int j = 0; j < r_.fine.count; ++j) {
      cut_->coarse = r_.coarse;
      cut_->fine = r_.fine;
      if (cut_leg(m_, r_.search.dt, cut_->coarse, j, 0.5 * r_.coarse[j].leg.duration) &&
          cut_leg(m_, r_.search.dt / 2.0, cut_->fine, j, 0.5 * r_.fine[j].leg.duration)) {
        note_spectrum(spectrum(j + 1));
      }
    }
    if (r_.spread > r_.allowed) {
      fail("the non-zero multipliers differ between sections by " + number(r_.spread, "%.1e") +
           ", more than their errors; try --ticks " + std::to_string(4 * o_.model.ticks));
    }
  }

  // Centre and half width of the orbit in the plane of an output and its rate.
  void set_kinematic_phase() {
    if constexpr (output_count<M> >= 2) {
      kinematic_.sections = o_.count;
      kinematic_.velocity = rate_output<M>(0);
      if (kinematic_.velocity < 0) kinematic_.velocity = 1;
      if (o_.kinematic.size() == 4) {
        kinematic_.o_p = o_.kinematic[0];
        kinematic_.o_v = o_.kinematic[1];
        kinematic_.s_p = o_.kinematic[2];
        kinematic_.s_v = o_.kinematic[3];
        if (!(kinematic_.s_p > 0.0 && kinematic_.s_v > 0.0)) {
          throw UsageError("--kinematic: the scales s_p and s_v must be positive");
        }
      } else if (M::name != std::string_view("hopper")) {
        Output<M> low = Output<M>::Constant(1e300);
        Output<M> high = -low;
        for (int j = 0; j < r_.fine.count; ++j) {
          walk_leg(m_, r_.fine[j].leg, 200, [&](auto c, const auto& x) {
            const Output<M> y = m_.output(c, x, Input<M>::Zero());
            low = low.cwiseMin(y);
            high = high.cwiseMax(y);
          });
        }
        const int v = kinematic_.velocity;
        kinematic_.o_p = 0.5 * (low[0] + high[0]);
        kinematic_.o_v = 0.5 * (low[v] + high[v]);
        kinematic_.s_p = std::fmax(1e-12, 0.5 * (high[0] - low[0]));
        kinematic_.s_v = std::fmax(1e-12, 0.5 * (high[v] - low[v]));
      }
    }
  }

  void add_energy() {
    if constexpr (requires(typename decltype(m_.start())::chart c, const Point<M>& p) { m_.energy(c, p.in(c)); }) {
      r_.energy_drift = 0.0;
      for (int j = 0; j < r_.fine.count; ++j) {
        const Leg<width>& leg = r_.fine[j].leg;
        visit_at(typename M::Charts{}, leg.chart, [&](auto c) {
          constexpr int n = decltype(c)::dim;
          const double a = m_.energy(c, Vec<n>(leg.x0.template head<n>()));
          const double b = m_.energy(c, Vec<n>(leg.x1.template head<n>()));
          r_.energy_drift = std::fmax(r_.energy_drift, std::abs(b / a - 1.0));
        });
      }
    }
  }

  void add_notes() {
    bool usual = true;
    const M defaults{};
    visit_parameters(defaults, [&](auto name, auto, double value) {
      visit_parameters(m_, [&](auto other, auto, double now) { usual = usual && (name != other || now == value); });
    });
    if constexpr (requires { M::note; }) {
      if (usual) r_.notes.emplace_back(M::note);
    }
    if (is_repeated<M>(r_.fine))
      r_.notes.emplace_back("this is a shorter cycle, run through several times: --returns is too large");
  }

  const M& m_;
  const OrbitOptions& o_;
  OrbitReport r_;
  std::unique_ptr<Cycles> cut_;
  KinematicPhases kinematic_{};
};

}  // namespace saltus::program
