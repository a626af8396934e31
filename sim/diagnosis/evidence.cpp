#include "evidence.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/spectrum/twiddles.hpp"
#include "core/trace/statistics.hpp"
#include "normal_equations.hpp"

namespace saltus::diagnosis {
namespace {

struct Power {
  double residual = 0.0;  // sum of squares, in units of its noise
  double freedom = 0.0;
  double noise = 0.0;  // the same of the repeats' deviations from their mean
  double noise_freedom = 0.0;
  struct Part {
    double noise, share, freedom;  // of one repeat; what it is expected to be, of white noise; numbers in it
  };
  std::vector<Part> parts;

  void add_noise(double squares, double share, double numbers) {
    noise += squares;
    noise_freedom += share;
    if (share > 0.0) parts.push_back({squares, share, numbers});
  }
};

// [-] By how much wider than white noise's a sum of squares scatters: repeats tell, and what the colour along time
// makes of it is the least. What moves the machine moves all its outputs for cycles, of which that colour knows little.
double widening(const Power& q, double floor, const Data& data) {
  constexpr double prior = 5.0;  // [-] repeats that what is known of the colour is worth
  if (!data.coloured || q.parts.empty()) return data.colour;
  double sum = prior * data.colour, weight = prior;
  for (const Power::Part& part : q.parts) {
    const double off = part.noise / (floor * part.share) - 1.0;
    sum += 0.5 * part.freedom * off * off;
    weight += 1.0;
  }
  return std::max(data.colour, sum / weight);
}

View compare(std::string name, const Power& q, const Data& data) {
  View v{std::move(name), 1.0, q.freedom, 1.0};
  if (!(q.freedom > 0.0)) return v;
  const double floor = q.noise_freedom > 0.0 ? q.noise / q.noise_freedom : 1.0;
  v.ratio = q.residual / q.freedom / floor;
  const double d2 = q.noise_freedom > 0.0 ? q.noise_freedom : 1e6;
  const double wider = widening(q, floor, data);
  v.p = fisher_tail(v.ratio, q.freedom / wider, d2 / wider);
  return v;
}

// Mean over the cycles of a segment, section by section and output by output.
Eigen::VectorXd mean_cycle(const Data& data, const Eigen::VectorXd& x) {
  const Eigen::Index width = data.sections * static_cast<Eigen::Index>(data.outputs());
  Eigen::VectorXd m = Eigen::VectorXd::Zero(width);
  const Eigen::Index cycles = x.size() / width;
  for (Eigen::Index c = 0; c < cycles; ++c) m += x.segment(c * width, width);
  return m / static_cast<double>(std::max<Eigen::Index>(1, cycles));
}

// Sum of squared moduli over the lines q + l P, l = -3 ... 3, of the outputs in units of `noise`.
double line_power(const Data& data, const Eigen::VectorXd& x, const std::vector<int>& lines, double* freedom) {
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  const int L = static_cast<int>(x.size() / ny);
  const int P = data.period_cycles;
  std::vector<int> wanted;
  for (const int q : lines) {
    for (int l = -3; l <= 3; ++l) {
      int k = ((q + l * P) % L + L) % L;
      k = std::min(k, L - k);
      if (k != 0 && 2 * k != L && std::find(wanted.begin(), wanted.end(), k) == wanted.end()) wanted.push_back(k);
    }
  }
  std::vector<double> cosine(static_cast<std::size_t>(L)), sine(static_cast<std::size_t>(L));
  for (int n = 0; n < L; ++n) {
    const Complex w = root_of_unity(n, L);
    cosine[static_cast<std::size_t>(n)] = w.real();
    sine[static_cast<std::size_t>(n)] = w.imag();
  }
  double power = 0.0;
  for (const int k : wanted) {
    for (Eigen::Index j = 0; j < ny; ++j) {
      double re = 0.0, im = 0.0;
      int at = 0;
      for (int n = 0; n < L; ++n) {
        const double v = x[n * ny + j];
        re += v * cosine[static_cast<std::size_t>(at)];
        im -= v * sine[static_cast<std::size_t>(at)];
        at += k;
        if (at >= L) at -= L;
      }
      power += (re * re + im * im) * 2.0 / L;
      if (freedom != nullptr) *freedom += 2.0;
    }
  }
  return power;
}

// Covariance of noise along columns as repeats have it, and the degrees of freedom of that.
struct Scatter {
  Eigen::MatrixXd covariance;  // (columns x columns)
  double freedom = 0.0;
};

Scatter scatter_along(const Data& data, const std::vector<int>& segments, const std::vector<Eigen::Index>& offset,
                      const Eigen::MatrixXd& columns) {
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  Scatter r{Eigen::MatrixXd::Zero(columns.cols(), columns.cols())};
  for (std::size_t j = 0; j < segments.size(); ++j) {
    const Segment& seg = data.segments[static_cast<std::size_t>(segments[j])];
    const auto repeats = static_cast<double>(seg.deviation.size());
    if (repeats < 2.0) continue;
    for (Eigen::VectorXd w : seg.deviation) {
      for (Eigen::Index i = 0; i < w.size(); ++i) w[i] *= std::sqrt(seg.count[i]) / data.noise[i % ny];
      const Eigen::VectorXd along = columns.middleRows(offset[j], w.size()).transpose() * w;
      r.covariance += along * along.transpose() / (repeats * (repeats - 1.0));
    }
    r.freedom += repeats - 1.0;
  }
  return r;
}

// Columns less their means over the cycles of each segment.
Eigen::MatrixXd without_mean_cycle(const Data& data, const std::vector<int>& segments, const Signatures& s,
                                   Eigen::MatrixXd columns) {
  for (std::size_t j = 0; j < segments.size(); ++j) {
    const Eigen::Index rows = data.segments[static_cast<std::size_t>(segments[j])].y.size();
    for (Eigen::Index k = 0; k < columns.cols(); ++k) {
      auto part = columns.col(k).segment(s.offset[j], rows);
      const Eigen::VectorXd mean = mean_cycle(data, part);
      for (Eigen::Index i = 0; i < rows; ++i) part[i] -= mean[i % mean.size()];
    }
  }
  return columns;
}

}  // namespace

std::vector<View> views(const Problem& p, const std::vector<int>& segments, const Fit& f) {
  const Data& data = *p.data;
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  const auto residual = residuals(p, segments, f);
  Power all, mean, lines;
  Eigen::VectorXd mean_sum;
  for (const int index : segments) {
    const Segment& s = data.segments[static_cast<std::size_t>(index)];
    Eigen::VectorXd r = residual[static_cast<std::size_t>(index)];
    const std::size_t repeats = s.deviation.size();
    for (Eigen::Index i = 0; i < r.size(); ++i) r[i] *= std::sqrt(s.count[i]) / data.noise[i % ny];
    all.residual += r.squaredNorm();
    const double measured = s.measured();
    all.freedom += measured - static_cast<double>(p.machine->free_coordinates(s.guess.chart).size());
    for (const auto& x : s.deviation) {
      double squares = 0.0;
      for (Eigen::Index i = 0; i < x.size(); ++i) squares += x[i] * x[i] / (data.noise[i % ny] * data.noise[i % ny]);
      all.add_noise(squares, (s.count.array() - 1.0).max(0.0).sum() / static_cast<double>(repeats), measured);
    }
    if (data.sections == 0) continue;

    // Deviations of the repeats in the same units: sqrt(n / (n - 1)) d_r sqrt(n) / noise sums to n - 1 of them.
    // A sample that was missed in some repeats has that much less to tell of the noise.
    const double told = (s.count.array() - 1.0).max(0.0).mean();  // of n repeats n - 1 where nothing is missing
    std::vector<Eigen::VectorXd> d;
    if (repeats > 1) {
      for (const auto& x : s.deviation) {
        Eigen::VectorXd scaled = x;
        for (Eigen::Index i = 0; i < x.size(); ++i) scaled[i] /= data.noise[i % ny];
        d.push_back(std::move(scaled));
      }
    }
    const double cycles = static_cast<double>(r.size()) / static_cast<double>(data.sections * ny);
    if (mean_sum.size() == 0) mean_sum = Eigen::VectorXd::Zero(data.sections * ny);
    mean_sum += mean_cycle(data, r) * std::sqrt(cycles);
    const auto places = static_cast<double>(data.sections * ny), share = told / static_cast<double>(repeats);
    for (const auto& x : d)
      mean.add_noise((mean_cycle(data, x) * std::sqrt(cycles)).squaredNorm(), share * places, places);

    const auto& excited = s.lines;
    if (!excited.empty() && data.period_cycles > 0 && data.repeats > 1) {
      double freedom = 0.0;
      lines.residual += line_power(data, r, excited, &freedom);
      lines.freedom += freedom;
      for (const auto& x : d) lines.add_noise(line_power(data, x, excited, nullptr), share * freedom, freedom);
    }
  }
  all.freedom -= static_cast<double>(f.free.size());
  if (mean_sum.size() > 0) {
    mean.residual = mean_sum.squaredNorm() / static_cast<double>(segments.size());
    mean.freedom = static_cast<double>(mean_sum.size());
  }
  std::vector<View> r{compare("all samples", all, data)};
  if (mean.freedom > 0.0) r.push_back(compare("mean cycle", mean, data));
  if (lines.freedom > 0.0) r.push_back(compare("stimulus lines", lines, data));
  return r;
}

Eigen::Index Evidence::find(int coefficient) const {
  const auto it = std::find(candidate.begin(), candidate.end(), coefficient);
  return it == candidate.end() ? -1 : static_cast<Eigen::Index>(it - candidate.begin());
}

double Evidence::cosine(Eigen::Index i, Eigen::Index j) const {
  const double n = std::sqrt(information(i, i) * information(j, j));
  return n > 0.0 ? information(i, j) / n : 0.0;
}

Eigen::Matrix2d Evidence::information_of(Eigen::Index i, Eigen::Index j) const {
  Eigen::Matrix2d r;
  r << information(i, i), information(i, j), information(j, i), information(j, j);
  return r;
}

Evidence evidence(const Problem& p, const std::vector<int>& segments, const Fit& f, const std::vector<int>& candidates,
                  double tolerances) {
  return weigh(p, segments, f, signatures(p, segments, f, candidates), tolerances);
}

double chance_of_scores(const Problem& p, const std::vector<int>& segments, const Fit& f,
                        const std::vector<int>& coefficients) {
  constexpr double least = 4.0;  // [-] degrees of freedom
  const Signatures s = signatures(p, segments, f, coefficients);
  const auto n = static_cast<Eigen::Index>(s.candidates.size());
  const auto [scatter, freedom] = scatter_along(*p.data, segments, s.offset, s.C);
  const double k = static_cast<double>(n), left = freedom - k + 1.0;
  const Eigen::VectorXd scale = scatter.diagonal().cwiseSqrt().cwiseInverse();
  if (n == 0 || left < least || !scale.allFinite()) return std::numeric_limits<double>::quiet_NaN();
  const Eigen::VectorXd score = scale.asDiagonal() * (s.C.transpose() * s.r);
  const Eigen::MatrixXd unit = scale.asDiagonal() * scatter * scale.asDiagonal();
  const double squared = score.dot(Eigen::LDLT<Eigen::MatrixXd>(unit).solve(score));
  return fisher_tail(squared * left / (freedom * k), k, left);
}

double widening_along(const Problem& p, const std::vector<int>& segments, const Fit& f,
                      const std::vector<int>& coefficients) {
  const Signatures s = signatures(p, segments, f, coefficients);
  const Eigen::VectorXd scatter = scatter_along(*p.data, segments, s.offset, s.C).covariance.diagonal();
  double sum = 0.0, used = 0.0;
  for (Eigen::Index i = 0; i < scatter.size(); ++i) {
    const double white = s.C.col(i).squaredNorm();
    if (!(white > 0.0)) continue;
    sum += scatter[i] / white;
    used += 1.0;
  }
  return used > 0.0 ? std::max(1.0, sum / used) : 1.0;
}

double beyond_mean_cycle(const Problem& p, const std::vector<int>& segments, const Fit& f, const Signatures& s,
                         int effect) {
  const auto k = static_cast<std::size_t>(effect);
  const double size = f.values[k] - p.machine->coefficients[k].nominal;
  Signatures rest = released(s, effect);
  const Eigen::VectorXd own = rest.C.rightCols(1);
  rest.candidates = {effect};
  rest.C = without_mean_cycle(*p.data, segments, s, own);
  rest.N = without_mean_cycle(*p.data, segments, s, rest.N);
  rest.r = without_mean_cycle(*p.data, segments, s, s.r + size * own);
  const double z = weigh(p, segments, f, rest).z[0];
  return size < 0.0 ? -z : z;
}

Evidence among(const Evidence& e, const std::vector<int>& candidates) {
  std::vector<Eigen::Index> keep;
  Evidence r;
  for (const int c : candidates) {
    const Eigen::Index i = e.find(c);
    if (i < 0) continue;
    keep.push_back(i);
    r.candidate.push_back(c);
    r.imitated_by.push_back(e.imitated_by[static_cast<std::size_t>(i)]);
  }
  r.z = e.z(keep);
  r.value = e.value(keep);
  r.error = e.error(keep);
  r.kept = e.kept(keep);
  r.identified = e.identified(keep);
  r.score = e.score(keep);
  r.information = e.information(keep, keep);
  r.inflation = e.inflation;
  r.freedom = e.freedom;
  return r;
}

Evidence weigh(const Problem& p, const std::vector<int>& segments, const Fit& f, const Signatures& s,
               double tolerances) {
  const Data& data = *p.data;
  const auto n = static_cast<Eigen::Index>(s.candidates.size());
  const auto m = static_cast<Eigen::Index>(s.nuisance.size());
  Evidence e;
  e.candidate = s.candidates;
  e.z = e.value = e.error = e.kept = e.identified = Eigen::VectorXd::Zero(n);
  e.imitated_by.assign(static_cast<std::size_t>(n), {});

  const Eigen::MatrixXd NN = s.N.transpose() * s.N, NC = s.N.transpose() * s.C, CC = s.C.transpose() * s.C;
  const Eigen::VectorXd Nr = s.N.transpose() * s.r, Cr = s.C.transpose() * s.r;
  Eigen::VectorXd prior = Eigen::VectorXd::Zero(m), off = Eigen::VectorXd::Zero(m);
  for (Eigen::Index i = 0; i < m; ++i) {
    const auto k = static_cast<std::size_t>(s.nuisance[static_cast<std::size_t>(i)]);
    prior[i] = prior_of(p, static_cast<int>(k)) / (tolerances * tolerances);
    off[i] = prior[i] * (f.values[k] - p.machine->coefficients[k].nominal);
  }
  // Scaled so that coefficients of any unit invert alike.
  const auto solve = [&](double looser, const Eigen::MatrixXd& right) -> Eigen::MatrixXd {
    Eigen::MatrixXd a = NN;
    a.diagonal() += prior / (looser * looser);
    const Eigen::VectorXd d = a.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd scaled = d.asDiagonal() * a * d.asDiagonal();
    return d.asDiagonal() * Eigen::LDLT<Eigen::MatrixXd>(scaled).solve(d.asDiagonal() * right);
  };
  Eigen::MatrixXd X = Eigen::MatrixXd::Zero(m, n);
  Eigen::VectorXd loose = CC.diagonal();
  e.information = CC;
  e.score = Cr;
  constexpr double looser = 10.0;
  if (m > 0) {
    X = solve(1.0, NC);
    e.information -= NC.transpose() * X;
    e.score -= X.transpose() * (Nr - off);
    const Eigen::MatrixXd Y = solve(looser, NC);
    loose -= (NC.transpose() * Y).diagonal();
  }

  // How much more than white noise the repeats scatter along each signature.
  Eigen::VectorXd inflation = Eigen::VectorXd::Ones(n);
  if (data.coloured) {
    const Scatter of_repeats = scatter_along(data, segments, s.offset, s.C - s.N * X);
    const Eigen::VectorXd scatter = of_repeats.covariance.diagonal();
    const double own = std::max(1.0, of_repeats.freedom);
    const double pooled_weight = std::min(40.0, 2.0 * own);  // what all signatures share is told by no more repeats
    double pooled = 0.0, used = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) {
      if (!(e.information(i, i) > 1e-9 * CC(i, i))) continue;
      pooled += scatter[i] / e.information(i, i);
      used += 1.0;
    }
    pooled = used > 0.0 ? std::max(1.0, pooled / used) : 1.0;
    e.inflation = pooled;
    e.freedom = own + pooled_weight;
    for (Eigen::Index i = 0; i < n; ++i) {
      if (!(e.information(i, i) > 1e-9 * CC(i, i))) continue;
      inflation[i] =
          std::max(1.0, (own * scatter[i] / e.information(i, i) + pooled_weight * pooled) / (own + pooled_weight));
    }
  }
  for (Eigen::Index i = 0; i < n; ++i) {
    const double info = e.information(i, i);
    if (!(info > 1e-12 * CC(i, i)) || !(CC(i, i) > 1e-6 * 1e-6)) continue;
    e.value[i] = e.score[i] / info;
    e.error[i] = std::sqrt(inflation[i] / info);
    e.z[i] = e.value[i] / e.error[i];
    e.kept[i] = std::sqrt(info / CC(i, i));
    e.identified[i] = std::max(0.0, loose[i]) / info;
    if (e.identified[i] > 0.1 || m == 0) continue;
    // Which declared parameter moves most, in its tolerance, to imitate it?
    Eigen::Index most = 0;
    (X.col(i).cwiseProduct(prior.cwiseSqrt())).cwiseAbs().maxCoeff(&most);
    e.imitated_by[static_cast<std::size_t>(i)] =
        p.machine->coefficients[static_cast<std::size_t>(s.nuisance[static_cast<std::size_t>(most)])].name;
  }
  return e;
}

}  // namespace saltus::diagnosis
