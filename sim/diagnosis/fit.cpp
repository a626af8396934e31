#include "fit.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <limits>

#include "normal_equations.hpp"

namespace saltus::diagnosis {
namespace {

std::vector<int> free_ones(const Problem& p, const std::vector<int>& effects, bool parameters) {
  std::vector<int> free;
  for (std::size_t k = 0; k < p.tolerance.size() && parameters; ++k) {
    if (p.tolerance[k] > 0.0) free.push_back(static_cast<int>(k));
  }
  for (const int e : effects) {
    if (std::find(free.begin(), free.end(), e) == free.end()) free.push_back(e);
  }
  return free;
}

// The step of the free coefficients. Those that sit on their bound and would leave it do not move.
Eigen::VectorXd step_of(const Problem& p, const Fit& f, const Reduced& r, double damping) {
  const Eigen::Index n_free = r.g.size();
  Eigen::VectorXd step = Eigen::VectorXd::Zero(n_free);
  std::vector<bool> held(f.free.size(), false);
  for (int round = 0; round < 3 && n_free > 0; ++round) {
    Eigen::MatrixXd a = r.h;
    Eigen::VectorXd b = r.g;
    for (Eigen::Index i = 0; i < n_free; ++i) {
      a(i, i) *= 1.0 + damping;
      if (held[static_cast<std::size_t>(i)] || !(a(i, i) > 0.0)) {
        a.row(i).setZero();
        a.col(i).setZero();
        a(i, i) = 1.0;
        b[i] = 0.0;
      }
    }
    // Scaled to a unit diagonal, for coefficients of any unit.
    const Eigen::VectorXd d = a.diagonal().cwiseSqrt().cwiseInverse();
    Eigen::MatrixXd scaled = d.asDiagonal() * a * d.asDiagonal();
    scaled.diagonal().array() += 1e-12;
    step = d.asDiagonal() * Eigen::LDLT<Eigen::MatrixXd>(scaled).solve(d.asDiagonal() * b);
    bool again = false;
    for (Eigen::Index i = 0; i < n_free; ++i) {
      const auto c = static_cast<std::size_t>(f.free[static_cast<std::size_t>(i)]);
      const double low = lower_bound(p.machine->coefficients[c]);
      if (!held[static_cast<std::size_t>(i)] && f.values[c] <= low && step[i] < 0.0) {
        held[static_cast<std::size_t>(i)] = again = true;
      }
    }
    if (!again) break;
  }
  return step;
}

// What a step may make of a coefficient.
double stepped(const Problem& p, const Coefficient& k, double from, double step) {
  const double low = lower_bound(k);
  double v = from + step;
  if (k.probe > 0.0 && from > 0.0) v = std::max(0.01 * k.probe, std::clamp(v, from / 4.0, from * 4.0));
  if (v < low) v = from > low ? std::max(low, k.shifts_time ? low : 0.1 * from) : low;
  if (k.shifts_time && p.data->sections > 0) v = std::min(v, 0.25 * p.machine->cycle_period);
  return v;
}

// A fit moved by a step; its starts move along.
Fit moved(const Problem& p, const std::vector<int>& segments, const Fit& f, const Reduced& r, Eigen::VectorXd& step) {
  Fit next = f;
  for (Eigen::Index i = 0; i < step.size(); ++i) {
    const auto c = static_cast<std::size_t>(f.free[static_cast<std::size_t>(i)]);
    next.values[c] = stepped(p, p.machine->coefficients[c], f.values[c], step[i]);
    step[i] = next.values[c] - f.values[c];
  }
  for (std::size_t j = 0; j < segments.size(); ++j) {
    Start& start = next.start[static_cast<std::size_t>(segments[j])];
    const Eigen::VectorXd move = r.back_r[j] - r.back[j] * step;
    const auto coordinates = p.machine->free_coordinates(start.chart);
    for (std::size_t i = 0; i < coordinates.size(); ++i) {
      start.x[static_cast<std::size_t>(coordinates[i])] += move[static_cast<Eigen::Index>(i)];
    }
  }
  return next;
}

struct Attempt {
  Fit next;
  Cost cost;
  double total = 0.0,
         foreseen = 0.0;  // [-] after it; what a linear problem would have fallen by
};
// A step as these residuals pull.
Attempt attempt(const Problem& p, const std::vector<int>& segments, const Fit& f, const Cost& pull, Normal& n,
                double damping) {
  renew_gradient(p, segments, f, pull, n);
  const Reduced r = reduce(p, f, n, damping);
  Eigen::VectorXd step = step_of(p, f, r, damping);
  Attempt a;
  a.next = moved(p, segments, f, r, step);
  a.cost = cost_at(p, segments, a.next);
  a.next.penalty = penalty_of(p, a.next.values);
  a.total = a.cost.total(a.next);
  a.foreseen = step.dot(r.g);  // with all starts moved along
  for (std::size_t j = 0; j < segments.size(); ++j) a.foreseen += r.back_r[j].dot(n.arrows[j].s);
  return a;
}

// Where a valley bends a straight step leaves it, and one short enough not to creeps. What a little of the way shows of
// the bend, taken to all of it, is added to the residuals, so that a step as they then pull follows it (Transtrum and
// Sethna's geodesic acceleration).
Cost with_bend(const Problem& p, const std::vector<int>& segments, const Fit& f, const Cost& now, const Normal& n,
               const Fit& ahead) {
  constexpr double little = 0.1;  // [-] of the way
  const Eigen::Index n_start = p.machine->starts();
  Eigen::VectorXd way(n_start + static_cast<Eigen::Index>(f.free.size()));
  std::vector<Eigen::VectorXd> straight;
  Fit near = f;
  for (std::size_t i = 0; i < f.free.size(); ++i) {
    const auto c = static_cast<std::size_t>(f.free[i]);
    way[n_start + static_cast<Eigen::Index>(i)] = little * (ahead.values[c] - f.values[c]);
    near.values[c] += little * (ahead.values[c] - f.values[c]);
  }
  for (std::size_t j = 0; j < segments.size(); ++j) {
    const auto index = static_cast<std::size_t>(segments[j]);
    const auto coordinates = p.machine->free_coordinates(f.start[index].chart);
    way.head(n_start).setZero();
    for (std::size_t i = 0; i < coordinates.size(); ++i) {
      const auto c = static_cast<std::size_t>(coordinates[i]);
      const double by = little * (ahead.start[index].x[c] - f.start[index].x[c]);
      way[static_cast<Eigen::Index>(i)] = by;
      near.start[index].x[c] += by;
    }
    straight.push_back(n.arrows[j].J * way);
  }
  Cost bent = cost_at(p, segments, near);
  for (std::size_t j = 0; j < segments.size() && bent.ok; ++j)
    bent.r[j] = now.r[j] + (bent.r[j] - now.r[j] + straight[j]) / (little * little);
  return bent;
}

// Of a machine that may change its charts the way between two gaits is no bend: a little of it says nothing of the
// rest, and follows a mass and a drag to where they imitate a soft ground.
bool may_bend(const Machine& machine) {
  return std::none_of(machine.coefficients.begin(), machine.coefficients.end(),
                      [](const Coefficient& c) { return c.changes_charts(); });
}

// The covariance of the free coefficients, starts eliminated.
Eigen::MatrixXd covariance_of(const Eigen::MatrixXd& h) {
  if (h.size() == 0) return h;
  const Eigen::VectorXd d = h.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd scaled = d.asDiagonal() * h * d.asDiagonal();
  scaled.diagonal().array() += 1e-13;
  return d.asDiagonal() * Eigen::LDLT<Eigen::MatrixXd>(scaled).solve(Eigen::MatrixXd(d.asDiagonal()));
}

}  // namespace

Fit with_fixed(Fit f, int coefficient) {
  f.free.erase(std::remove(f.free.begin(), f.free.end(), coefficient), f.free.end());
  return f;
}

double farthest_off(const Problem& p, const Fit& f) {
  double most = 0.0;
  for (std::size_t k = 0; k < p.tolerance.size(); ++k) {
    const double off = f.values[k] - p.machine->coefficients[k].nominal;
    if (p.tolerance[k] > 0.0) most = std::max(most, std::abs(off) / p.tolerance[k]);
  }
  return most;
}

std::vector<std::string> off_by_more(const Problem& p, const Fit& f, double far) {
  std::vector<std::string> names;
  for (std::size_t k = 0; k < p.tolerance.size(); ++k) {
    const Coefficient& c = p.machine->coefficients[k];
    if (p.tolerance[k] > 0.0 && std::abs(f.values[k] - c.nominal) > far * p.tolerance[k]) names.push_back(c.name);
  }
  return names;
}

bool sensible(const Machine& machine, const Fit& f) {
  const auto& all = machine.coefficients;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].physical_sum <= 0 || f.values[i] == all[i].nominal) continue;
    double sum = f.values[i];
    for (std::size_t k = 0; k < all.size(); ++k) {
      if (all[k].name == all[i].refines) sum += f.values[k];
    }
    if (sum < 0.0) return false;
  }
  return true;
}

