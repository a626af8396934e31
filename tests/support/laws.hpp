// The laws that every model keeps. A test hands a model to `obeys_laws`, and that is all.
#pragma once

#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <string_view>

#include "core/flow/advance.hpp"
#include "core/flow/linearise.hpp"
#include "tests/support/catch.hpp"

namespace saltus::laws {

// Parameters are named, have units, and survive a change of scalar.
template <class M>
void parameters(const M& m) {
  int count = 0;
  visit_parameters(m, [&](std::string_view name, std::string_view unit, const auto& value) {
    CHECK_FALSE(name.empty());
    CHECK_FALSE(unit.empty());
    CHECK(std::isfinite(value_of(value)));
    int same = 0;
    visit_parameters(m, [&](std::string_view other, auto, const auto&) { same += other == name; });
    CHECK(same == 1);
    ++count;
  });
  CHECK(count == parameter_count<M>);

  const auto values = [](const auto& model) {
    Vec<parameter_count<M>> v;
    int i = 0;
    visit_parameters(model, [&](auto, auto, const auto& value) { v[i++] = value_of(value); });
    return v;
  };
  constexpr int K = parameter_count<M> + 1;
  const auto lifted = lift_parameters<K>(m, 1);
  CHECK(values(lifted) == values(m));
  CHECK(values(lift<double>(lifted)) == values(m));
  int direction = 1;
  visit_parameters(lifted, [&](auto, auto, const Dual<K>& value) {
    for (int k = 0; k < K; ++k) CHECK(value.gradient[static_cast<std::size_t>(k)] == (k == direction ? 1.0 : 0.0));
    ++direction;
  });
}

// The start is finite and inside its chart: every guard positive, or at zero and rising.
template <class M>
void start(const M& m) {
  const Point<M> p = start_of(m);
  CHECK(p.chart >= 0);
  CHECK(p.chart < M::Charts::size);
  CHECK(p.x.allFinite());
  const Input<M> u = Input<M>::Zero();
  visit_each(typename M::Edges{}, [&](auto e) {
    using From = typename decltype(e)::from;
    if (index_of<From>(typename M::Charts{}) != p.chart) return;
    const double g = m.guard(e, p.in(From{}), u);
    const double rate = rate_along_flow(
        m, From{}, p.in(From{}), u, [&](const auto& lm, const auto& x, const auto& lu) { return lm.guard(e, x, lu); });
    INFO("guard of " << std::string(type_name<decltype(e)>()));
    CHECK((g > 0.0 || (g == 0.0 && rate > 0.0)));
  });
}

// Largest disagreement between dual numbers and central differences of f(model, x, u), relative to the derivatives.
template <class C, class M, class F>
double derivative_error(const M& m, const Vec<C::dim>& x, const Input<M>& u, const F& f) {
  constexpr int n = C::dim;
  constexpr int nu = input_count<M>;
  constexpr int K = n + nu + parameter_count<M>;
  const auto exact = f(lift_parameters<K>(m, n + nu), variables<n, K>(x, 0), variables<nu, K>(u, n));
  double worst = 0.0;
  for (int k = 0; k < K; ++k) {
    const auto moved = [&](double sign) {
      M model = m;
      Vec<n> y = x;
      Input<M> v = u;
      double step = 1e-5;
      const auto move = [&](double& entry) {
        step *= 1.0 + std::abs(entry);
        entry += sign * step;
      };
      if (k < n) {
        move(y[k]);
      } else if (k < n + nu) {
        move(v.data()[k - n]);
      } else {
        int i = n + nu;
        visit_parameters(model, [&](auto, auto, double& value) {
          if (i++ == k) move(value);
        });
      }
      return std::pair{f(model, y, v), step};
    };
    const auto [forth, step] = moved(1.0);
    const auto back = moved(-1.0).first;
    for (int i = 0; i < exact.size(); ++i) {
      const double d = exact[i].gradient[static_cast<std::size_t>(k)];
      const double error = std::abs(d - (forth[i] - back[i]) / (2.0 * step)) / (1.0 + std::abs(d));
      worst = error <= worst ? worst : error;  // a NaN is kept
      if (std::isnan(error)) return error;
    }
  }
  return worst;
}

// What holds at one state: derivatives; the clock's rate; nothing changes when the clock makes a turn.
template <class M>
void at_point(const M& m, const Point<M>& p, const Input<M>& u, const Timebase& base) {
  constexpr double tolerance = 1e-7;
  visit_chart(p, [&](auto c) {
    using C = decltype(c);
    const Vec<C::dim> x = p.in(c);
    INFO("chart " << std::string(type_name<C>()) << " at " << x.transpose());
    const auto wrap = [](auto scalar) {
      Vec<1, decltype(scalar)> v;
      v[0] = scalar;
      return v;
    };
    CHECK(derivative_error<C>(m, x, u, [&](const auto& q, const auto& y, const auto& v) { return q.flow(c, y, v); }) <
          tolerance);
    CHECK(derivative_error<C>(m, x, u, [&](const auto& q, const auto& y, const auto& v) { return q.output(c, y, v); }) <
          tolerance);
    Vec<C::dim> turned = x;
    if constexpr (HasClock<C>) {
      turned[C::clock] += 2.0 * std::numbers::pi;
      CHECK(std::abs(m.flow(c, x, u)[C::clock] * base.period - 2.0 * std::numbers::pi) < 1e-12);
      CHECK((m.flow(c, turned, u) - m.flow(c, x, u)).norm() < 1e-11 * (1.0 + m.flow(c, x, u).norm()));
    }
    visit_each(typename M::Edges{}, [&](auto e) {
      using E = decltype(e);
      if constexpr (std::is_same_v<typename E::from, C>) {
        CHECK(derivative_error<C>(m, x, u, [&](const auto& q, const auto& y, const auto& v) {
                return wrap(q.guard(e, y, v));
              }) < tolerance);
        CHECK(derivative_error<C>(
                  m, x, u, [&](const auto& q, const auto& y, const auto& v) { return q.reset(e, y, v); }) < tolerance);
        CHECK(std::abs(m.guard(e, turned, u) - m.guard(e, x, u)) < 1e-11 * (1.0 + std::abs(m.guard(e, x, u))));
      }
    });
  });
}

}  // namespace saltus::laws

namespace saltus {

// `ticks` ticks of the model from its start, every `stride`-th state examined. `per_turn` ticks a turn of its clock, or
// a second.
template <class M>
void obeys_laws(const M& m, int ticks = 600, int stride = 7, std::int64_t per_turn = 256) {
  static_assert(check<M>());
  static_assert(HybridModel<M>);
  laws::parameters(m);
  laws::start(m);
  const Timebase base = timebase_of(m, per_turn);
  CHECK(base.period > 0.0);
  Run<M> run;
  run.at = start_of(m);
  Input<M> u = Input<M>::Zero();
  for (int i = 0; i < ticks; ++i) {
    if (i % stride == 0) laws::at_point(m, run.at, u, base);
    const Passage r = step(m, run, u, base);
    INFO("tick " << i << ", status " << std::string(name(r.status)));
    REQUIRE(usable(r.status));
  }
}

}  // namespace saltus
