#include "common_denominator.hpp"

#include <Eigen/LU>

namespace saltus::common_denominator {

using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Eigen::VectorXd;
using Index = Eigen::Index;

VectorXcd mirrored(const VectorXcd& x, bool pair) {
  if (!pair) return x;
  VectorXcd r(2 * x.size());
  r << x, x.conjugate();
  return r;
}

VectorXcd denominator(const Problem& p, const VectorXd& a) {
  VectorXcd d = p.power[0];
  for (Index k = 0; k < a.size(); ++k) d += a[k] * p.power[static_cast<std::size_t>(k) + 1];
  return d;
}

Projection::Projection(const Problem& p, const Series& s, const VectorXcd& d)
    : p_(&p), pair_(s.pair), factor_(s.weight.cast<Complex>().cwiseQuotient(mirrored(d, s.pair))) {
  const Index n = p.lines;
  const VectorXd square = factor_.cwiseAbs2();
  VectorXd sum = square.head(n), difference = VectorXd::Zero(n);
  if (pair_) {
    sum += square.tail(n);
    difference = square.head(n) - square.tail(n);
  }
  MatrixXd weighted(2 * n, p.taps.cols());
  weighted.topRows(n) = sum.cwiseSqrt().asDiagonal() * p.taps.topRows(n);
  weighted.bottomRows(n) = sum.cwiseSqrt().asDiagonal() * p.taps.bottomRows(n);
  MatrixXd even = MatrixXd::Zero(p.taps.cols(), p.taps.cols());
  even.selfadjointView<Eigen::Lower>().rankUpdate(weighted.transpose());
  even.triangularView<Eigen::StrictlyUpper>() = even.transpose();
  if (!pair_) {
    real_.compute(even);
    return;
  }
  const MatrixXd odd = p.taps.topRows(n).transpose() * difference.asDiagonal() * p.taps.bottomRows(n);
  MatrixXcd gram(even.rows(), even.cols());
  gram.real() = even;
  gram.imag() = odd - odd.transpose();
  complex_.compute(gram);
}

VectorXcd Projection::once(const VectorXcd& x) const {
  const Index n = p_->lines;
  const auto cosine = p_->taps.topRows(n), sine = p_->taps.bottomRows(n);
  const VectorXcd y = factor_.conjugate().cwiseProduct(x);
  if (!pair_) {
    const VectorXd c =
        real_.solve(VectorXd(cosine.transpose() * VectorXd(y.real()) + sine.transpose() * VectorXd(y.imag())));
    VectorXcd fitted(n);
    fitted.real() = cosine * c;
    fitted.imag() = sine * c;
    return x - factor_.cwiseProduct(fitted);
  }
  // The columns are w at the lines and their conjugates at the mirrored ones, w = cosine + i sine.
  const VectorXcd even = y.head(n) + y.tail(n), odd = Complex{0.0, -1.0} * (y.head(n) - y.tail(n));
  VectorXcd rhs(p_->taps.cols());
  rhs.real() = cosine.transpose() * VectorXd(even.real()) + sine.transpose() * VectorXd(odd.real());
  rhs.imag() = cosine.transpose() * VectorXd(even.imag()) + sine.transpose() * VectorXd(odd.imag());
  const VectorXcd c = complex_.solve(rhs);
  const VectorXd re = c.real(), im = c.imag();
  VectorXcd a(n), b(n), fitted(2 * n);
  a.real() = cosine * re;
  a.imag() = cosine * im;
  b.real() = sine * re;
  b.imag() = sine * im;
  fitted << a + Complex{0.0, 1.0} * b, a - Complex{0.0, 1.0} * b;
  return x - factor_.cwiseProduct(fitted);
}

MatrixXcd slope_of(const Problem& p, const Series& s, const Projection& complement, const VectorXcd& fitted) {
  MatrixXcd slope(fitted.size(), p.count);
  for (Index k = 0; k < p.count; ++k) {
    slope.col(k) = complement(fitted.cwiseProduct(mirrored(p.power[static_cast<std::size_t>(k) + 1], s.pair)));
  }
  return slope;
}

namespace {

// Normal equations of one linear problem around a; Gauss-Newton, or Sanathanan & Koerner's where `modelled` is false.
struct Normal {
  MatrixXd matrix;
  VectorXd rhs;
  double cost = 0.0;
};

Normal normal_equations(const Problem& p, const VectorXd& a, bool modelled) {
  Normal n{MatrixXd::Zero(p.count, p.count), VectorXd::Zero(p.count), 0.0};
  const VectorXcd d = denominator(p, a);
  for (const Series& s : p.series) {
    const Projection complement(p, s, d);
    const VectorXcd y = s.weight.cast<Complex>().cwiseProduct(s.value);
    const VectorXcd residual = complement(y);
    n.cost += residual.squaredNorm();
    const VectorXcd fitted = (modelled ? VectorXcd(y - residual) : y).cwiseQuotient(mirrored(d, s.pair));
    const MatrixXcd slope = slope_of(p, s, complement, fitted);
    n.matrix += (slope.adjoint() * slope).real();
    n.rhs -= (slope.adjoint() * residual).real();
  }
  return n;
}

}  // namespace

Solution solve(const Problem& p, VectorXd a, int reweightings) {
  for (int i = 0; i < reweightings; ++i) {
    // The equation error A y - B, weighted by the last A, is linear in A: its value at a is the residual there.
    const Normal n = normal_equations(p, a, false);
    const VectorXd step = n.matrix.ldlt().solve(n.rhs);
    a += step;
    if (step.norm() < 1e-2 * (1.0 + a.norm())) break;  // Gauss-Newton goes on from here
  }
  Solution r;
  Normal n = normal_equations(p, a, true);
  for (int i = 0; i < 30; ++i) {
    const VectorXd step = n.matrix.ldlt().solve(n.rhs);
    double length = 1.0;
    Normal next = normal_equations(p, a + step, true);
    for (int half = 0; half < 6 && !(next.cost <= n.cost * (1.0 + 1e-12)); ++half) {
      length *= 0.5;
      next = normal_equations(p, a + length * step, true);
    }
    // Far below the noise, for the cost is some thousands of its variances; or of rounding.
    const bool small = step.dot(n.matrix * step) < 1e-8 * n.cost || step.norm() < 1e-9 * (1.0 + a.norm());
    a += length * step;
    n = next;
    if (!a.allFinite()) return r;
    if (small) {
      r.ok = true;
      break;
    }
  }
  r.a = a;
  r.cost = n.cost;
  r.covariance = 0.5 * n.matrix.inverse();
  return r;
}

}  // namespace saltus::common_denominator
