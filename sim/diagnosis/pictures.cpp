#include "pictures.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>

#include "core/spectrum/twiddles.hpp"

namespace saltus::diagnosis {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

Eigen::VectorXd predicted(const Problem& p, int index, const Fit& f) {
  const auto k = static_cast<std::size_t>(index);
  const Segment& s = p.data->segments[k];
  const Response y = p.machine->values_only(f.values, s.course(p.h_max), f.start[k]);
  return Eigen::Map<const Eigen::VectorXd>(y.y.data(), s.y.size());
}

Eigen::VectorXd cycle_mean(const Data& data, const Eigen::VectorXd& x) {
  const Eigen::Index width = data.sections * static_cast<Eigen::Index>(data.outputs());
  Eigen::VectorXd m = Eigen::VectorXd::Zero(width);
  const Eigen::Index cycles = x.size() / width;
  for (Eigen::Index c = 0; c < cycles; ++c) m += x.segment(c * width, width);
  return m / static_cast<double>(std::max<Eigen::Index>(1, cycles));
}

Complex line(const Eigen::VectorXd& x, Eigen::Index ny, Eigen::Index j, long k) {
  const long L = static_cast<long>(x.size() / ny);
  Complex sum{};
  for (long n = 0; n < L; ++n) sum += x[n * ny + j] * root_of_unity(-k * n, L);
  return sum / static_cast<double>(L);
}

}  // namespace

void locate(Diagnosis& d, const Problem& p, const std::vector<int>& segments, const Fit& refit, double limit_z) {
  const Machine& m = *p.machine;
  std::vector<int> knots;
  std::map<std::string, std::vector<int>> ports;
  for (std::size_t i = 0; i < m.coefficients.size(); ++i) {
    if (m.coefficients[i].profile_of.empty()) continue;
    knots.push_back(static_cast<int>(i));
    ports[m.coefficients[i].profile_of].push_back(static_cast<int>(i));
  }
  if (knots.empty()) return;
  const Signatures shape = signatures(p, segments, refit, knots);
  // What parameters could imitate is not shown: the tolerances are widened until only the data decide.
  const Evidence e = weigh(p, segments, refit, shape, 100.0), beside_tolerances = weigh(p, segments, refit, shape);
  const auto orbit = m.cycle(refit.values, 60, p.data->sections);
  for (const Start& s : orbit) d.charts.push_back(m.charts[static_cast<std::size_t>(s.chart)]);
  for (const auto& [port, list] : ports) {
    const auto n = static_cast<Eigen::Index>(list.size());
    Eigen::MatrixXd I(n, n);
    Eigen::VectorXd b(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto a = e.find(list[static_cast<std::size_t>(i)]);
      b[i] = e.score[a];
      for (Eigen::Index j = 0; j < n; ++j) I(i, j) = e.information(a, e.find(list[static_cast<std::size_t>(j)]));
    }
    // A force of unknown size at every knot: its variance by iteration (empirical Bayes), so that what the data do not
    // see stays at zero.
    double variance = 1.0;
    Eigen::VectorXd force = Eigen::VectorXd::Zero(n), spread = Eigen::VectorXd::Zero(n);
    const Eigen::VectorXd diagonal = I.diagonal().cwiseMax(1e-300);
    variance = std::max(1e-12, (b.cwiseAbs2().cwiseQuotient(diagonal.cwiseAbs2())).mean());
    for (int round = 0; round < 30; ++round) {
      Eigen::MatrixXd A = I;
      A.diagonal().array() += 1.0 / variance;
      const Eigen::LDLT<Eigen::MatrixXd> solver(A);
      force = solver.solve(b);
      spread = solver.solve(Eigen::MatrixXd::Identity(n, n)).diagonal();
      const double next = (force.squaredNorm() + spread.sum()) / static_cast<double>(n);
      if (std::abs(next / variance - 1.0) < 1e-3) break;
      variance = std::max(1e-14, next);
    }
    Profile q;
    q.port = port;
    q.unit = m.coefficients[static_cast<std::size_t>(list.front())].unit;
    q.explained = 2.0 * b.dot(force) - force.dot(I * force);
    for (Eigen::Index i = 0; i < n; ++i) {
      const int knot = list[static_cast<std::size_t>(i)];
      const auto a = beside_tolerances.find(knot);
      q.knots.push_back(m.coefficients[static_cast<std::size_t>(knot)].name);
      q.phase.push_back(static_cast<double>(i) / static_cast<double>(n));
      q.force.push_back(force[i]);
      q.error.push_back(std::sqrt(std::max(0.0, spread[i])));
      q.limit.push_back(beside_tolerances.usable(a) ? limit_z * beside_tolerances.error[a] : nan);
    }
    d.profiles.push_back(std::move(q));
  }
  std::sort(d.profiles.begin(), d.profiles.end(),
            [](const Profile& a, const Profile& b) { return a.explained > b.explained; });
  if (d.profiles.empty() || d.verdict == Verdict::no_discrepancy || d.verdict == Verdict::parameters_only) return;
  // The longest run of knots around the largest force that all have its sign and stand out.
  const Profile& q = d.profiles.front();
  const std::size_t n = q.force.size();
  std::size_t peak = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (std::abs(q.force[i]) * q.error[peak] > std::abs(q.force[peak]) * q.error[i]) peak = i;
  }
  const auto stands = [&](std::size_t i) {
    return q.force[i] * q.force[peak] > 0.0 && std::abs(q.force[i]) > 3.0 * q.error[i] &&
           std::abs(q.force[i]) > 0.3 * std::abs(q.force[peak]);
  };
  std::size_t left = peak, right = peak;
  while ((left + n - 1) % n != right && stands((left + n - 1) % n)) left = (left + n - 1) % n;
  while ((right + 1) % n != left && stands((right + 1) % n)) right = (right + 1) % n;
  d.where.known = std::abs(q.force[peak]) > 3.0 * q.error[peak];
  d.where.port = q.port;
  d.where.from = std::fmod(q.phase[left] + 1.0 - 0.5 / static_cast<double>(n), 1.0);
  d.where.to = std::fmod(q.phase[right] + 0.5 / static_cast<double>(n), 1.0);
  if (!d.charts.empty())
    d.where.chart = d.charts[static_cast<std::size_t>(q.phase[peak] * static_cast<double>(d.charts.size()))];
}

