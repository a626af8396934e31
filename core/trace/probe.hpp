// Runs a model along a course with K exact derivatives of every output sample: with respect to the state at the start
// and to any choice of parameters of the model, of its candidate effects and of the wires. The derivatives go through
// events by saltation (Ankarali & Cowan 2014, sec. II; linearise.hpp) and are the signatures by which effects are told.
//
// The input line: what is held between samples, moved by a delay and smoothed by a lag, in closed form. Where a
// boundary of the held input moves by dtau, the state beyond gains (f(x, u before) - f(x, u after)) dtau.
// The sensor line: a delay is read off at the earlier time, a lag filters the outputs' own cubic, in closed form.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>

#include "../flow/linearise.hpp"
#include "../hybrid/with.hpp"
#include "course.hpp"
#include "wires.hpp"

namespace saltus {

// M is a model over double that can rest its idle effects: With<Model, Effects...>.
template <class M, int K>
class Probe {
 public:
  using D = Dual<K>;
  using LM = Rebind<M, D>;
  static constexpr int nu = input_count<M>, ny = output_count<M>;
  static constexpr int parameters = parameter_count<M> + Wires<M>::parameter_count;
  static constexpr int largest_start = max_dim<M> - (clocked<M> ? 1 : 0);  // coordinates of a start, without a clock
  static constexpr int free_directions = K - largest_start;                // what is left for parameters
  static constexpr std::int64_t most_parts = 100;
  static_assert(free_directions >= 1);
  using Values = std::array<double, static_cast<std::size_t>(parameters)>;
  using Sample = Vec<ny, D>;

  // `values`: the parameters of the model, then those of the wires, in declared order. directions[i] is the parameter
  // that direction largest_start + i stands for, -1 for none; directions 0 ... largest_start - 1 are the coordinates of
  // the start but for the clock.
  Probe(const Values& values, std::span<const int> directions) noexcept {
    std::array<int, static_cast<std::size_t>(parameters)> slot;
    slot.fill(-1);
    for (std::size_t i = 0; i < directions.size() && i < static_cast<std::size_t>(free_directions); ++i) {
      if (directions[i] >= 0) slot[static_cast<std::size_t>(directions[i])] = largest_start + static_cast<int>(i);
    }
    std::size_t i = 0;
    visit_parameters(model_, [&](auto, auto, double& v) { v = values[i++]; });
    i = 0;
    const auto lifted = [&](D& v) {
      v = D(values[i]);
      if (slot[i] >= 0) v.gradient[static_cast<std::size_t>(slot[i])] = 1.0;
      ++i;
    };
    visit_parameters(lifted_, [&](auto, auto, D& v) { lifted(v); });
    Wires<M, D>::visit(wires_, [&](auto, auto, D& v, int) { lifted(v); });
    lifted_.rest_idle();
    model_.resting = lifted_.resting;
    sensor_moves_ = !(vanishes(wires_.sensor_delay) && vanishes(wires_.sensor_lag));
    delay_moves_ = moving(wires_.input_delay);
    lag_moves_ = moving(wires_.input_lag);
  }

  // Calls on_sample(i, y) for every sample from course.first on; y carries the derivatives. The status is the worst
  // met; where it is not usable the run ends early. It is `failed` where stiff forces would cut the steps into more
  // than most_parts each, on average: a friction that holds its port still for good. With a clock, start's clock
  // coordinate is the angle at t[first]. Without `derivatives` only the values of y mean anything, at a fraction of the
  // cost.
  template <class OnSample>
  Status run(const Course& course, const Point<M>& start, OnSample&& on_sample, bool derivatives = true) noexcept {
    derivatives_ = derivatives || wires_.sensor_lag.value > 0.0;  // a lag is that of the lifted outputs
    begin(course, start);
    const double delay = wires_.sensor_delay.value;
    for (std::size_t i = course.first; i < course.t.size(); ++i) {
      const double target = course.t[i] - delay;
      if (target >= now_) {
        move_to(target);
        if (!usable(status_)) return status_;
        on_sample(i, measured());
      } else {
        on_sample(i, measured_before(target - now_));
      }
    }
    return status_;
  }

  // Where the last run stopped.
  const Point<M>& at() const noexcept { return at_; }
  std::int64_t events() const noexcept { return events_; }

