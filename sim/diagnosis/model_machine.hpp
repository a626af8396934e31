// Machine over a model given as a type. Include it in one source a model: it is dear to compile.
#pragma once

#include <algorithm>
#include <cctype>
#include <numbers>

#include "../effects/candidates.hpp"
#include "core/trace/probe.hpp"
#include "machine.hpp"

namespace saltus::diagnosis {

inline std::string lower(std::string_view s) {
  std::string r(s);
  for (char& c : r) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return r;
}

// "quadratic_drag@body", "guard_offset@Touchdown", or the plain name of an effect of no port or edge.
template <template <class, class> class E, class P, class S>
std::string effect_name(const E<P, S>&) {
  std::string r(E<P, S>::law);
  const std::string place(type_name<P>());
  const bool edge = r == "guard_offset";
  r += '@';
  r += edge ? place : lower(place);
  return r;
}
template <class E>
std::string effect_name(const E&) {
  return std::string(E::law);
}

// M: With<Model, Effects...> over double.
template <class M>
class ModelMachine final : public Machine {
  static constexpr int start_directions = max_dim<M> - (clocked<M> ? 1 : 0);
  static constexpr int structural_parameters() {
    if constexpr (requires { decltype(M{}.model)::structural_parameters; }) {
      return decltype(M{}.model)::structural_parameters;
    } else {
      return 0;
    }
  }
  static constexpr int refitted =
      saltus::parameter_count<decltype(M{}.model)> - structural_parameters() - (clocked<M> ? 1 : 0);
  static constexpr int K = (start_directions + refitted + 4 + 3) / 4 * 4;
  using P = Probe<M, K>;

 public:
  explicit ModelMachine(const decltype(M{}.model) & nominal) {
    model_.model = nominal;
    name = M::name;
    has_clock = clocked<M>;
    in_steps = requires { decltype(M{}.model)::in_steps; };
    const auto add = [&](std::string label, std::string_view unit, double value, bool candidate) -> Coefficient& {
      Coefficient& c = coefficients.emplace_back();
      c.name = std::move(label);
      c.unit = unit;
      c.nominal = value;
      c.candidate = candidate;
      return c;
    };
    visit_parameters(nominal, [&](auto label, auto unit, double value) {
      if (label == "omega" && has_clock) clock = static_cast<int>(coefficients.size());
      Coefficient& c = add(std::string(label), unit, value, false);
      if constexpr (requires { nominal.uncertainty(label); }) c.uncertainty = nominal.uncertainty(label);
      if constexpr (requires { nominal.structural(label); }) {  // a coefficient that changes the charts themselves
        if (const double probe = nominal.structural(label); probe > 0.0) {
          c.candidate = true;
          c.physical = 1;
          c.probe = probe;
        }
      }
    });
    declared = coefficients.size();
    std::apply([&](const auto&... e) { (add_effect(e, add), ...); }, M{}.effects);
    Wires<M, double> w;
    Wires<M, double>::visit(w, [&](std::string_view label, std::string_view unit, double&, int channel) {
      std::string full(label);
      const bool output = label.substr(0, 6) == "sensor";
      if (channel >= 0 && (output ? M::outputs.size() : M::inputs.size()) > 1) {
        full += '@';
        full += output ? M::outputs[static_cast<std::size_t>(channel)].name
                       : M::inputs[static_cast<std::size_t>(channel)].name;
      }
      const bool idle = M::inputs.empty() && label.starts_with("input");
      Coefficient& c = add(full, unit, 0.0, !idle);
      c.shifts_time = unit == "s" && label != "clock_offset";
      if (c.shifts_time) c.physical = 1;
    });
    for (const auto& q : M::inputs) inputs.push_back({std::string(q.name), std::string(q.unit)});
    for (const auto& q : M::outputs) outputs.push_back({std::string(q.name), std::string(q.unit)});
    visit_each(typename M::Charts{}, [&](auto c) { charts.emplace_back(type_name<decltype(c)>()); });
    cycle_period = timebase_of(model_, 32).period;
  }

  int starts() const override { return start_directions; }
  int directions() const override { return P::free_directions; }
  int width() const override { return K; }

