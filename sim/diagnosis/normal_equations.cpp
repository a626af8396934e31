#include "normal_equations.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <span>

#include "runs.hpp"
#include "side_by_side.hpp"

namespace saltus::diagnosis {
namespace {

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

}  // namespace

Cost cost_at(const Problem& p, const std::vector<int>& segments, const Fit& f) {
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
  return k < p.tolerance.size() && p.tolerance[k] > 0.0 ? p.widened / (p.tolerance[k] * p.tolerance[k]) : 0.0;
}

double penalty_of(const Problem& p, const std::vector<double>& values) {
  double sum = 0.0;
  for (std::size_t k = 0; k < p.tolerance.size(); ++k) {
    const double off = values[k] - p.machine->coefficients[k].nominal;
    sum += off * off * prior_of(p, static_cast<int>(k));
  }
  return sum;
}

Reduced reduce(const Problem& p, const Fit& f, const Normal& n, double damping) {
  Reduced r{n.gg, n.g, {}, {}};
  for (const Arrow& a : n.arrows) {
    Eigen::MatrixXd ss = a.ss;
    ss.diagonal() *= 1.0 + damping;
    const Eigen::LDLT<Eigen::MatrixXd> solver(ss);
    r.back.push_back(a.sg.cols() > 0 ? Eigen::MatrixXd(solver.solve(a.sg)) : a.sg);
    r.back_r.push_back(solver.solve(a.s));
    r.h -= a.sg.transpose() * r.back.back();
    r.g -= a.sg.transpose() * r.back_r.back();
  }
  for (Eigen::Index i = 0; i < r.g.size(); ++i) {
    const int k = f.free[static_cast<std::size_t>(i)];
    const auto c = static_cast<std::size_t>(k);
    r.h(i, i) += prior_of(p, k);
    r.g[i] -= prior_of(p, k) * (f.values[c] - p.machine->coefficients[c].nominal);
  }
  return r;
}

}  // namespace saltus::diagnosis