 private:
  static bool moving(const D& d) noexcept {
    for (const double g : d.gradient) {
      if (g != 0.0) return true;
    }
    return false;
  }
  Vec<nu, D> input(std::size_t k) const noexcept {
    Vec<nu, D> u;
    for (int j = 0; j < nu; ++j) {
      const auto c = static_cast<std::size_t>(j);
      const double raw = course_.u[k * static_cast<std::size_t>(nu) + c];
      u[j] = raw + raw * wires_.input_gain[c] + wires_.input_bias[c];
    }
    return u;
  }
  double boundary(std::size_t k) const noexcept { return course_.t[k] + wires_.input_delay.value; }

  void begin(const Course& course, const Point<M>& start) noexcept {
    course_ = course;
    status_ = Status::ok;
    events_ = pieces_ = parts_ = 0;
    at_ = start;
    now_ = course.t[course.first];
    moving_.chart = start.chart;
    moving_.x = constants<max_dim<M>, K>(start.x);
    int direction = 0;
    const int clock = clock_index(start);
    for (int i = 0; i < dim_of(start); ++i) {
      if (i == clock) continue;
      moving_.x[i].gradient[static_cast<std::size_t>(direction++)] = 1.0;
    }
    // What the input had become at the start, from all the history there is.
    held_ = 0;
    filtered_ = input(0);
    while (held_ + 1 < course.t.size() && boundary(held_ + 1) <= now_) {
      const double from = boundary(held_);
      ++held_;
      if (wires_.input_lag.value > 0.0) relax(input(held_ - 1), boundary(held_) - from);
    }
    if (wires_.input_lag.value > 0.0) {
      relax(input(held_), std::max(0.0, now_ - boundary(held_)));
    } else {
      filtered_ = input(held_);
    }
    if constexpr (clocked<M>) {
      visit_chart(at_, [&](auto c) {
        constexpr int j = clock_of<decltype(c)>();
        const D turned = lifted_.flow(c, moving_.in(c), filtered_)[j] * wires_.clock_offset;
        moving_.x[j] += turned;
        at_.x[j] += turned.value;
      });
    }
    lagging_ = false;
    if (wires_.sensor_lag.value > 0.0) {  // as if the motion had gone on like this for ever
      const double back = 2.0 * wires_.sensor_lag.value;
      const auto seen = [&] { return reading(); };
      smooth(seen_before(-back, seen), seen_before(0.0, seen), back, true);
      lagging_ = true;
    }
  }

  // First-order lag of the held input during d seconds; returns its mean.
  Vec<nu, D> relax(const Vec<nu, D>& u, double d) noexcept {
    if (d <= 0.0) return filtered_;
    const D ratio = d / wires_.input_lag;
    const D left = exp(-ratio);
    const D share = (1.0 - left) / ratio;
    Vec<nu, D> mean;
    for (int j = 0; j < nu; ++j) {
      const D off = filtered_[j] - u[j];
      mean[j] = u[j] + off * share;
      filtered_[j] = u[j] + off * left;
    }
    return mean;
  }

  // The next held input begins to act.
  void cross_boundary() noexcept {
    const Vec<nu, D> before = input(held_);
    ++held_;
    const Vec<nu, D> after = input(held_);
    if (wires_.input_lag.value > 0.0) {
      if (!delay_moves_) return;
      for (int j = 0; j < nu; ++j) {
        const double rate = (before[j].value - after[j].value) / wires_.input_lag.value;
        for (std::size_t k = 0; k < static_cast<std::size_t>(K); ++k) {
          filtered_[j].gradient[k] += rate * wires_.input_delay.gradient[k];
        }
      }
      return;
    }
    filtered_ = after;
    if (!derivatives_ || (!delay_moves_ && !lag_moves_)) return;
    visit_chart(at_, [&](auto c) {
      constexpr int n = decltype(c)::dim;
      const Vec<n> x = at_.in(c);
      const Vec<n> jump = model_.flow(c, x, value_of(before)) - model_.flow(c, x, value_of(after));
      for (int i = 0; i < n; ++i) {
        for (std::size_t k = 0; k < static_cast<std::size_t>(K); ++k) {
          moving_.x[i].gradient[k] += jump[i] * (wires_.input_delay.gradient[k] + wires_.input_lag.gradient[k]);
        }
      }
    });
  }

