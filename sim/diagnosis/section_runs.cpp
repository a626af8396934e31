#include "section_runs.hpp"

#include <algorithm>
#include <cmath>

#include "../format.hpp"
#include "journeys.hpp"

namespace saltus::diagnosis {
namespace {

using namespace rhythm;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Index = Eigen::Index;

constexpr Index fewest_runs = 12;

// Pairs of the record and of the model, row by row of the same passages.
struct Both {
  Pairs measured, model;
  std::vector<double> late;  // [s]
  int lost = 0;
};

Pairs rows_of(const Pairs& p, const std::vector<Index>& rows) {
  Pairs r;
  const auto n = static_cast<Index>(rows.size());
  r.x.resize(n, p.x.cols());
  r.y.resize(n, p.y.cols());
  r.z.resize(n, p.z.cols());
  r.u.resize(n);
  for (Index i = 0; i < n; ++i) {
    const Index k = rows[static_cast<std::size_t>(i)];
    r.x.row(i) = p.x.row(k);
    r.y.row(i) = p.y.row(k);
    r.z.row(i) = p.z.row(k);
    r.u[i] = p.u[k];
    r.visit.push_back(p.visit[static_cast<std::size_t>(k)]);
  }
  return r;
}

Both both_of(const Passages& w, const std::vector<std::vector<Journey>>& journeys, int section, int ahead) {
  const auto j = static_cast<std::size_t>(section % w.per_chart);
  const Pairs all = pairs_of(w, section, ahead);
  std::vector<Index> rows;
  std::vector<const Journey*> kept;
  Both r;
  for (std::size_t i = 0; i < all.visit.size(); ++i) {
    const auto visit = static_cast<std::size_t>(all.visit[i]);
    const Journey& one = journeys[visit][j];
    if (one.x.size() == 0 || (ahead == 1 ? one.next : one.step).size() == 0) {
      ++r.lost;
      continue;
    }
    rows.push_back(static_cast<Index>(i));
    kept.push_back(&one);
    if (ahead != 1) continue;
    const Visit& v = w.visits[visit];
    const Place next = from_here(w, v, static_cast<int>(j), 1);
    r.late.push_back(one.lasted - (next.visit->when[static_cast<std::size_t>(next.j)] - v.when[j]));
  }
  r.measured = r.model = rows_of(all, rows);
  for (std::size_t i = 0; i < kept.size(); ++i) {
    r.model.x.row(static_cast<Index>(i)) = kept[i]->x.transpose();
    r.model.y.row(static_cast<Index>(i)) = (ahead == 1 ? kept[i]->next : kept[i]->step).transpose();
  }
  return r;
}

double mean_of(const std::vector<double>& v) {
  double m = 0.0;
  for (const double x : v) m += x / static_cast<double>(v.size());
  return m;
}
// Of the mean.
double error_of_mean(const std::vector<double>& v) {
  const double m = mean_of(v), n = static_cast<double>(v.size());
  double square = 0.0;
  for (const double x : v) square += (x - m) * (x - m);
  return std::sqrt(square / std::max(1.0, n * (n - 1.0)));
}

bool enough(const Pairs& p, int directions) { return p.x.rows() >= std::max<Index>(fewest_runs, 3 * directions); }

SectionBeside section_beside(const Layout& layout, const std::vector<std::vector<Journey>>& journeys, int section,
                             int directions, const RhythmOptions& o) {
  const Passages& w = layout.passages;
  const Both both = both_of(w, journeys, section, 1);
  SectionBeside r;
  r.section = section;
  r.next = (section + 1) % w.sections();
  r.runs = static_cast<int>(both.measured.x.rows());
  r.lost = both.lost;
  if (r.runs < 2) return r;
  r.late = mean_of(both.late);
  r.late_sigma = error_of_mean(both.late);
  for (Index c = 0; c < w.dim; ++c) {
    const VectorXd off = both.measured.y.col(c) - both.model.y.col(c);
    const std::vector<double> each(off.data(), off.data() + off.size());
    r.error.push_back(off.norm() / std::sqrt(static_cast<double>(r.runs)));
    r.bias.push_back(mean_of(each));
    r.bias_sigma.push_back(error_of_mean(each));
    const VectorXd y = both.measured.y.col(c);
    r.scatter.push_back(error_of_mean({y.data(), y.data() + y.size()}) * std::sqrt(static_cast<double>(r.runs)));
  }
  if (directions == 0 || !enough(both.measured, directions)) return r;
  const Frame& here = layout.frames[static_cast<std::size_t>(section)];
  const Frame& there = layout.frames[static_cast<std::size_t>(r.next)];
  const auto n = w.visits.size();
  const Index k = directions;
  const VectorXd one = VectorXd::Ones(static_cast<Index>(n));
  const MatrixXd measured = map_of(both.measured, here, there, k, one), model = map_of(both.model, here, there, k, one);
  const auto in_units = [&](const MatrixXd& m) -> MatrixXd { return there.out.leftCols(k) * m * here.in.topRows(k); };
  r.measured = in_units(measured);
  r.model = in_units(model);
  std::vector<std::vector<double>> told(static_cast<std::size_t>(k * k)),
      coordinate(static_cast<std::size_t>(w.dim * w.dim));
  Random random(o.seed + 2);
  for (int replicate = 0; replicate < o.replicates; ++replicate) {
    const VectorXd weight = drawn(n, random);
    const MatrixXd off =
        map_of(both.measured, here, there, k, weight) - map_of(both.model, here, there, k, weight) - (measured - model);
    const MatrixXd off_in_units = in_units(off);
    if (!off.allFinite()) continue;
    for (Index i = 0; i < off.size(); ++i) told[static_cast<std::size_t>(i)].push_back(off(i) * off(i));
    for (Index i = 0; i < off_in_units.size(); ++i)
      coordinate[static_cast<std::size_t>(i)].push_back(off_in_units(i) * off_in_units(i));
  }
  r.sigma.resize(w.dim, w.dim);
  for (Index i = 0; i < r.sigma.size(); ++i) r.sigma(i) = sigma_of(coordinate[static_cast<std::size_t>(i)], false);
  for (Index i = 0; i < measured.size(); ++i) {
    const double z = (measured(i) - model(i)) / std::max(1e-300, sigma_of(told[static_cast<std::size_t>(i)], false));
    r.off += z * z / static_cast<double>(measured.size());
    r.worst = std::max(r.worst, std::abs(z));
  }
  r.off = std::sqrt(r.off);
  return r;
}

void add_multipliers(const Layout& layout, const std::vector<std::vector<Journey>>& journeys, const Rhythm& rhythm,
                     const RhythmOptions& o, RhythmBeside& r) {
  const Passages& w = layout.passages;
  std::vector<Complex> like;
  for (const RhythmMultiplier& m : rhythm.multipliers) like.push_back(m.value);
  std::vector<std::vector<Pairs>> measured, model;
  std::vector<std::vector<Frame>> frames;
  for (int j = 1; j < w.per_chart; ++j) {
    frames.push_back(frames_at(layout, j));
    measured.emplace_back();
    model.emplace_back();
    for (int c = 0; c < static_cast<int>(w.order.size()); ++c) {
      const Both both = both_of(w, journeys, c * w.per_chart + j, w.per_chart);
      if (!enough(both.model, rhythm.directions)) {
        r.refusal = format("of %d runs from section %d the model makes a whole step in %d",
                           static_cast<int>(both.model.x.rows()) + both.lost, c * w.per_chart + j,
                           static_cast<int>(both.model.x.rows()));
        return;
      }
      measured.back().push_back(both.measured);
      model.back().push_back(both.model);
    }
  }
  const auto n = w.visits.size();
  const VectorXd one = VectorXd::Ones(static_cast<Index>(n));
  auto of_record = multipliers_of_all(measured, frames, rhythm.directions, one);
  auto of_model = multipliers_of_all(model, frames, rhythm.directions, one);
  if (of_record.empty() || of_model.empty()) {
    r.refusal = "its maps cannot be told";
    return;
  }
  of_record = in_order(std::move(of_record), like);
  of_model = in_order(std::move(of_model), of_record);
  const std::vector<double> spread = spread_of(model, frames, of_model, one);
  std::vector<std::vector<double>> own(like.size()), off(like.size());
  Random random(o.seed + 3);
  for (int k = 0; k < o.replicates; ++k) {
    const VectorXd weight = drawn(n, random);
    auto a = multipliers_of_all(measured, frames, rhythm.directions, weight);
    auto b = multipliers_of_all(model, frames, rhythm.directions, weight);
    if (a.empty() || b.empty()) continue;
    a = in_order(std::move(a), of_record);
    b = in_order(std::move(b), of_model);
    for (std::size_t i = 0; i < like.size(); ++i) {
      own[i].push_back(std::norm(b[i] - of_model[i]));
      off[i].push_back(std::norm(a[i] - b[i] - (of_record[i] - of_model[i])));
    }
  }
  for (std::size_t i = 0; i < like.size(); ++i) {
    MultiplierBeside m;
    m.measured = of_record[i];
    m.model = of_model[i];
    const bool turning = std::abs(m.measured.imag()) > 0.0 || std::abs(m.model.imag()) > 0.0;
    m.sigma = std::hypot(sigma_of(own[i], turning), rhythm.directions < static_cast<int>(w.dim) ? spread[i] : 0.0);
    m.off = std::abs(m.measured - m.model) / std::max(1e-300, sigma_of(off[i], turning));
    r.multipliers.push_back(m);
  }
}

}  // namespace

RhythmBeside run_beside(const Layout& layout, const Rhythm& rhythm, const Machine& machine,
                        std::span<const double> values, const RhythmOptions& options) {
  const Passages& w = layout.passages;
  const auto journeys = journeys_of(layout, machine, values);
  RhythmBeside r;
  for (int s = 0; s < w.sections(); ++s)
    r.sections.push_back(section_beside(layout, journeys, s, rhythm.directions, options));
  if (rhythm.directions == 0) {
    r.refusal = "the record tells none";
  } else {
    add_multipliers(layout, journeys, rhythm, options, r);
  }
  return r;
}

}  // namespace saltus::diagnosis
