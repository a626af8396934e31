#include "selection.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

#include "core/trace/statistics.hpp"
#include "sets.hpp"

namespace saltus::diagnosis {
namespace {

constexpr std::size_t most_effects = 4;
constexpr double much_better = 0.75;  // [-] of the error before
// An effect that predicts hardly better is not claimed: [-] of the error before. What dissipates is in every machine;
// where the model errs by more than noise anything else may make up for what no law does, a sensor's most easily.
constexpr double enough_better = 0.93;
constexpr double enough_else = 0.8;
constexpr double enough_of_sensor = 0.7;
constexpr double noise_like = 1.2;     // [-] of the sensors' noise
constexpr double nearly_white = 1.15;  // [-] samples to an independent number

// Mean square of the residual in units of the sensors' noise, and in how many independent numbers it comes: the sum of
// its correlation up to where that vanishes says how many samples make one. One scale for all outputs: what is left is
// the model's error, seen by each sensor as well as it sees.
void measure(const Problem& p, const std::vector<int>& segments, const Eigen::VectorXd& sensors, Attempt& a) {
  const Data& data = *p.data;
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  const auto r = residuals(p, segments, a.fit);
  std::vector<Eigen::VectorXd> e;
  double squares = 0.0, n = 0.0;
  Eigen::Index longest = 0;
  for (const int s : segments) {
    e.push_back(r[static_cast<std::size_t>(s)]);
    const auto& w = data.segments[static_cast<std::size_t>(s)].count;
    for (Eigen::Index i = 0; i < e.back().size(); ++i) {
      e.back()[i] *= std::sqrt(w[i]) / sensors[i % ny];
      n += w[i];
    }
    squares += e.back().squaredNorm();
    longest = std::max(longest, e.back().size() / ny);
  }
  double together = 1.0;
  for (Eigen::Index lag = 1; lag < longest && squares > 0.0; ++lag) {
    double product = 0.0;
    for (const Eigen::VectorXd& x : e) {
      if (x.size() > lag * ny) product += x.head(x.size() - lag * ny).dot(x.tail(x.size() - lag * ny));
    }
    if (product < 0.05 * squares) break;
    together += 2.0 * product / squares;
  }
  a.scale = std::max(squares / std::max(1.0, n), 1e-300);
  a.independent = std::max(1.0, n / together);
  a.noise = sensors * std::sqrt(a.scale * together);
  a.quiet = a.scale < noise_like * noise_like && together < nearly_white;
}

}  // namespace

Selection::Selection(const Problem& p, Data& data, std::vector<int> segments, std::vector<int> blocks,
                     std::vector<int> candidates, double false_alarm)
    : p_(p),
      data_(data),
      segments_(std::move(segments)),
      blocks_(std::move(blocks)),
      candidates_(std::move(candidates)) {
  threshold_ = largest_of(std::max(1, static_cast<int>(candidates_.size())), false_alarm);
  sensors_ = data.noise;
}

bool Selection::refinable(const std::vector<int>& effects, int coefficient) const {
  const auto& all = p_.machine->coefficients;
  const std::string& plain = all[static_cast<std::size_t>(coefficient)].refines;
  const auto named = [&](int c) { return all[static_cast<std::size_t>(c)].name == plain; };
  return plain.empty() || std::any_of(effects.begin(), effects.end(), named) ||
         std::none_of(candidates_.begin(), candidates_.end(), named);
}

double Selection::cost(const Attempt& a, const Attempt& like) const {
  return a.fit.penalty + like.independent * std::log(a.scale);
}
double Selection::bic(const Attempt& a, const Attempt& like) const {
  return cost(a, like) + static_cast<double>(a.effects.size()) * std::log(std::max(2.0, like.independent));
}

const Attempt& Selection::attempt(const std::vector<int>& effects, const Fit& from, const Eigen::VectorXd& noise,
                                  bool brief) {
  if (const auto it = pool_.find(effects); it != pool_.end() && (brief || !it->second.brief)) return it->second;
  Attempt a{effects, from, 1.0, 1.0, noise, brief};
  for (int round = 0; round < (brief ? 1 : 4); ++round) {
    const Eigen::VectorXd before = a.noise;
    data_.noise = a.noise;
    FitOptions o;
    o.iterations = brief ? 8 : round == 0 ? 30 : 10;
    o.enough = brief ? 1.0 : 0.3;
    a.fit = fit(p_, segments_, a.fit, effects, o);
    // The start of the fit cannot be run, or its end cannot be: as if it explained nothing.
    if (!std::isfinite(a.fit.chi2) || !sensible(*p_.machine, a.fit)) {
      a.scale = 1e100;
      break;
    }
    measure(p_, segments_, sensors_, a);
    if (((a.noise - before).cwiseAbs().array() < 0.1 * before.array()).all()) break;
  }
  return pool_.insert_or_assign(effects, std::move(a)).first->second;
}

Evidence Selection::evidence_of(const Attempt& a) const {
  data_.noise = a.noise;
  return evidence(p_, segments_, a.fit, candidates_);
}

void Selection::baseline(const Fit& declared) {
  attempt({}, declared, data_.noise);
  result_ = {};
  reweigh();
  base_evidence_ = evidence_of(base());
}

// Stretches that disagree count less, as if their errors were Student's: an unstable machine, or one that something
// else moves, is now and then far off. Then the result and the baseline once more.
void Selection::reweigh() {
  constexpr double degrees = 5.0;
  Attempt a = pool_.at(result_);
  const auto r = residuals(p_, segments_, a.fit);
  const auto ny = static_cast<Eigen::Index>(data_.outputs());
  for (int round = 0; round < 6; ++round) {
    measure(p_, segments_, sensors_, a);
    for (const int s : segments_) {
      Segment& g = data_.segments[static_cast<std::size_t>(s)];
      const auto& e = r[static_cast<std::size_t>(s)];
      double far = 0.0, n = 0.0;
      for (Eigen::Index i = 0; i < e.size(); ++i) {
        far += e[i] * e[i] / (a.scale * sensors_[i % ny] * sensors_[i % ny]);
        n += g.count[i] > 0.0;
      }
      const double w = std::min(1.0, (degrees + 1.0) / (degrees + far / std::max(1.0, n)));
      for (Eigen::Index i = 0; i < e.size(); ++i) g.count[i] = g.count[i] > 0.0 ? w : 0.0;
    }
  }
  const Attempt b = base();
  pool_.clear();
  left_out_.clear();
  attempt(a.effects, a.fit, a.noise);
  if (!a.effects.empty()) attempt({}, b.fit, b.noise);
}

const std::vector<double>& Selection::left_out(const Attempt& a) {
  if (const auto it = left_out_.find(a.effects); it != left_out_.end()) return it->second;
  const int parts = *std::max_element(blocks_.begin(), blocks_.end()) + 1;
  std::vector<double> sums(static_cast<std::size_t>(parts), 0.0);
  data_.noise = a.noise;
  const auto ny = static_cast<Eigen::Index>(data_.outputs());
  for (int part = 0; part < parts; ++part) {
    std::vector<int> kept, gone;
    for (std::size_t i = 0; i < segments_.size(); ++i) (blocks_[i] == part ? gone : kept).push_back(segments_[i]);
    const Fit f = fit(p_, kept, a.fit, a.effects, {.iterations = 4, .enough = 0.5});
    const Fit g = fit(p_, gone, f, {}, {.refit_parameters = false, .iterations = 4, .enough = 0.5});
    const auto r = residuals(p_, gone, g);
    for (const int s : gone) {
      const auto& e = r[static_cast<std::size_t>(s)];
      for (Eigen::Index i = 0; i < e.size(); ++i) {
        sums[static_cast<std::size_t>(part)] +=
            data_.segments[static_cast<std::size_t>(s)].count[i] * e[i] * e[i] / (sensors_[i % ny] * sensors_[i % ny]);
      }
    }
  }
  return left_out_.emplace(a.effects, std::move(sums)).first->second;
}

Trial1 Selection::examine(const Attempt& more, const Attempt& less, int effect) {
  Trial1 t;
  t.effect = effect;
  t.beside = less.effects;
  t.gain = cost(less, more) - cost(more, more);
  const double careful = cost(less, less) - cost(more, less);  // with the numbers that the worse residual has
  t.gain = std::min(t.gain, careful);
  const auto& a = left_out(more);
  const auto& b = left_out(less);
  // Each part counts alike, by its ratio: where the machine is unstable errors are larger by orders.
  double ratio = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    ratio += std::log(std::max(1e-300, a[i]) / std::max(1e-300, b[i])) / static_cast<double>(a.size());
    t.better += a[i] < b[i];
  }
  t.parts = static_cast<int>(a.size());
  t.quiet = more.quiet;
  t.predicted = std::exp(0.5 * ratio);
  t.trifle = refines_a_trifle(more, effect);
  return t;
}

