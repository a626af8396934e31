#include "correlated_errors.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <utility>

namespace saltus::common_denominator {

using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Index = Eigen::Index;

std::vector<Errors> errors_of(const Identification& id, const Problem& p, const std::vector<HtfEstimate>& lines) {
  std::vector<Errors> all;
  for (Index q = 0; q < p.lines; ++q) {
    const ClassCorrelation* known = id.correlation(lines[static_cast<std::size_t>(q)].line);
    if (known == nullptr) return {};
    Errors e;
    e.own = known->own;
    std::vector<Index> rows;
    const auto enter = [&](std::size_t series, int m, int output, Index row) {
      e.place.push_back({series, row, m < 0});
      const bool held = std::abs(m) <= known->harmonics && known->row(m, output) < known->matrix.rows();
      rows.push_back(held ? known->row(m, output) : -1);
    };
    for (std::size_t i = 0; i < p.series.size(); ++i) {
      const Series& s = p.series[i];
      enter(i, s.m, s.output, q);
      if (s.pair) enter(i, -s.m, s.output, p.lines + q);
    }
    const auto n = static_cast<Index>(rows.size());
    e.correlation = MatrixXcd::Identity(n, n);
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j < n; ++j) {
        const Index a = rows[static_cast<std::size_t>(i)], b = rows[static_cast<std::size_t>(j)];
        if (i != j && a >= 0 && b >= 0) e.correlation(i, j) = known->matrix(a, b);
      }
    }
    all.push_back(std::move(e));
  }
  return all;
}

Sandwich covariance_of(const Problem& p, const Solution& s, const std::vector<Errors>& errors) {
  const VectorXcd d = denominator(p, s.a);
  std::vector<MatrixXcd> slope;
  MatrixXd matrix = MatrixXd::Zero(p.count, p.count), middle = matrix;
  for (const Series& one : p.series) {
    const Projection complement(p, one, d);
    const VectorXcd y = one.weight.cast<Complex>().cwiseProduct(one.value);
    slope.push_back(slope_of(p, one, complement, VectorXcd(y - complement(y)).cwiseQuotient(mirrored(d, one.pair))));
    matrix += (slope.back().adjoint() * slope.back()).real();
  }
  const auto parts = [&](const Errors& e) -> MatrixXd {
    MatrixXcd rows(static_cast<Index>(e.place.size()), p.count);
    for (std::size_t i = 0; i < e.place.size(); ++i) {
      const auto row = slope[e.place[i].series].row(e.place[i].row);
      rows.row(static_cast<Index>(i)) = row;
      if (e.place[i].mirrored) rows.row(static_cast<Index>(i)) = row.conjugate();
    }
    return 0.5 * (rows.adjoint() * e.correlation * rows).real();
  };
  const MatrixXd inverse = matrix.inverse();
  double sum = 0.0, square = 0.0;
  for (const Errors& e : errors) {
    const MatrixXd part = parts(e);
    const double size = (inverse * part * inverse).trace();
    middle += part;
    sum += size;
    square += size * size / std::max(1.0, e.own);
  }
  return {inverse * middle * inverse, 2.0 * sum * sum / square};
}

std::vector<VectorXcd> draw(const Problem& p, const std::vector<Errors>& errors, Random& random) {
  const auto circular = [&] {
    const double re = random.normal(), im = random.normal();
    return std::sqrt(0.5) * Complex{re, im};
  };
  std::vector<VectorXcd> noise;
  for (const Series& s : p.series) {
    noise.emplace_back(s.value.size());
    for (Index q = 0; errors.empty() && q < s.value.size(); ++q) noise.back()[q] = circular();
  }
  for (const Errors& e : errors) {
    const Index n = e.correlation.rows();
    VectorXcd z(n);
    for (Index i = 0; i < n; ++i) z[i] = circular();
    z = (ClassCorrelation{0, 0, 0.0, 0.0, e.correlation}.root() * z).eval();
    for (std::size_t i = 0; i < e.place.size(); ++i) {
      const Complex x = z[static_cast<Index>(i)];
      noise[e.place[i].series][e.place[i].row] = e.place[i].mirrored ? std::conj(x) : x;
    }
  }
  return noise;
}

}  // namespace saltus::common_denominator
