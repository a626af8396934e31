// The phase portrait of a limit cycle: every leg and event, and what starts beside it.
#pragma once

#include <cmath>
#include <limits>

#include "../orbit_report.hpp"

namespace saltus::program {

// Calls f(C, x) at `points` + 1 states along a leg, ends included.
template <class M, class F>
void walk_leg(const M& m, const Leg<orbit_width>& leg, int points, F&& f) {
  Point<M> p = point_in<M>(leg.chart, leg.x0);
  visit_chart(p, [&](auto c) {
    f(c, p.in(c));
    for (int i = 1; i < points; ++i) {
      const Passage r = advance(m, p, Input<M>::Zero(), leg.duration / points);
      if (!usable(r.status) || r.events > 0) break;
      f(c, p.in(c));
    }
    f(c, point_in<M>(leg.chart, leg.x1).in(c));
  });
}

// The output that is the rate of another one, by their units and order; -1 where there is none.
template <class M>
int rate_output(int output) {
  const std::string_view unit = M::outputs[static_cast<std::size_t>(output)].unit;
  int before = 0;
  for (int i = 0; i < output; ++i) before += M::outputs[static_cast<std::size_t>(i)].unit == unit ? 1 : 0;
  for (int i = 0; i < output_count<M>; ++i) {
    if (M::outputs[static_cast<std::size_t>(i)].unit == std::string(unit) + "/s" && before-- == 0) return i;
  }
  return -1;
}

// Draws into the report: outputs against their rates; of three outputs without rates, an oblique view of space.
template <class M>
class Portrait {
 public:
  Portrait(const M& m, OrbitReport& r) : m_(m), r_(r) {
    for (int i = 0; i < output_count<M>; ++i) {
      const int rate = rate_output<M>(i);
      if (rate >= 0) views_.push_back({i, rate, -1, std::string(M::outputs[static_cast<std::size_t>(i)].name)});
    }
    if (views_.empty() && output_count<M> >= 2) views_ = {{0, 1, output_count<M> > 2 ? 2 : -1, ""}};
    if (views_.size() == 1) views_[0].title.clear();
  }

  void draw() {
    if (views_.empty()) return;
    const View& first = views_[0];
    r_.x_label = views_.size() > 1 ? "angle [rad]" : (first.z < 0 ? label(first.x) : "x - 0.45 z [-], seen obliquely");
    r_.y_label = views_.size() > 1 ? "rate [rad/s]" : (first.z < 0 ? label(first.y) : "y - 0.3 z [-]");
    for (int j = 0; j < r_.fine.count; ++j) {
      const EdgeMap<orbit_width>& map = r_.fine[j];
      for (const View& v : views_) {
        OrbitReport::Series s{v.title, r_.charts[static_cast<std::size_t>(map.leg.chart)], false, {}};
        walk_leg(m_, map.leg, 300, [&](auto c, const auto& x) { s.points.push_back(v.of(m_.output(c, x, none()))); });
        r_.portrait.push_back(std::move(s));
      }
      std::vector<std::pair<double, double>> ends;
      for (const View& v : views_) {
        ends.push_back(v.of(output_at(m_, point_in<M>(map.chart, map.x), none())));
        ends.push_back(v.of(output_at(m_, point_in<M>(map.leg.chart, map.leg.x0), none())));
      }
      r_.marks.emplace_back(r_.edges[static_cast<std::size_t>(map.edge)], ends);
    }
    frame();
    draw_transients();
  }

 private:
  struct View {
    int x, y, z;  // outputs; z < 0: a plane
    std::string title;

    std::pair<double, double> of(const Output<M>& output) const {
      if (z < 0) return {output[x], output[y]};
      return {output[x] - 0.45 * output[z], output[y] - 0.3 * output[z]};
    }
  };

  static Input<M> none() { return Input<M>::Zero(); }
  static std::string label(int output) {
    const Quantity& q = M::outputs[static_cast<std::size_t>(output)];
    return std::string(q.name) + " [" + std::string(q.unit) + "]";
  }

  // The cycle and half its size around it: what leaves that, fallen or lost, would dwarf it.
  void frame() {
    for (const auto& s : r_.portrait) {
      for (const auto& [x, y] : s.points) {
        low_ = {std::fmin(low_.first, x), std::fmin(low_.second, y)};
        high_ = {std::fmax(high_.first, x), std::fmax(high_.second, y)};
      }
    }
    const std::pair<double, double> edge{0.5 * (high_.first - low_.first), 0.5 * (high_.second - low_.second)};
    low_ = {low_.first - edge.first, low_.second - edge.second};
    high_ = {high_.first + edge.first, high_.second + edge.second};
  }
  bool framed(const std::pair<double, double>& p) const {
    return low_.first <= p.first && p.first <= high_.first && low_.second <= p.second && p.second <= high_.second;
  }

  // From beside the cycle, two rounds: each coordinate moved both ways by a tenth of its range.
  void draw_transients() {
    const Leg<orbit_width>& leg = r_.fine[0].leg;
    Vec<orbit_width> low = leg.x0;
    Vec<orbit_width> high = leg.x0;
    walk_leg(m_, leg, 50, [&](auto c, const auto& x) {
      constexpr int n = decltype(c)::dim;
      low.template head<n>() = low.template head<n>().cwiseMin(x);
      high.template head<n>() = high.template head<n>().cwiseMax(x);
    });
    for (int i = 0; i < 2 * leg.dim; ++i) {
      Point<M> p = point_in<M>(leg.chart, leg.x0);
      if (i / 2 == clock_index(p)) continue;
      const double range = high[i / 2] - low[i / 2];
      p.x[i / 2] += (i % 2 == 0 ? 0.1 : -0.1) * (range > 0.0 ? range : (high - low).maxCoeff());
      draw_transient(p);
    }
  }

  void draw_transient(Point<M> p) {
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    const double dt = 2.0 * r_.search.dt;
    std::vector<OrbitReport::Series> series(views_.size());
    for (double t = 0.0; t < 2.0 * r_.period(); t += dt) {
      const Output<M> y = output_at(m_, p, none());
      bool inside = true;
      for (const View& v : views_) inside = inside && framed(v.of(y));
      if (!inside) break;
      for (std::size_t k = 0; k < views_.size(); ++k) series[k].points.push_back(views_[k].of(y));
      const Passage r = advance(m_, p, none(), dt);
      if (!usable(r.status)) break;
      for (auto& s : series) {
        if (r.events > 0) s.points.emplace_back(nan, nan);
      }
    }
    for (auto& s : series) {
      s.transient = true;
      r_.portrait.push_back(std::move(s));
    }
  }

  const M& m_;
  OrbitReport& r_;
  std::vector<View> views_;
  std::pair<double, double> low_{1e300, 1e300}, high_{-1e300, -1e300};
};

}  // namespace saltus::program