// A hundredth of a friction more at rest is how a law is written, not what a machine has.
bool Selection::refines_a_trifle(const Attempt& a, int effect) const {
  constexpr double trifle = 0.05;  // [-] of what it refines
  const auto& all = p_.machine->coefficients;
  for (const int o : a.effects) {
    if (all[static_cast<std::size_t>(o)].name != all[static_cast<std::size_t>(effect)].refines) continue;
    return std::abs(a.fit.values[static_cast<std::size_t>(effect)]) <
           trifle * std::abs(a.fit.values[static_cast<std::size_t>(o)]);
  }
  return false;
}

// The more is found already the more it takes: every further search is one more chance to be misled.
double Selection::bar(std::size_t beside) const {
  return threshold_ * threshold_ * (1.0 + 0.5 * static_cast<double>(beside));
}
bool Selection::convincing(const Trial1& t) const {
  const bool everywhere = t.better == t.parts;
  const bool plain = t.predicted < much_better && everywhere;  // every part says so, and loudly
  // Where noise is nearly all there is, an error cannot fall by much; but there likelihoods are what they claim to be.
  const Coefficient& c = p_.machine->coefficients[static_cast<std::size_t>(t.effect)];
  const bool dissipates = c.physical > 0 && !c.shifts_time;
  const double less = c.of_sensor() ? enough_of_sensor : dissipates ? enough_better : enough_else;
  const bool enough = t.predicted < (t.quiet ? 1.0 : less);
  const bool mostly = t.quiet ? 4 * t.better >= 3 * t.parts : 2 * t.better > t.parts;
  return t.gain > bar(plain ? 0 : t.beside.size()) && enough && mostly && !t.trifle;
}