std::vector<double> chi2_of_each(const Problem& p, const std::vector<int>& segments, const Fit& f) {
  std::vector<double> each;
  for (const Eigen::VectorXd& r : cost_at(p, segments, f).r) {
    each.push_back(r.size() > 0 ? r.squaredNorm() : std::numeric_limits<double>::infinity());
  }
  return each;
}

Fit drawn_values(const Problem& p, const Fit& f, Random& random) {
  Fit r = f;
  const Eigen::LLT<Eigen::MatrixXd> factor(f.covariance);
  if (f.free.empty() || factor.info() != Eigen::Success) return r;
  Eigen::VectorXd off(f.covariance.rows());
  for (double& x : off) x = random.normal();
  off = factor.matrixL() * off;
  for (std::size_t i = 0; i < f.free.size(); ++i) {
    const auto c = static_cast<std::size_t>(f.free[i]);
    r.values[c] = std::max(r.values[c] + off[static_cast<Eigen::Index>(i)], lower_bound(p.machine->coefficients[c]));
  }
  return r;
}

Fit declared_fit(const Problem& p) {
  Fit f;
  for (const Coefficient& c : p.machine->coefficients) f.values.push_back(c.nominal);
  for (const Segment& s : p.data->segments) f.start.push_back(s.guess);
  return f;
}