  std::vector<int> free_coordinates(int chart) const override {
    std::vector<int> r;
    visit_at(typename M::Charts{}, chart, [&](auto c) {
      for (int i = 0; i < decltype(c)::dim; ++i) {
        if (i != clock_of<decltype(c)>()) r.push_back(i);
      }
    });
    return r;
  }

  Response run(std::span<const double> values, const Course& course, const Start& start, std::span<const int> wanted,
               bool derivatives) const override {
    typename P::Values v;
    std::copy_n(values.begin(), v.size(), v.begin());
    P probe(v, wanted);
    Point<M> at;
    at.chart = start.chart;
    for (std::size_t i = 0; i < start.x.size(); ++i) at.x[static_cast<int>(i)] = start.x[i];
    if constexpr (clocked<M>) at.x[clock_index(at)] = angle(values, course.t[course.first]);
    Response r;
    constexpr std::size_t ny = static_cast<std::size_t>(output_count<M>);
    r.rows = (course.t.size() - course.first) * ny;
    r.y.resize(r.rows);
    if (derivatives) r.gradient.resize(r.rows * K);
    r.status = probe.run(
        course, at,
        [&](std::size_t i, const auto& y) {
          for (std::size_t j = 0; j < ny; ++j) {
            const std::size_t row = (i - course.first) * ny + j;
            r.y[row] = y[static_cast<int>(j)].value;
            if (!derivatives) continue;
            std::copy_n(y[static_cast<int>(j)].gradient.begin(), K,
                        r.gradient.begin() + static_cast<std::ptrdiff_t>(row * K));
          }
        },
        derivatives);
    r.events = probe.events();
    r.end = pack(probe.at());
    return r;
  }

  std::vector<Start> cycle(std::span<const double> values, int turns, int per_turn) const override {
    M m = model_;
    std::size_t i = 0;
    visit_parameters(m, [&](auto, auto, double& v) { v = values[i++]; });
    m.rest_idle();
    const Timebase base = timebase_of(m, std::int64_t{per_turn} * ((511 + per_turn) / per_turn));
    Run<M> run;
    run.at = start_of(m);
    set_clock(run.at, base, 0);
    std::vector<Start> r;
    for (std::int64_t n = 0; n < (turns + 1) * base.per_turn; ++n) {
      if (n >= turns * base.per_turn && n % (base.per_turn / per_turn) == 0) r.push_back(pack(run.at));
      if (!usable(step(m, run, Input<M>(Input<M>::Zero()), base).status)) return {};
    }
    return r;
  }

 private:
  template <class E, class Add>
  void add_effect(const E& e, Add& add) {
    int place = 0;
    std::string first;
    saltus::visit_parameters(e, [&](auto, auto unit, double) {
      std::string label = effect_name(e);
      if (place++ > 0) {
        label += '/';
        label += std::to_string(place);
      } else {
        first = label;
      }
      Coefficient& c = add(label, unit, 0.0, true);
      if constexpr (requires { E::physical; }) c.physical = E::physical;
      if constexpr (requires { E::kinked; }) c.kinked = E::kinked;
      if constexpr (requires { E::profile; }) {
        c.candidate = false;
        c.profile_of = label.substr(label.find('@') + 1, label.find('/') - label.find('@') - 1);
      }
      if constexpr (requires { E::last_resort; }) {
        c.candidate = false;
        if (place > 1) c.sine_of = first;
      }
      if constexpr (requires { E::refines; }) {
        c.refines = "coulomb_friction";
        c.refines += label.substr(label.find('@'));
        if constexpr (requires { E::physical_sum; }) c.physical_sum = E::physical_sum;
      }
    });
  }
  static Start pack(const Point<M>& p) {
    Start s;
    s.chart = p.chart;
    for (int i = 0; i < dim_of(p); ++i) s.x.push_back(p.x[i]);
    return s;
  }
  // The clock starts at zero with the experiment.
  double angle(std::span<const double> values, double t) const {
    const double rate = clock >= 0 ? values[static_cast<std::size_t>(clock)] : 2.0 * std::numbers::pi / cycle_period;
    const double turns = t * rate / (2.0 * std::numbers::pi);
    return 2.0 * std::numbers::pi * (turns - std::floor(turns));
  }

  M model_;
};

}  // namespace saltus::diagnosis
