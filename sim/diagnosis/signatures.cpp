// Residuals and signatures: what a fit leaves, and what every coefficient would do to it.
#include <algorithm>

#include "runs.hpp"
#include "side_by_side.hpp"

namespace saltus::diagnosis {

std::vector<Eigen::VectorXd> residuals(const Problem& p, const std::vector<int>& segments, const Fit& f) {
  std::vector<Eigen::VectorXd> r(p.data->segments.size());
  side_by_side(segments.size(), [&](std::size_t j) {
    const auto k = static_cast<std::size_t>(segments[j]);
    const Segment& s = p.data->segments[k];
    const Response y = respond(p, s, f.values, f.start[k]);
    r[k] = s.y - Eigen::Map<const Eigen::VectorXd>(y.y.data(), s.y.size());
    for (Eigen::Index i = 0; i < r[k].size(); ++i) {
      if (!(s.count[i] > 0.0)) r[k][i] = 0.0;
    }
  });
  return r;
}

Signatures signatures(const Problem& p, const std::vector<int>& segments, const Fit& f,
                      const std::vector<int>& candidates) {
  const Data& data = *p.data;
  Signatures out;
  out.nuisance = f.free;
  for (const int c : candidates) {
    if (std::find(f.free.begin(), f.free.end(), c) == f.free.end()) out.candidates.push_back(c);
  }
  std::vector<int> all = out.nuisance, secants;
  for (const int c : out.candidates) {
    if (p.machine->coefficients[static_cast<std::size_t>(c)].changes_charts() &&
        f.values[static_cast<std::size_t>(c)] == 0.0) {
      secants.push_back(c);
    }
    all.push_back(c);
  }
  Eigen::Index rows = 0;
  for (const int index : segments) {
    out.offset.push_back(rows);
    rows += data.segments[static_cast<std::size_t>(index)].y.size();
  }
  const auto n_nuisance = static_cast<Eigen::Index>(out.nuisance.size());
  Eigen::MatrixXd G(rows, static_cast<Eigen::Index>(all.size()));
  out.r.resize(rows);
  const Eigen::Index n_start = p.machine->starts();
  const auto at_once = static_cast<std::size_t>(p.machine->directions());
  side_by_side(segments.size(), [&](std::size_t j) {
    const Segment& s = data.segments[static_cast<std::size_t>(segments[j])];
    const Start& start = f.start[static_cast<std::size_t>(segments[j])];
    const Eigen::VectorXd w = weights(data, s);
    const Eigen::Index n = s.y.size(), top = out.offset[j];
    const Response here = respond(p, s, f.values, start);
    const Eigen::VectorXd y0 = Eigen::Map<const Eigen::VectorXd>(here.y.data(), n);
    out.r.segment(top, n) = w.cwiseProduct(s.y - y0);
    Eigen::MatrixXd S;
    for (std::size_t from = 0; from < std::max<std::size_t>(1, all.size()); from += at_once) {
      const std::size_t count = std::min(at_once, all.size() - from);
      const Response y = sensitivities(p, s, f.values, start, {all.data() + from, count});
      const Eigen::Map<const RowMajor> gradient(y.gradient.data(), n, p.machine->width());
      if (from == 0) S = w.asDiagonal() * gradient.leftCols(n_start);
      G.block(top, static_cast<Eigen::Index>(from), n, static_cast<Eigen::Index>(count)) =
          w.asDiagonal() * gradient.middleCols(n_start, static_cast<Eigen::Index>(count));
    }
    for (const int c : secants) {
      std::vector<double> values = f.values;
      const double probe = p.machine->coefficients[static_cast<std::size_t>(c)].probe;
      values[static_cast<std::size_t>(c)] = probe;
      const Response y = respond(p, s, values, start);
      const auto column = std::find(all.begin(), all.end(), c) - all.begin();
      G.block(top, column, n, 1) = w.cwiseProduct(Eigen::Map<const Eigen::VectorXd>(y.y.data(), n) - y0) / probe;
    }
    const WithoutStart without_start(s, std::move(S));
    if (G.cols() > 0) G.middleRows(top, n) = without_start(Eigen::MatrixXd(G.middleRows(top, n)));
    out.r.segment(top, n) = without_start(Eigen::VectorXd(out.r.segment(top, n)));
  });
  out.N = G.leftCols(n_nuisance);
  out.C = G.rightCols(static_cast<Eigen::Index>(out.candidates.size()));
  return out;
}

Signatures released(const Signatures& s, int coefficient) {
  const auto at = std::find(s.nuisance.begin(), s.nuisance.end(), coefficient) - s.nuisance.begin();
  const auto i = static_cast<Eigen::Index>(at);
  if (i == s.N.cols()) return s;
  Signatures out;
  out.r = s.r;
  out.offset = s.offset;
  out.nuisance = s.nuisance;
  out.nuisance.erase(out.nuisance.begin() + at);
  out.candidates = s.candidates;
  out.candidates.push_back(coefficient);
  out.N.resize(s.N.rows(), s.N.cols() - 1);
  out.N << s.N.leftCols(i), s.N.rightCols(s.N.cols() - 1 - i);
  out.C.resize(s.C.rows(), s.C.cols() + 1);
  out.C << s.C, s.N.col(i);
  return out;
}

}  // namespace saltus::diagnosis
