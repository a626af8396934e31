#include "line_equations.hpp"

#include <Eigen/SVD>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <tuple>

#include "core/spectrum/lines.hpp"
#include "core/spectrum/twiddles.hpp"
#include "identification.hpp"

namespace saltus {
namespace {

using Eigen::MatrixXcd;
using Eigen::VectorXcd;
using Eigen::VectorXd;
using Index = Eigen::Index;

// Phases that differ by less [rad], or inputs by less of their size, tell nothing apart.
constexpr double distinct = 1e-3;

// Unknowns by least squares; sigma is infinite where the equations leave one free.
struct Solution {
  VectorXcd x;
  VectorXd sigma;          // for a noise of 1 in each row
  double condition = 1.0;  // [-] columns scaled, of what the equations determine
};

Solution least_squares(const MatrixXcd& a, const VectorXcd& y) {
  const VectorXd size = a.colwise().norm().transpose();
  const MatrixXcd scaled = a * size.cwiseInverse().asDiagonal();
  const Eigen::JacobiSVD<MatrixXcd> svd(scaled, Eigen::ComputeThinU | Eigen::ComputeFullV);
  const VectorXd& s = svd.singularValues();
  Solution r{VectorXcd::Zero(a.cols()), VectorXd::Zero(a.cols()), 1.0};
  VectorXd free = VectorXd::Zero(a.cols());  // of the null space, in the direction of each unknown
  for (Index k = 0; k < a.cols(); ++k) {
    const VectorXcd v = svd.matrixV().col(k);
    if (k >= s.size() || s[k] <= distinct * s[0]) {
      free += v.cwiseAbs2();
      continue;
    }
    r.condition = s[0] / s[k];
    r.x += v * (svd.matrixU().col(k).dot(y) / s[k]);
    r.sigma += v.cwiseAbs2() / (s[k] * s[k]);
  }
  for (Index i = 0; i < a.cols(); ++i) {
    r.x[i] /= size[i];
    r.sigma[i] = free[i] > 1e-12 ? std::numeric_limits<double>::infinity() : std::sqrt(r.sigma[i]) / size[i];
  }
  return r;
}

}  // namespace

int LineEquations::folded(std::int64_t line) const {
  const int length = sections_ * period_;
  const auto r = static_cast<int>(wrap(line, length));
  return 2 * r > length ? r - length : r;
}

void LineEquations::begin(std::vector<Tone> tones) {
  tones_ = std::move(tones);
  std::erase_if(tones_, [](const Tone& t) { return t.u == Complex{}; });
  first_ = equations_.size();
}

bool LineEquations::add(int line, int output, Complex y, std::int64_t periods) {
  Equation e{folded(line), output, y, periods, {}};
  if (e.line < 0) {
    e.line = -e.line;
    e.y = std::conj(y);
  }
  for (std::size_t i = first_; i < equations_.size(); ++i) {
    if (equations_[i].line == e.line && equations_[i].output == output) return false;
  }
  const int length = sections_ * period_;
  for (const Tone& t : tones_) {
    const int q = folded(t.line);
    if ((e.line - q) % period_ == 0) e.terms.push_back({q, t.input, t.u});
    if (2 * q % length != 0 && (e.line + q) % period_ == 0) e.terms.push_back({-q, t.input, std::conj(t.u)});
  }
  equations_.push_back(std::move(e));
  return true;
}

void LineEquations::append(const LineEquations& more) {
  sections_ = more.sections_;
  period_ = more.period_;
  equations_.insert(equations_.end(), more.equations_.begin(), more.equations_.end());
}

void LineEquations::solve(int harmonics, Identification& id) const {
  std::map<std::pair<int, int>, std::vector<const Equation*>> systems;  // by output and its line
  for (const Equation& e : equations_) systems[{e.output, e.line}].push_back(&e);
  std::map<std::tuple<int, int, int, int>, HtfEstimate> found;  // by line, output, harmonic, input
  std::set<int> left_out;
  const int length = sections_ * period_;
  for (const auto& [key, rows] : systems) {
    const auto [output, line] = key;
    std::map<std::pair<int, int>, Index> column;  // of a line of an input
    for (const Equation* e : rows) {
      for (const Term& t : e->terms) column.emplace(std::pair(t.line, t.input), static_cast<Index>(column.size()));
    }
    if (column.empty()) continue;
    const bool own_cycle = line % period_ == 0;
    const auto unknowns = static_cast<Index>(column.size()) + (own_cycle ? 1 : 0);
    MatrixXcd a = MatrixXcd::Zero(static_cast<Index>(rows.size()), unknowns);
    VectorXcd y(a.rows());
    std::vector<std::int64_t> periods(column.size(), 0);
    for (Index i = 0; i < a.rows(); ++i) {
      const Equation& e = *rows[static_cast<std::size_t>(i)];
      const double weight = std::sqrt(static_cast<double>(e.periods));
      for (const Term& t : e.terms) {
        const Index j = column[{t.line, t.input}];
        a(i, j) += weight * t.u;
        periods[static_cast<std::size_t>(j)] += e.periods;
      }
      if (own_cycle) a(i, unknowns - 1) = weight;
      y[i] = weight * e.y;
    }
    const Solution solution = least_squares(a, y);
    id.condition = std::max(id.condition, solution.condition);
    for (const auto& [excited, j] : column) {
      const int p = excited.first;
      const int m = folded(static_cast<std::int64_t>(line) - p) / period_;
      if (std::abs(m) > harmonics) continue;
      if (!std::isfinite(solution.sigma[j])) {
        left_out.insert(std::abs(p));
        continue;
      }
      HtfEstimate h;
      h.line = std::abs(p);
      h.output = output;
      h.input = excited.second;
      h.sigma = solution.sigma[j];
      h.cycles = static_cast<int>(periods[static_cast<std::size_t>(j)]) * period_;
      const auto put = [&](int order, Complex value) {
        h.m = order;
        h.value = value;
        found.emplace(std::tuple(h.line, h.output, order, h.input), h);
      };
      const bool own_mirror = 2 * p % length == 0;
      if (p >= 0) put(m, own_mirror && m == 0 ? solution.x[j].real() : solution.x[j]);
      if (p < 0 || own_mirror) put(-m, std::conj(solution.x[j]));
    }
  }
  for (const auto& [key, h] : found) {
    if (left_out.count(h.line) == 0) id.htf.push_back(h);
  }
  const auto note = [&](const char* what, const char* mend, auto&& of) {
    std::string lines;
    int count = 0;
    for (const int q : left_out) {
      if (of(q) && ++count <= 6) lines += " " + std::to_string(q);
    }
    if (count == 0) return;
    id.notes.push_back("left out " + std::to_string(count) + " " + what + " (lines" + lines +
                       (count > 6 ? " ...)" : ")") + ": " + mend);
  };
  note("multiple(s) of the pumping frequency",
       "play each twice, a quarter turn apart, and one experiment without them or all with both signs",
       [&](int q) { return q % period_ == 0; });
  note("multiple(s) of half the pumping frequency", "play each twice, a quarter turn apart",
       [&](int q) { return q % period_ != 0 && !identifiable(q, period_); });
  note("tone(s)", "play each once for every input, at independent amplitudes",
       [&](int q) { return identifiable(q, period_); });
}

}  // namespace saltus