  void move_to(double target) noexcept {
    while (usable(status_)) {
      while (held_ + 1 < course_.t.size() && boundary(held_ + 1) <= now_) cross_boundary();
      if (!(now_ < target)) return;
      double end = target;
      if (held_ + 1 < course_.t.size()) end = std::min(end, boundary(held_ + 1));
      const int pieces = std::max(1, static_cast<int>(std::ceil((end - now_) / course_.h_max - 1e-9)));
      double h = (end - now_) / pieces;
      const double lag = wires_.input_lag.value;
      if (lag > 0.0) {  // short steps while the input still moves, and shorter where steps are to be
        const double begun = boundary(held_), since = now_ - begun;
        const double held_for = (held_ + 1 < course_.t.size() ? boundary(held_ + 1) : end) - begun;
        const double fine = std::min(1.0, course_.h_max / held_for);
        if (since < 12.0 * lag) h = std::min(h, fine * std::max(0.5 * lag, since));
      }
      const bool last = now_ + h * (1.0 + 1e-12) >= end;
      piece(last ? end - now_ : h);
      now_ = last ? end : now_ + h;
    }
  }

  // One step, in parts where the chart or the sign of a kinked force changes within it or a chart is stiff.
  void piece(double h) noexcept {
    const bool filters = wires_.input_lag.value > 0.0;
    const Vec<nu, D> at_first = filtered_;
    const Vec<nu, D> u = filters ? relax(input(held_), h) : filtered_;
    const Input<M> u0 = value_of(u);
    const Point<M> before = at_;
    const Passage r = advance(model_, at_, u0, h);
    // Of a moving input the mean over a step is not the mean before an event within it.
    const bool even = !filters || r.events == 0;
    const bool alike = even && before.chart == at_.chart && kink_signs(before) == kink_signs(at_);
    int parts = alike ? 1 : 16;
    const double stiffness = stiffness_between(before, at_, h);
    if (h * stiffness > 1.0) parts = std::max(parts, static_cast<int>(std::ceil(std::min(500.0, h * stiffness))));
    const double limit = std::min(longest_step(before), longest_step(at_));
    if (h > limit) parts = std::max(parts, static_cast<int>(std::ceil(h / limit)));
    ++pieces_;
    parts_ += parts;
    if (parts_ > most_parts * (pieces_ + 16)) {
      status_ = Status::failed;
      return;
    }
    if (parts > 1) {
      at_ = before;
      filtered_ = at_first;
      for (int i = 0; i < parts && usable(status_); ++i) {
        const Vec<nu, D> now = filters ? relax(input(held_), h / parts) : filtered_;
        part(now, value_of(now), h / parts);
      }
      return;
    }
    pending_ = before;
    follow(u, u0, r);
  }
  // A part of a step, finely where a kinked force changes within it: its derivative is all in the moment of the change.
  void part(const Vec<nu, D>& u, const Input<M>& u0, double h) noexcept {
    constexpr int fine = 32;
    const Point<M> before = at_;
    const Passage r = advance_from(u0, h);
    if (!changes_between(before, at_)) {
      follow(u, u0, r);
      return;
    }
    at_ = before;
    for (int i = 0; i < fine && usable(status_); ++i) follow(u, u0, advance_from(u0, h / fine));
  }
  Passage advance_from(const Input<M>& u0, double h) noexcept {
    pending_ = at_;
    return advance(model_, at_, u0, h);
  }

  // Takes the derivatives along the passage just made from pending_ to at_, and the sensors' lag with them.
  void follow(const Vec<nu, D>& u, const Input<M>& u0, const Passage& r) noexcept {
    status_ = worse(status_, r.status);
    if (!usable(r.status)) return;
    events_ += r.events;
    if (!derivatives_) return;
    double done = 0.0;
    std::size_t event = 0;
    Reading from;
    if (lagging_) from = reading_at(pending_, moving_, u, u0);
    retrace<K>(model_, lifted_, moving_, u, r, [&](auto e, const auto& x, const auto& after) {
      if (!lagging_) return;
      using E = decltype(e);
      Point<M> p;
      Point<LM> q;
      p.set(typename E::from{}, value_of(x));
      q.set(typename E::from{}, x);
      const double t = r.event[event++].at;
      smooth(from, reading_at(p, q, u, u0), t - done);
      done = t;
      p.set(typename E::to{}, value_of(after));
      q.set(typename E::to{}, after);
      from = reading_at(p, q, u, u0);
    });
    for (int i = 0; i < max_dim<M>; ++i) moving_.x[i].value = at_.x[i];
    if (lagging_) smooth(from, reading_at(at_, moving_, u, u0), r.elapsed - done);
  }