const Attempt& Selection::run(const std::function<void(double)>& progress, const FreeRunRatio& free_run) {
  const auto value_at = [&](int c, double estimate) {
    return p_.machine->coefficients[static_cast<std::size_t>(c)].nominal + estimate;
  };
  for (std::size_t size = 0; size < most_effects; ++size) {
    const Attempt current = pool_.at(result_);
    const Evidence e = size == 0 ? base_evidence_ : evidence_of(current);
    struct Lead {
      int c;
      double estimate, z;
    };
    std::vector<Lead> leads;
    for (std::size_t i = 0; i < e.candidate.size(); ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      const int c = e.candidate[i];
      if (!e.usable(k) || !may_change(*p_.machine, c, e.value[k]) || has(current.effects, c) || std::abs(e.z[k]) < 2.0)
        continue;
      if (!refinable(current.effects, c)) continue;
      leads.push_back({c, e.value[k], std::abs(e.z[k])});
    }
    std::sort(leads.begin(), leads.end(), [](const Lead& a, const Lead& b) { return a.z > b.z; });
    if (leads.size() > (size == 0 ? 5 : 4)) leads.resize(size == 0 ? 5 : 4);
    std::vector<std::pair<double, int>> order;  // cost with it, effect
    for (std::size_t i = 0; i < leads.size(); ++i) {
      Fit f = current.fit;
      f.values[static_cast<std::size_t>(leads[i].c)] = value_at(leads[i].c, leads[i].estimate);
      const Attempt& a = attempt(with(current.effects, leads[i].c), f, current.noise, true);
      order.emplace_back(cost(a, current), leads[i].c);
      if (size == 0)
        alone_[leads[i].c] = {bic(a, current) - bic(current, current),
                              a.fit.values[static_cast<std::size_t>(leads[i].c)]};
      progress(0.1 + 0.15 * (static_cast<double>(size) + static_cast<double>(i) / static_cast<double>(leads.size())));
    }
    std::sort(order.begin(), order.end());
    // The best few, each once: exact twins cost the same.
    std::vector<int> best;
    for (std::size_t i = 0; i < order.size() && best.size() < (size == 0 ? 3u : 2u); ++i) {
      if (i == 0 || order[i].first - order[i - 1].first > 1e-3) best.push_back(order[i].second);
    }
    bool added = false;
    for (std::size_t i = 0; i < best.size() && !added; ++i) {
      const Attempt first = pool_.at(with(current.effects, best[i]));
      const Attempt more = attempt(first.effects, first.fit, first.noise);
      if (cost(current, current) - cost(more, current) < bar(0)) break;
      Trial1 t = examine(more, current, best[i]);
      t.taken = convincing(t);
      account_.push_back(t);
      if (!t.taken) continue;
      result_ = more.effects;
      added = true;
      if (free_run)
        prefer_by_free_runs(free_run, current,
                            std::vector<int>(best.begin() + static_cast<std::ptrdiff_t>(i) + 1, best.end()));
    }
    // Two effects may hide each other: neither alone predicts, but each does beside the other.
    for (std::size_t i = 0; i < best.size() && !added && size == 0; ++i) added = take_pair(best[i]);
    if (!added && result_.size() == 1) added = take_pair_instead();
    if (!added) break;
    reweigh();
    // What the new one makes superfluous goes.
    for (bool again = true; again && result_.size() > 1;) {
      again = false;
      for (const int old : result_) {
        if (old == account_.back().effect) continue;
        const Attempt now = pool_.at(result_);
        Fit f = now.fit;
        f.values[static_cast<std::size_t>(old)] = p_.machine->coefficients[static_cast<std::size_t>(old)].nominal;
        const Attempt& less = attempt(without(result_, old), f, now.noise);
        if (cost(less, now) - cost(now, now) < threshold_ * threshold_) {
          result_ = less.effects;
          again = true;
          break;
        }
      }
    }
  }
  return result();
}