Fit fit(const Problem& p, const std::vector<int>& segments, const Fit& from, const std::vector<int>& effects,
        const FitOptions& options) {
  constexpr double straight = 0.5;  // [-] of what a linear problem falls by: below it the way bends
  Fit f = from;
  f.free = free_ones(p, effects, options.refit_parameters);
  for (const int e : effects) {
    const auto k = static_cast<std::size_t>(e);
    f.values[k] = std::max(f.values[k], lower_bound(p.machine->coefficients[k]));
  }
  const bool bends = may_bend(*p.machine);
  Cost now = cost_at(p, segments, f);
  f.status = now.status;
  f.converged = false;
  f.iterations = 0;
  f.chi2 = now.chi2;
  f.penalty = penalty_of(p, f.values);
  Normal n;
  if (now.ok) n = normal_equations(p, segments, f, now);
  if (!now.ok || !n.ok) {
    f.status = worse(f.status, n.status);
    f.chi2 = std::numeric_limits<double>::infinity();
    return f;
  }
  double cost = now.total(f);
  double damping = 0.0;
  bool fresh = true;  // the sensitivities are those of the present values
  int fails = 0;
  double last_fell = 0.0;
  double falls = std::numeric_limits<double>::infinity();  // at most, in one more iteration: the larger of the last two
  while (f.iterations < options.iterations) {
    if (cost - (options.iterations - f.iterations) * falls > options.to_beat) break;
    ++f.iterations;
    Attempt a = attempt(p, segments, f, now, n, damping);
    if (bends && fresh && a.foreseen > options.enough && !(cost - a.total > straight * a.foreseen)) {
      const Cost bent = with_bend(p, segments, f, now, n, a.next);
      Attempt along = bent.ok ? attempt(p, segments, f, bent, n, damping) : a;
      along.foreseen = a.foreseen;
      if (along.total < a.total) a = std::move(along);
    }
    const double fell = cost - a.total;
    if (fell > 0.0) {
      f = std::move(a.next);
      f.chi2 = a.cost.chi2;
      f.status = a.cost.status;
      cost = a.total;
      now = std::move(a.cost);
      damping = damping < 1e-3 ? 0.0 : damping / 8.0;
      fails = 0;
      falls = f.iterations < 2 ? falls : std::max(last_fell, fell);
      last_fell = fell;
      if (fell < options.enough && (fresh || options.brief)) {
        f.converged = true;
        break;
      }
      // Nearly linear: the same sensitivities serve again, at a fraction of the cost.
      fresh = !(damping == 0.0 && fell >= options.enough && std::abs(fell - a.foreseen) < 0.2 * a.foreseen);
    } else {
      if (fresh && (-fell < options.enough || ++fails > 6)) {
        f.converged = -fell < options.enough;
        break;
      }
      if (fresh) {
        damping = std::max(1e-3, damping * 10.0);
        continue;
      }
      if (options.brief && !(last_fell > 10.0 * options.enough)) {
        f.converged = true;
        break;
      }
      fresh = true;
    }
    if (!fresh) continue;
    Normal next_n = normal_equations(p, segments, f, now);
    if (!next_n.ok) break;
    n = std::move(next_n);
  }
  f.covariance = covariance_of(reduce(p, f, n, 0.0).h);
  return f;
}

}  // namespace saltus::diagnosis
