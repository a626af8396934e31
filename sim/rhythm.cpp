#include "rhythm.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

#include "core/random.hpp"
#include "format.hpp"
#include "kinematic.hpp"
#include "section_maps.hpp"

namespace saltus {
namespace {

using namespace rhythm;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Index = Eigen::Index;

constexpr double mostly_told = 0.8;      // [-] of the input's deviations by the state: it excites nothing of its own
constexpr int finest = 16;               // [-] lines a cycle of the harmonic transfer functions
constexpr std::size_t fewest_rows = 12;  // of a map

// Multipliers, at each section within a chart, and how they scatter when the stays are drawn anew.
void add_multipliers(const Layout& layout, const RhythmOptions& o, Rhythm& r) {
  const Passages& w = layout.passages;
  std::vector<std::vector<Pairs>> steps;
  std::vector<std::vector<Frame>> bases;
  for (int j = 1; j < w.per_chart; ++j) {
    steps.push_back(steps_of(w, j));
    bases.push_back(frames_at(layout, j));
    for (const Pairs& p : steps.back()) {
      if (p.x.rows() >= std::max<Index>(static_cast<Index>(fewest_rows), 3 * r.directions)) continue;
      throw RecordError(w.record->name,
                        "only " + std::to_string(p.x.rows()) + " steps are followed by another of the same experiment",
                        "record more cycles; it takes a dozen of each step");
    }
  }
  const auto n = w.visits.size();
  const VectorXd one = VectorXd::Ones(static_cast<Index>(n));
  const auto mean = multipliers_of_all(steps, bases, r.directions, one);
  if (mean.empty()) throw RecordError(w.record->name, "its section maps cannot be told", "record more cycles");
  std::vector<std::vector<Complex>> replicates;
  Random random(o.seed);
  for (int k = 0; k < o.replicates; ++k) {
    auto again = multipliers_of_all(steps, bases, r.directions, drawn(n, random));
    if (!again.empty()) replicates.push_back(in_order(std::move(again), mean));
  }
  const std::vector<double> spread = spread_of(steps, bases, mean, one);
  r.disagreement = spread[0];
  const bool partial = r.directions < static_cast<int>(w.dim);
  for (std::size_t i = 0; i < mean.size(); ++i) {
    RhythmMultiplier m;
    m.value = mean[i];
    std::vector<double> off, modulus;
    for (const auto& v : replicates) {
      off.push_back(std::norm(v[i] - mean[i]));
      modulus.push_back(std::abs(v[i]));
    }
    const double size = std::abs(m.value), unseen = partial ? spread[i] : 0.0;
    m.sigma = std::hypot(sigma_of(off, std::abs(m.value.imag()) > 0.0), unseen);
    m.low = modulus.empty() ? 0.0 : std::max(0.0, size - std::hypot(size - quantile(modulus, 0.025), 1.96 * unseen));
    m.high = modulus.empty() ? 0.0 : size + std::hypot(quantile(modulus, 0.975) - size, 1.96 * unseen);
    r.multipliers.push_back(m);
  }
  if (partial) {
    r.notes.push_back(
        format("In %d of %d directions the section before sees the passages scatter as well; multipliers of the "
               "others, the most strongly contracted, are not told, and errors hold what sections disagree about.",
               r.directions, static_cast<int>(w.dim)));
  }
}

// Harmonic transfer functions, or why there are none.
void add_htf(const Passages& w, const std::vector<Frame>& frames, const RhythmOptions& o, Rhythm& r) {
  if (w.record->inputs.empty()) {
    r.refusal = "the record has no input";
    return;
  }
  if (w.record->inputs.size() > 1) {
    r.refusal = "they are identified for one input at a time; keep one column in `# inputs`";
    return;
  }
  const std::string unit = w.record->inputs[0].unit;
  std::vector<Pairs> pairs;
  double all = 0.0, left = 0.0, size = 0.0, n_all = 0.0;
  for (int s = 0; s < w.sections(); ++s) {
    pairs.push_back(pairs_of(w, s, 1));
    Pairs& p = pairs.back();
    if (p.x.rows() < 3 * (r.directions + 2) || !p.u.allFinite()) {
      r.refusal = "too few passages of section " + std::to_string(s) + " have their neighbours; record more cycles";
      return;
    }
    const VectorXd one = VectorXd::Ones(p.x.rows());
    MatrixXd known(p.x.rows(), 2 * w.dim);
    known << centred(p.x, one), centred(p.z, one);
    for (Index i = 0; i < known.cols(); ++i) known.col(i) /= std::max(1e-300, known.col(i).norm());
    const VectorXd u = centred(p.u, one);
    const VectorXd rest = u - known * known.colPivHouseholderQr().solve(u);
    const auto n = static_cast<double>(p.x.rows());
    all += u.squaredNorm() / (n - 1.0);
    left += rest.squaredNorm() / std::max(1.0, n - 1.0 - static_cast<double>(known.cols()));
    size += p.u.squaredNorm();
    n_all += n;
  }
  const double deviation = std::sqrt(all / static_cast<double>(pairs.size()));
  if (deviation < 1e-6 * std::sqrt(size / n_all) || !(all > 0.0)) {
    r.refusal = "the input repeats from cycle to cycle and excites nothing; add a stimulus of its own";
    return;
  }
  r.told = std::clamp(1.0 - left / all, 0.0, 1.0);
  if (r.told > mostly_told) {
    r.refusal = format(
        "the input deviates from its mean cycle by %.3g %s, but the state before tells %.0f %% of that: it is "
        "fed back, and what it does cannot be told from what the state does; add a stimulus of its own",
        deviation, unit.c_str(), 100.0 * r.told);
    return;
  }
  const auto n = w.visits.size();
  const Chain chain = chain_of(pairs, frames, r.directions, VectorXd::Ones(static_cast<Index>(n)));
  const int lines = std::min(4 * finest, finest * w.sections() / 2);
  std::vector<Eigen::MatrixXcd> h;
  for (int q = 1; q < lines; ++q) h.push_back(htf_at(chain, frames, static_cast<double>(q) / finest, o.harmonics));
  // By the median, as for the multipliers: a replicate whose maps are nearly singular lies anywhere.
  Random random(o.seed + 1);
  const int replicates = std::min(o.replicates, 100);
  std::vector<std::vector<std::vector<double>>> squares(h.size(), std::vector<std::vector<double>>(at(h[0].size())));
  for (int k = 0; k < replicates; ++k) {
    const Chain again = chain_of(pairs, frames, r.directions, drawn(n, random));
    for (std::size_t q = 0; q < h.size(); ++q) {
      const Eigen::MatrixXcd off = htf_at(again, frames, static_cast<double>(q + 1) / finest, o.harmonics) - h[q];
      for (Index i = 0; i < off.size(); ++i) squares[q][at(i)].push_back(std::norm(off(i)));
    }
  }
  std::vector<double> strength(at(h[0].cols()), 0.0);  // (coordinates) of H_0 over its standard errors, mean square
  std::vector<RhythmHtf> list;
  for (std::size_t q = 0; q < h.size(); ++q) {
    for (Index m = 0; m < h[q].rows(); ++m) {
      for (Index c = 0; c < h[q].cols(); ++c) {
        const double sigma = sigma_of(squares[q][at(c * h[q].rows() + m)], true);
        list.push_back(
            {static_cast<int>(m) - o.harmonics, static_cast<double>(q + 1) / finest, at(c), h[q](m, c), sigma});
        if (m != o.harmonics || !(sigma > 0.0)) continue;
        strength[at(c)] += std::norm(h[q](m, c)) / (sigma * sigma) / static_cast<double>(h.size());
      }
    }
  }
  const double best = *std::max_element(strength.begin(), strength.end());
  if (!(best > 4.0)) {
    r.refusal = format(
        "the %.3g %s by which the input deviates on its own (%.0f %% of its deviations) are answered by nothing "
        "that stands out of the scatter: H_0 is %.1f standard errors; add a larger stimulus, or record more cycles",
        deviation * std::sqrt(1.0 - r.told), unit.c_str(), 100.0 * (1.0 - r.told), std::sqrt(best));
    return;
  }
  r.htf = std::move(list);
}

}  // namespace

Rhythm identify_rhythm(const Record& record, const RhythmOptions& o, Layout* kept) {
  Rhythm r;
  MatrixXd noise;
  VectorXd count;
  Layout unkept;
  Layout& layout = kept != nullptr ? *kept : unkept;
  layout.passages = (o.kinematic ? find_turns : find_passages)(record, o, noise, count, r);
  const Passages& w = layout.passages;
  const int N = w.sections();

  // The cycle.
  r.experiments = static_cast<int>(experiments(record).size());
  for (const int c : w.order)
    r.charts.push_back(c >= 0 && !w.plane && !record.chart_names.empty() ? record.chart_names[at(c)] : "");
  std::vector<double> periods;
  std::vector<std::vector<double>> phase(static_cast<std::size_t>(N));
  for (const Visit& v : w.visits) {
    if (v.chart != w.order.front() || v.previous < 0) continue;
    const Visit* last = &v;
    for (std::size_t c = 1; c < w.order.size() && last != nullptr; ++c)
      last = last->next < 0 ? nullptr : &w.visits[static_cast<std::size_t>(last->next)];
    if (last == nullptr || last->next < 0) continue;
    periods.push_back(last->end - v.begin);
    const Visit* now = &v;
    for (std::size_t c = 0; c < w.order.size(); ++c) {
      for (std::size_t j = 0; j < now->when.size(); ++j) {
        if (std::isfinite(now->when[j]))
          phase[at(w.place(*now)) + j].push_back((now->when[j] - v.begin) / periods.back());
      }
      now = now->next < 0 ? now : &w.visits[static_cast<std::size_t>(now->next)];
    }
  }
  r.cycles = static_cast<int>(periods.size());
  for (const double x : periods) r.period += x / static_cast<double>(periods.size());
  for (const double x : periods) r.period_scatter += (x - r.period) * (x - r.period) / std::max(1.0, r.cycles - 1.0);
  r.period_scatter = std::sqrt(r.period_scatter);

  std::vector<VectorXd>& noises = layout.noise;
  for (int s = 0; s < N; ++s) {
    RhythmSection section;
    section.chart = r.charts[static_cast<std::size_t>(s / w.per_chart)];
    section.output = record.outputs[w.plane ? w.plane->output : w.phase].name;
    section.level = w.level[static_cast<std::size_t>(s)];
    section.passages = static_cast<int>(count[s]);
    section.phase = phase[at(s)].empty() ? std::nan("") : median(phase[at(s)]);
    VectorXd mean = VectorXd::Zero(w.dim), square = mean;
    for (const Visit& v : w.visits) {
      if (w.place(v) != s - s % w.per_chart || v.x.empty() || v.x[at(s % w.per_chart)].size() == 0) continue;
      mean += v.x[at(s % w.per_chart)] / count[s];
    }
    for (const Visit& v : w.visits) {
      if (w.place(v) != s - s % w.per_chart || v.x.empty() || v.x[at(s % w.per_chart)].size() == 0) continue;
      square += (v.x[at(s % w.per_chart)] - mean).cwiseAbs2() / std::max(1.0, count[s] - 1.0);
    }
    const VectorXd scatter = square.cwiseSqrt();
    // Never smaller than rounding.
    const VectorXd own = (noise.row(s).transpose() / std::max(1.0, count[s]))
                             .cwiseSqrt()
                             .cwiseMax(1e-9 * (mean.cwiseAbs() + scatter))
                             .cwiseMax(1e-300);
    noises.push_back(own);
    section.mean.assign(mean.data(), mean.data() + w.dim);
    section.scatter.assign(scatter.data(), scatter.data() + w.dim);
    section.noise.assign(own.data(), own.data() + w.dim);
    r.sections.push_back(std::move(section));
  }

  // From each section but a chart's first, whose instrument lies beyond an event, to the same of the next chart.
  std::vector<Frame>& frames = layout.frames;
  r.directions = static_cast<int>(w.dim);
  for (int s = 0; s < N; ++s) {
    const Pairs p = pairs_of(w, s, 1);
    if (p.x.rows() < static_cast<Index>(fewest_rows)) {
      throw RecordError(record.name,
                        "only " + std::to_string(p.x.rows()) + " passages of a section are followed by another",
                        "record more cycles; it takes a dozen of each step");
    }
    frames.push_back(frame_of(p, noises[at(s)], noises[at((s + N - 1) % N)]));
    if (s % w.per_chart > 0) r.directions = std::min(r.directions, frames.back().directions);
  }
  if (r.directions == 0) {
    r.refusal = "the passages scatter by no more than locating them does";
    r.notes.push_back("Every cycle is the same within the sensors' noise: nothing tells how deviations decay.");
    return r;
  }
  add_multipliers(layout, o, r);
  add_htf(w, frames, o, r);
  return r;
}

}  // namespace saltus