void draw(Diagnosis& d, const Problem& p, const std::vector<int>& segments, const Fit& declared, const Fit& refit,
          const Fit& after) {
  const Data& data = *p.data;
  if (data.sections == 0) return;
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  const Eigen::Index width = data.sections * ny;
  const Fit* const fits[3] = {&declared, &refit, &after};
  std::vector<Eigen::VectorXd> model[3];
  for (int k = 0; k < 3; ++k) {
    for (const int s : segments) model[k].push_back(predicted(p, s, *fits[k]));
  }
  d.mean_cycle.assign(data.outputs(), {});
  for (int k = 0; k < 3; ++k) {
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(width), n = Eigen::VectorXd::Zero(width);
    for (std::size_t j = 0; j < segments.size(); ++j) {
      const Segment& s = data.segments[static_cast<std::size_t>(segments[j])];
      for (Eigen::Index i = 0; i < s.y.size(); ++i) {
        sum[i % width] += s.count[i] * (s.y[i] - model[k][j][i]);
        n[i % width] += s.count[i];
      }
    }
    for (Eigen::Index i = 0; i < width; ++i) {
      MeanCycle& c = d.mean_cycle[static_cast<std::size_t>(i % ny)];
      (k == 0   ? c.before
       : k == 1 ? c.refit
                : c.after)
          .push_back(sum[i] / std::sqrt(std::max(1.0, n[i])) / data.noise[i % ny]);
    }
  }
  if (data.period_cycles < 2 || data.repeats < 2 || p.machine->inputs.empty()) return;
  // The mean cycle without stimulus is the reference of every response; where there is none, its own cycle mean.
  std::vector<Eigen::VectorXd> rest(4, Eigen::VectorXd::Zero(width));
  double quiet = 0.0;
  for (std::size_t j = 0; j < segments.size(); ++j) {
    const Segment& s = data.segments[static_cast<std::size_t>(segments[j])];
    if (!s.lines.empty()) continue;
    rest[0] += cycle_mean(data, s.y);
    for (int k = 0; k < 3; ++k) rest[static_cast<std::size_t>(k) + 1] += cycle_mean(data, model[k][j]);
    quiet += 1.0;
  }
  for (std::size_t j = 0; j < segments.size(); ++j) {
    const Segment& s = data.segments[static_cast<std::size_t>(segments[j])];
    if (s.lines.empty()) continue;
    const auto L = static_cast<long>(s.y.size() / ny);
    const auto nu = static_cast<Eigen::Index>(p.machine->inputs.size());
    Eigen::VectorXd u(L * nu);
    for (Eigen::Index i = 0; i < u.size(); ++i)
      u[i] = s.u[s.first * static_cast<std::size_t>(nu) + static_cast<std::size_t>(i)];
    Eigen::VectorXd series[4] = {s.y, model[0][j], model[1][j], model[2][j]};
    for (int k = 0; k < 4; ++k) {
      const Eigen::VectorXd base =
          quiet > 0.0 ? Eigen::VectorXd(rest[static_cast<std::size_t>(k)] / quiet) : cycle_mean(data, series[k]);
      for (Eigen::Index i = 0; i < series[k].size(); ++i) series[k][i] -= base[i % width];
    }
    for (Eigen::Index i = 0; i < s.y.size(); ++i) {
      if (!(s.count[i] > 0.0)) series[0][i] = series[3][i];
    }
    for (const int q : s.lines) {
      const Complex U = line(u, nu, 0, q);
      for (Eigen::Index o = 0; o < ny; ++o) {
        for (int m = -1; m <= 1; ++m) {
          const long k = q + static_cast<long>(m) * data.period_cycles;
          Response1 r;
          r.m = m;
          r.f = static_cast<double>(q) / data.period_cycles;
          r.output = static_cast<std::size_t>(o);
          double* const into[3] = {r.measured, r.refit, r.after};
          const int which[3] = {0, 2, 3};
          for (int w = 0; w < 3; ++w) {
            const Complex h = line(series[which[w]], ny, o, k) / U;
            into[w][0] = h.real();
            into[w][1] = h.imag();
          }
          r.sigma = data.noise[o] / std::sqrt(static_cast<double>(L * data.repeats)) / std::abs(U);
          d.responses.push_back(r);
        }
      }
    }
  }
}

