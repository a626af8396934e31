#include "fit.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <limits>

#include "runs.hpp"
#include "side_by_side.hpp"

namespace saltus::diagnosis {
namespace {

struct Arrow {             // normal equations of one segment, its start apart
  Eigen::MatrixXd ss, sg;  // (starts x starts), (starts x free)
  Eigen::VectorXd s;       // (starts)
  Eigen::MatrixXd J;       // (rows x starts + free) whitened sensitivities
};

struct Normal {
  std::vector<Arrow> arrows;
  Eigen::MatrixXd gg;
  Eigen::VectorXd g;
  bool ok = true;
  Status status = Status::ok;
};

// Whitened residuals of the segments at a fit, and what they sum to.
struct Cost {
  std::vector<Eigen::VectorXd> r;  // (segments)(rows)
  double chi2 = 0.0, start_penalty = 0.0;
  bool ok = true;
  Status status = Status::ok;

  double total(const Fit& f) const {
    return ok ? chi2 + start_penalty + f.penalty : std::numeric_limits<double>::infinity();
  }
};

double start_penalty(const Problem& p, const Segment& s, const Start& start) {
  double sum = 0.0;
  const auto coordinates = p.machine->free_coordinates(start.chart);
  for (std::size_t k = 0; k < coordinates.size() && s.guess.chart == start.chart; ++k) {
    const auto c = static_cast<std::size_t>(coordinates[k]);
    const double off = (start.x[c] - s.guess.x[c]) / s.spread_of(k);
    sum += off * off;
  }
  return sum;
}

Cost cost_of(const Problem& p, const std::vector<int>& segments, const Fit& f) {
  Cost c;
  c.r.resize(segments.size());
  std::vector<Status> status(segments.size(), Status::ok);
  side_by_side(segments.size(), [&](std::size_t j) {
    const auto index = static_cast<std::size_t>(segments[j]);
    const Segment& s = p.data->segments[index];
    const Response y = respond(p, s, f.values, f.start[index]);
    status[j] = y.status;
    if (!usable(y.status)) return;
    c.r[j] = weights(*p.data, s).cwiseProduct(s.y - Eigen::Map<const Eigen::VectorXd>(y.y.data(), s.y.size()));
  });
  for (std::size_t j = 0; j < segments.size(); ++j) {
    const auto index = static_cast<std::size_t>(segments[j]);
    c.status = worse(c.status, status[j]);
    if (!usable(status[j])) {
      c.ok = false;
      return c;
    }
    c.chi2 += c.r[j].squaredNorm();
    c.start_penalty += start_penalty(p, p.data->segments[index], f.start[index]);
  }
  c.ok = std::isfinite(c.chi2);
  return c;
}

// The right-hand sides for these residuals, with the sensitivities that are there.
void renew_gradient(const Problem& p, const std::vector<int>& segments, const Fit& f, const Cost& cost, Normal& n) {
  const Eigen::Index n_start = p.machine->starts();
  n.g.setZero();
  for (std::size_t j = 0; j < segments.size(); ++j) {
    Arrow& a = n.arrows[j];
    const Segment& s = p.data->segments[static_cast<std::size_t>(segments[j])];
    const Start& start = f.start[static_cast<std::size_t>(segments[j])];
    const Eigen::VectorXd g = a.J.transpose() * cost.r[j];
    a.s = g.head(n_start);
    n.g += g.tail(n.g.size());
    const auto coordinates = p.machine->free_coordinates(start.chart);
    for (std::size_t k = 0; k < coordinates.size() && s.guess.chart == start.chart; ++k) {
      const double spread = s.spread_of(k);
      const auto c = static_cast<std::size_t>(coordinates[k]);
      a.s[static_cast<Eigen::Index>(k)] -= (start.x[c] - s.guess.x[c]) / (spread * spread);
    }
  }
}

// Sensitivities at a fit whose residuals are known.
Normal normal_equations(const Problem& p, const std::vector<int>& segments, const Fit& f, const Cost& cost) {
  const Data& data = *p.data;
  const auto n_free = static_cast<Eigen::Index>(f.free.size());
  const Eigen::Index n_start = p.machine->starts();
  Normal n;
  n.gg = Eigen::MatrixXd::Zero(n_free, n_free);
  n.g = Eigen::VectorXd::Zero(n_free);
  n.arrows.resize(segments.size());
  std::vector<Status> status(segments.size(), Status::ok);
  side_by_side(segments.size(), [&](std::size_t j) {
    const auto index = static_cast<std::size_t>(segments[j]);
    const Segment& s = data.segments[index];
    const Eigen::VectorXd w = weights(data, s);
    Arrow& a = n.arrows[j];
    a.J.resize(s.y.size(), n_start + n_free);
    const int at_once = p.machine->directions();
    for (Eigen::Index from = 0; from == 0 || from < n_free; from += at_once) {
      const Eigen::Index count = std::min<Eigen::Index>(at_once, n_free - from);
      const std::span<const int> wanted(f.free.data() + from, static_cast<std::size_t>(count));
      const Response y = sensitivities(p, s, f.values, f.start[index], wanted);
      status[j] = worse(status[j], y.status);
      if (!usable(y.status)) return;
      const Eigen::Map<const RowMajor> all(y.gradient.data(), s.y.size(), p.machine->width());
      if (from == 0) a.J.leftCols(n_start) = w.asDiagonal() * all.leftCols(n_start);
      a.J.middleCols(n_start + from, count) = w.asDiagonal() * all.middleCols(n_start, count);
    }
    if (!a.J.allFinite()) status[j] = Status::diverged;
  });
  for (std::size_t j = 0; j < segments.size(); ++j) {
    n.status = worse(n.status, status[j]);
    if (!usable(status[j])) {
      n.ok = false;
      return n;
    }
    Arrow& a = n.arrows[j];
    const Segment& s = data.segments[static_cast<std::size_t>(segments[j])];
    Eigen::MatrixXd full = Eigen::MatrixXd::Zero(n_start + n_free, n_start + n_free);
    full.selfadjointView<Eigen::Lower>().rankUpdate(a.J.transpose());
    full.triangularView<Eigen::StrictlyUpper>() = full.transpose();
    a.ss = full.topLeftCorner(n_start, n_start);
    a.sg = full.topRightCorner(n_start, n_free);
    n.gg += full.bottomRightCorner(n_free, n_free);
    const auto coordinates = p.machine->free_coordinates(f.start[static_cast<std::size_t>(segments[j])].chart);
    for (Eigen::Index i = 0; i < n_start; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const double spread = s.spread_of(k);
      a.ss(i, i) += k < coordinates.size() ? 1.0 / (spread * spread) : 1.0;  // 1: a direction this chart does not have
    }
  }
  renew_gradient(p, segments, f, cost, n);
  return n;
}

double prior_of(const Problem& p, int coefficient) {
  const auto k = static_cast<std::size_t>(coefficient);
  return k < p.tolerance.size() && p.tolerance[k] > 0.0 ? 1.0 / (p.tolerance[k] * p.tolerance[k]) : 0.0;
}

double penalty_of(const Problem& p, const std::vector<double>& values) {
  double sum = 0.0;
  for (std::size_t k = 0; k < p.tolerance.size(); ++k) {
    const double off = values[k] - p.machine->coefficients[k].nominal;
    sum += off * off * prior_of(p, static_cast<int>(k));
  }
  return sum;
}

// Starts eliminated: the information on the free coefficients and their gradient.
void reduce(const Normal& n, double damping, Eigen::MatrixXd& h, Eigen::VectorXd& g, std::vector<Eigen::MatrixXd>& back,
            std::vector<Eigen::VectorXd>& back_r) {
  h = n.gg;
  g = n.g;
  back.clear();
  back_r.clear();
  for (const Arrow& a : n.arrows) {
    Eigen::MatrixXd ss = a.ss;
    ss.diagonal() *= 1.0 + damping;
    const Eigen::LDLT<Eigen::MatrixXd> solver(ss);
    back.push_back(a.sg.cols() > 0 ? Eigen::MatrixXd(solver.solve(a.sg)) : a.sg);
    back_r.push_back(solver.solve(a.s));
    h -= a.sg.transpose() * back.back();
    g -= a.sg.transpose() * back_r.back();
  }
}

}  // namespace

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
  for (const Eigen::VectorXd& r : cost_of(p, segments, f).r) {
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
  Fit f = from;
  f.free.clear();
  if (options.refit_parameters) {
    for (std::size_t k = 0; k < p.tolerance.size(); ++k) {
      if (p.tolerance[k] > 0.0) f.free.push_back(static_cast<int>(k));
    }
  }
  for (const int e : effects) {
    if (std::find(f.free.begin(), f.free.end(), e) == f.free.end()) f.free.push_back(e);
    const auto k = static_cast<std::size_t>(e);
    f.values[k] = std::max(f.values[k], lower_bound(p.machine->coefficients[k]));
  }
  const auto n_free = static_cast<Eigen::Index>(f.free.size());
  Cost now = cost_of(p, segments, f);
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
  Eigen::MatrixXd h;
  Eigen::VectorXd g;
  std::vector<Eigen::MatrixXd> back;
  std::vector<Eigen::VectorXd> back_r;
  const auto add_priors = [&](Eigen::MatrixXd& info, Eigen::VectorXd* gradient) {
    for (Eigen::Index i = 0; i < n_free; ++i) {
      const int k = f.free[static_cast<std::size_t>(i)];
      const double prior = prior_of(p, k);
      info(i, i) += prior;
      if (gradient != nullptr) {
        const auto c = static_cast<std::size_t>(k);
        (*gradient)[i] -= prior * (f.values[c] - p.machine->coefficients[c].nominal);
      }
    }
  };
  int fails = 0;
  double last_fell = 0.0;
  while (f.iterations < options.iterations) {
    ++f.iterations;
    reduce(n, damping, h, g, back, back_r);
    add_priors(h, &g);
    // Coefficients that sit on their bound and would leave it do not move.
    std::vector<bool> held(f.free.size(), false);
    Eigen::VectorXd step = Eigen::VectorXd::Zero(n_free);
    for (int round = 0; round < 3; ++round) {
      Eigen::MatrixXd a = h;
      Eigen::VectorXd b = g;
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
      if (n_free > 0) step = d.asDiagonal() * Eigen::LDLT<Eigen::MatrixXd>(scaled).solve(d.asDiagonal() * b);
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
    Fit next = f;
    for (Eigen::Index i = 0; i < n_free; ++i) {
      const auto c = static_cast<std::size_t>(f.free[static_cast<std::size_t>(i)]);
      const Coefficient& k = p.machine->coefficients[c];
      const double low = lower_bound(k);
      double v = f.values[c] + step[i];
      if (k.probe > 0.0 && f.values[c] > 0.0)
        v = std::max(0.01 * k.probe, std::clamp(v, f.values[c] / 4.0, f.values[c] * 4.0));
      if (v < low) v = f.values[c] > low ? std::max(low, k.shifts_time ? low : 0.1 * f.values[c]) : low;
      if (k.shifts_time && p.data->sections > 0) v = std::min(v, 0.25 * p.machine->cycle_period);
      step[i] = v - f.values[c];
      next.values[c] = v;
    }
    for (std::size_t j = 0; j < segments.size(); ++j) {
      Start& start = next.start[static_cast<std::size_t>(segments[j])];
      const Eigen::VectorXd move = back_r[j] - back[j] * step;
      const auto coordinates = p.machine->free_coordinates(start.chart);
      for (std::size_t i = 0; i < coordinates.size(); ++i) {
        start.x[static_cast<std::size_t>(coordinates[i])] += move[static_cast<Eigen::Index>(i)];
      }
    }
    Cost trial = cost_of(p, segments, next);
    next.penalty = penalty_of(p, next.values);
    const double next_cost = trial.total(next);
    const double fell = cost - next_cost;
    if (fell > 0.0) {
      // What a linear problem would have fallen by, with all starts moved along.
      double foreseen = step.dot(g);
      for (std::size_t j = 0; j < segments.size(); ++j) foreseen += back_r[j].dot(n.arrows[j].s);
      f = std::move(next);
      f.chi2 = trial.chi2;
      f.status = trial.status;
      cost = next_cost;
      now = std::move(trial);
      damping = damping < 1e-3 ? 0.0 : damping / 8.0;
      fails = 0;
      last_fell = fell;
      if (fell < options.enough && (fresh || options.brief)) {
        f.converged = true;
        break;
      }
      // Nearly linear: the same sensitivities serve again, at a fraction of the cost.
      fresh = !(damping == 0.0 && fell >= options.enough && std::abs(fell - foreseen) < 0.2 * foreseen);
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
    if (fresh) {
      Normal next_n = normal_equations(p, segments, f, now);
      if (!next_n.ok) break;
      n = std::move(next_n);
    } else {
      renew_gradient(p, segments, f, now, n);
    }
  }
  reduce(n, 0.0, h, g, back, back_r);
  add_priors(h, nullptr);
  const Eigen::VectorXd d = h.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd scaled = d.asDiagonal() * h * d.asDiagonal();
  scaled.diagonal().array() += 1e-13;
  if (n_free == 0) {
    f.covariance.resize(0, 0);
    return f;
  }
  f.covariance = d.asDiagonal() * Eigen::LDLT<Eigen::MatrixXd>(scaled).solve(Eigen::MatrixXd(d.asDiagonal()));
  return f;
}

}  // namespace saltus::diagnosis