  // [s] The longest step that the chart a point is in allows.
  double longest_step(const Point<M>& p) const noexcept {
    double h = std::numeric_limits<double>::infinity();
    visit_chart(p, [&](auto c) {
      if constexpr (requires { model_.longest_step(c); }) h = model_.longest_step(c);
    });
    return h;
  }

  // [1/s] The stiffest kinked force whose kink a step's stages may have met, or that holds its port still; 0: none.
  double stiffness_between(const Point<M>& from, const Point<M>& to, double h) const noexcept {
    std::array<double, 16> rate{};
    std::size_t n = 0, k = 0;
    double stiffest = 0.0;
    visit_chart(from, [&](auto c) {
      model_.visit_stiffness(c, from.in(c), [&](double r, double here, double most) {
        if (n < rate.size()) rate[n++] = r;
        if (here * h > 0.5) stiffest = std::max(stiffest, most);
      });
    });
    visit_chart(to, [&](auto c) {
      model_.visit_stiffness(c, to.in(c), [&](double r, double here, double most) {
        const double before = k < n ? rate[k++] : 0.0;
        const bool met = std::min(std::abs(r), std::abs(before)) < 3.0 * std::abs(r - before);
        if (met || here * h > 0.5) stiffest = std::max(stiffest, most);
      });
    });
    return stiffest;
  }

  // True where a kinked force that is there changes between two points, or is about to.
  bool changes_between(const Point<M>& from, const Point<M>& to) const noexcept {
    if (from.chart != to.chart) return false;
    std::array<double, 16> rate{}, slope{};
    std::size_t n = 0, k = 0;
    bool changes = false;
    visit_chart(from, [&](auto c) {
      model_.visit_stiffness(c, from.in(c), [&](double r, double here, double) {
        if (n == rate.size()) return;
        rate[n] = r;
        slope[n++] = here;
      });
      model_.visit_stiffness(c, to.in(c), [&](double r, double here, double most) {
        if (k == n) return;
        const double before = rate[k], steepest = std::max(here, slope[k++]);
        const bool met = r * before <= 0.0 || std::min(std::abs(r), std::abs(before)) < 0.25 * std::abs(r - before);
        changes = changes || (met && steepest < 0.9 * most);  // else the points lie within the change: it is seen
      });
    });
    return changes;
  }

  // The signs of the rates at which kinked forces jump, one bit each.
  std::uint64_t kink_signs(const Point<M>& p) const noexcept {
    std::uint64_t bits = 0;
    visit_chart(p, [&](auto c) {
      std::uint64_t bit = 1;
      model_.visit_kinks(c, p.in(c), [&](double rate) {
        if (rate > 0.0) bits |= bit;
        bit <<= 1;
      });
    });
    return bits;
  }

  struct Reading {
    Sample y;     // the outputs
    Sample rate;  // [1/s] along the flow, exact where the outputs are linear in the state
  };
  Reading reading() const noexcept { return reading_at(at_, moving_, filtered_, value_of(filtered_)); }
  Reading reading_at(const Point<M>& p, const Point<LM>& q, const Vec<nu, D>& u, const Input<M>& u0) const noexcept {
    Reading r;
    visit_chart(p, [&](auto c) {
      constexpr int n = decltype(c)::dim;
      r.y = lifted_.output(c, q.in(c), u);
      const Vec<n, D> f = lifted_.flow(c, q.in(c), u);
      const Mat<ny, n> slope =
          gradient_of(lift<Dual<n>>(model_.model).output(c, variables<n, n>(p.in(c), 0), constants<nu, n>(u0)));
      for (int i = 0; i < ny; ++i) {
        r.rate[i] = D(0.0);
        for (int j = 0; j < n; ++j) {
          if (slope(i, j) != 0.0) r.rate[i] += f[j] * slope(i, j);
        }
      }
    });
    return r;
  }

