// The part of the search that asks last: for a force that repeats with the cycle. It has a size and a phase, moves the
// mean cycle and hardly the response to stimuli, and fits beside almost any law; so it is no cause while a law is one.
#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

#include "diagnosis.hpp"
#include "search.hpp"
#include "sets.hpp"

namespace saltus::diagnosis {
namespace {

std::vector<int> coefficients_of(const std::vector<Search::Repeating>& forces) {
  std::vector<int> r;
  for (const auto& f : forces) r.insert(r.end(), {f.cosine, f.sine});
  return r;
}

}  // namespace

// From f, moved by a force along cosine and sine [unit of the force].
void Search::fit_force(const Repeating& r, Fit f, const Eigen::Vector2d& force) {
  constexpr int most_rounds = 4;
  const std::vector<int> set = with({r.cosine}, r.sine);
  f.values[static_cast<std::size_t>(r.cosine)] += force[0];
  f.values[static_cast<std::size_t>(r.sine)] += force[1];
  f.converged = false;
  for (int round = 0; round < most_rounds && !f.converged; ++round) f = fit(p_, segments_, f, set);
  store({set, f, 0.0, true});
  forces_.insert(set);
}

void Search::ask(const std::vector<Repeating>& forces) {
  constexpr double worth = 0.3;  // [-] of what is left, to first order
  // Where the parameters strayed to imitate it the way back may be barred: then from the declared ones too.
  std::vector<Fit> from{base().fit};
  if (strayed()) from.push_back(declared_);
  for (std::size_t k = 0; k < from.size(); ++k) {
    const Evidence e = weigh(p_, segments_, from[k], signatures(p_, segments_, from[k], coefficients_of(forces)));
    const double left = std::max(from[k].chi2 - samples_, base_gate_.worst_z * base_gate_.worst_z);
    for (const Repeating& r : forces) {
      const auto i = e.find(r.cosine), j = e.find(r.sine);
      if (!e.usable(i) || !e.usable(j)) continue;
      const Eigen::Vector2d score(e.score[i], e.score[j]), force = e.information_of(i, j).ldlt().solve(score);
      const double gain = force.dot(score);
      if (k == 0) {
        asked_.push_back(
            {r.cosine, r.sine, std::sqrt(std::max(0.0, gain)), force.norm(), std::min(e.kept[i], e.kept[j])});
      }
      if (gain > worth * left) fit_force(r, from[k], force);
    }
  }
}

std::vector<Search::Swap> Search::swap_for_force(const Trial& t, const std::vector<Repeating>& forces) {
  constexpr double far = 100.0;  // [-] of chi^2 more, to first order
  std::vector<Swap> swaps;
  const int effect = t.effects[0];
  const double nominal = p_.machine->coefficients[static_cast<std::size_t>(effect)].nominal,
               size = t.fit.values[static_cast<std::size_t>(effect)] - nominal;
  Fit without_it = with_fixed(t.fit, effect);
  const Evidence e =
      weigh(p_, segments_, without_it, released(signatures(p_, segments_, t.fit, coefficients_of(forces)), effect));
  const auto own = e.find(effect);
  without_it.values[static_cast<std::size_t>(effect)] = nominal;
  for (const Repeating& r : forces) {
    const auto i = e.find(r.cosine), j = e.find(r.sine);
    if (!e.usable(own) || !e.usable(i) || !e.usable(j)) continue;
    const Eigen::Vector2d across(e.information(own, i), e.information(own, j)),
        force = e.information_of(i, j).ldlt().solve(across) * size;
    const double done = size * size * e.information(own, own), alike = size * force.dot(across);
    if (done - alike > far) continue;
    swaps.push_back({effect, r.cosine, std::sqrt(std::clamp(alike / done, 0.0, 1.0))});
    fit_force(r, without_it, force);
  }
  return swaps;
}

const Trial* Search::force() const {
  const Trial* best = nullptr;
  for (const auto& set : forces_) {
    const Trial& t = pool_.at(set);
    if (best == nullptr || t.bic < best->bic) best = &t;
  }
  if (best == nullptr) return nullptr;
  // A mean cycle told less clearly has no shape that other forces could not have.
  const bool clear = base().fit.cost() - best->fit.cost() > inflation_ * shaped * shaped;
  return clear && size_of_force(*best).low > 0.0 && passes(best->fit) ? best : nullptr;
}

// By the slope of the size along cosine and sine: a force that was found is many standard errors from none.
Search::Interval Search::size_of_force(const Trial& t) const {
  const auto at = [&](std::size_t k) {
    return std::find(t.fit.free.begin(), t.fit.free.end(), t.effects[k]) - t.fit.free.begin();
  };
  const auto i = at(0), j = at(1);
  const Eigen::Vector2d force(t.fit.values[static_cast<std::size_t>(t.effects[0])],
                              t.fit.values[static_cast<std::size_t>(t.effects[1])]);
  Eigen::Matrix2d covariance;
  covariance << t.fit.covariance(i, i), t.fit.covariance(i, j), t.fit.covariance(j, i), t.fit.covariance(j, j);
  const Eigen::Vector2d slope = force.normalized();
  const double sigma = std::sqrt(slope.dot(covariance * slope) * std::max(p_.data->colour, inflation_));
  return {std::max(0.0, force.norm() - wide_95 * sigma), force.norm() + wide_95 * sigma, sigma};
}

}  // namespace saltus::diagnosis