void Selection::retract(int effect) {
  for (Trial1& t : account_) t.taken = t.taken && t.effect != effect;
}

const Attempt& Selection::drop(int effect) {
  const Attempt now = result();
  Fit f = now.fit;
  f.values[static_cast<std::size_t>(effect)] = p_.machine->coefficients[static_cast<std::size_t>(effect)].nominal;
  result_ = without(result_, effect);
  retract(effect);
  return attempt(result_, f, now.noise);
}

const Attempt& Selection::adopt(const Attempt& a) {
  const Attempt copy = a;
  Fit plain = a.fit;
  for (const int e : a.effects) {
    plain.values[static_cast<std::size_t>(e)] = p_.machine->coefficients[static_cast<std::size_t>(e)].nominal;
  }
  pool_.clear();
  attempt({}, plain, copy.noise);
  attempt(copy.effects, copy.fit, copy.noise);
  result_ = copy.effects;
  reweigh();
  return result();
}

Eigen::VectorXd Selection::errors(const Attempt& a) const {
  data_.noise = a.noise;
  const Signatures s = signatures(p_, segments_, a.fit, {});
  const auto n = static_cast<Eigen::Index>(s.nuisance.size());
  Eigen::MatrixXd H = s.N.transpose() * s.N, meat = Eigen::MatrixXd::Zero(n, n);
  for (std::size_t j = 0; j < s.offset.size(); ++j) {
    const Eigen::Index end = j + 1 < s.offset.size() ? s.offset[j + 1] : s.N.rows();
    const auto part = Eigen::seqN(s.offset[j], end - s.offset[j]);
    const Eigen::VectorXd g = s.N(part, Eigen::all).transpose() * s.r(part);
    meat += g * g.transpose();
  }
  const double k = static_cast<double>(s.offset.size());
  meat *= k / std::max(1.0, k - 1.0);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto c = static_cast<std::size_t>(s.nuisance[static_cast<std::size_t>(i)]);
    if (c >= p_.tolerance.size() || !(p_.tolerance[c] > 0.0)) continue;
    const double prior = 1.0 / (p_.tolerance[c] * p_.tolerance[c]);
    H(i, i) += prior;
    meat(i, i) += prior;
  }
  const Eigen::VectorXd d = H.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd inverse =
      Eigen::LDLT<Eigen::MatrixXd>(d.asDiagonal() * H * d.asDiagonal()).solve(Eigen::MatrixXd::Identity(n, n));
  const Eigen::MatrixXd covariance = inverse * (d.asDiagonal() * meat * d.asDiagonal()) * inverse;
  return d.cwiseProduct(covariance.diagonal().cwiseMax(0.0).cwiseSqrt());
}

}  // namespace saltus::diagnosis