  // The lag of a cubic: its particular solution y - l y' + l^2 y'' - l^3 y''', and what is left of the deviation.
  // `settled`: nothing is left.
  void smooth(const Reading& a, const Reading& b, double d, bool settled = false) noexcept {
    if (!(d > 1e-9)) return;
    const D& lag = wires_.sensor_lag;
    const D left = exp(-d / lag);
    for (int i = 0; i < ny; ++i) {
      const D chord = (b.y[i] - a.y[i]) / d;
      const D bend_a = (6.0 * chord - 4.0 * a.rate[i] - 2.0 * b.rate[i]) / d;
      const D bend_b = (2.0 * a.rate[i] + 4.0 * b.rate[i] - 6.0 * chord) / d;
      const D third = lag * lag * lag * ((6.0 * (a.rate[i] + b.rate[i]) - 12.0 * chord) / (d * d));
      const D settled_a = a.y[i] - lag * a.rate[i] + lag * lag * bend_a - third;
      const D settled_b = b.y[i] - lag * b.rate[i] + lag * lag * bend_b - third;
      smoothed_[i] = settled ? settled_b : settled_b + (smoothed_[i] - settled_a) * left;
    }
  }

  Sample through_sensors(Sample y) const noexcept {
    for (int i = 0; i < ny; ++i) {
      const auto c = static_cast<std::size_t>(i);
      y[i] = y[i] + y[i] * wires_.sensor_gain[c] + wires_.sensor_bias[c];
    }
    return y;
  }
  // dy = -y' d(delay), and the same for a lag that is zero.
  void shift(Sample& y, const Sample& rate) const noexcept {
    for (int i = 0; i < ny; ++i) {
      for (std::size_t k = 0; k < static_cast<std::size_t>(K); ++k) {
        double g = wires_.sensor_delay.gradient[k];
        if (!lagging_) g += wires_.sensor_lag.gradient[k];
        y[i].gradient[k] -= rate[i].value * g;
      }
    }
  }
  Sample measured() noexcept {
    if (!derivatives_) {
      const Vec<ny> y = output_at(model_, at_, value_of(filtered_));
      return through_sensors(constants<ny, K>(y));
    }
    if (!sensor_moves_) return through_sensors(output_at(lifted_, moving_, filtered_));
    const Reading r = reading();
    if (!lagging_) {
      Sample y = r.y;
      shift(y, r.rate);
      return through_sensors(y);
    }
    Sample y = smoothed_;
    for (int i = 0; i < ny; ++i) {  // the filtered output moves at (y - filtered) / lag
      const double rate = (r.y[i].value - smoothed_[i].value) / wires_.sensor_lag.value;
      for (std::size_t k = 0; k < static_cast<std::size_t>(K); ++k) {
        y[i].gradient[k] -= rate * wires_.sensor_delay.gradient[k];
      }
    }
    return through_sensors(y);
  }
  // The input that acted until now.
  Vec<nu, D> acted() const noexcept {
    return held_ > 0 && !(wires_.input_lag.value > 0.0) && !(boundary(held_) < now_) ? input(held_ - 1) : filtered_;
  }
  // A sample from before the start.
  Sample measured_before(double back) noexcept {
    return seen_before(back, [&] { return measured(); });
  }
  // What `look` sees `back` seconds (not positive) from the start, under the input that acted until then: the flow run
  // backwards, no events.
  template <class Look>
  auto seen_before(double back, Look&& look) noexcept {
    const Point<M> keep = at_;
    const Point<LM> keep_moving = moving_;
    const Vec<nu, D> acts = filtered_;
    filtered_ = acted();
    visit_chart(keep, [&](auto c) {
      constexpr int n = decltype(c)::dim;
      const auto f = [&](const Vec<n, D>& x) noexcept -> Vec<n, D> { return lifted_.flow(c, x, filtered_); };
      const Vec<n, D> x = moving_.in(c);
      moving_.set(c, rk4<n, D>(f, x, f(x), back));
      at_.set(c, value_of(moving_.in(c)));
    });
    const auto seen = look();
    at_ = keep;
    moving_ = keep_moving;
    filtered_ = acts;
    return seen;
  }

  M model_{};
  LM lifted_{};
  Wires<M, D> wires_{};
  bool derivatives_ = true;
  bool sensor_moves_ = false, delay_moves_ = false, lag_moves_ = false, lagging_ = false;

  Course course_{};
  Status status_ = Status::ok;
  double now_ = 0.0;      // [s]
  std::size_t held_ = 0;  // the input that acts
  Point<M> at_{}, pending_{};
  Point<LM> moving_{};
  Vec<nu, D> filtered_;
  Sample smoothed_;
  std::int64_t events_ = 0, pieces_ = 0, parts_ = 0;
};

}  // namespace saltus