std::string separating_experiment(const Diagnosis&, const Problem& p, const std::vector<int>& segments,
                                  const Search& search, const Trial& chosen) {
  const Trial* rival = nullptr;
  for (const auto& [set, t] : search.pool()) {
    if (set == chosen.effects || std::includes(set.begin(), set.end(), chosen.effects.begin(), chosen.effects.end()))
      continue;
    if (rival == nullptr || t.bic < rival->bic) rival = &t;
  }
  const Data& data = *p.data;
  if (rival == nullptr || data.sections == 0) return "";
  // How differently the two predict what was recorded, line by line.
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  double total = 0.0, best = 0.0, best_f = 0.0, quiet = 0.0;
  for (const int index : segments) {
    const Segment& s = data.segments[static_cast<std::size_t>(index)];
    Eigen::VectorXd diff = predicted(p, index, chosen.fit) - predicted(p, index, rival->fit);
    for (Eigen::Index i = 0; i < diff.size(); ++i) diff[i] *= std::sqrt(s.count[i]) / data.noise[i % ny];
    total += diff.squaredNorm();
    if (s.lines.empty()) {
      quiet += diff.squaredNorm();
      continue;
    }
    for (const int q : s.lines) {
      double power = 0.0;
      const auto nu = static_cast<Eigen::Index>(p.machine->inputs.size());
      Eigen::VectorXd u(diff.size() / ny * nu);
      for (Eigen::Index i = 0; i < u.size(); ++i)
        u[i] = s.u[s.first * static_cast<std::size_t>(nu) + static_cast<std::size_t>(i)];
      for (Eigen::Index o = 0; o < ny; ++o) {
        for (int m = -1; m <= 1; ++m)
          power += std::norm(line(diff, ny, o, q + static_cast<long>(m) * data.period_cycles));
      }
      power /= std::max(1e-300, std::norm(line(u, nu, 0, q)));
      if (power > best) {
        best = power;
        best_f = static_cast<double>(q) / data.period_cycles;
      }
    }
  }
  const std::string names = together(names_of(*p.machine, rival->effects));
  char text[400];
  constexpr double alike = 1e-4;  // [-] of squares: no experiment of this kind is ever so long
  if (total < alike) return "No longer experiment of this kind tells it from " + names + ": both do the same in it.";
  const double factor = std::sqrt(25.0 / total);
  if (quiet > 0.5 * total || best_f == 0.0) {
    std::snprintf(
        text, sizeof text,
        "To tell it from %s: about %.0f times as many repeats of the undisturbed cycle, or sections placed closer.",
        names.c_str(), std::max(2.0, std::ceil(factor * factor)));
  } else {
    std::snprintf(
        text, sizeof text,
        "To tell it from %s: put the stimulus near %.2f cycles per cycle, with %.1f times the amplitude or %.0f "
        "times as many repeats (the two now differ by %.1f standard deviations).",
        names.c_str(), best_f, std::max(1.2, factor), std::max(2.0, std::ceil(factor * factor)), std::sqrt(total));
  }
  return text;
}

}  // namespace saltus::diagnosis
