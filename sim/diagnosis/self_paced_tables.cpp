// The tables of a diagnosis of a record that no clock paces.
#include <algorithm>
#include <cmath>
#include <limits>

#include "../format.hpp"
#include "self_paced.hpp"

namespace saltus::diagnosis {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

}  // namespace

void list_parameters(Diagnosis& d, const Work& w, const Found& f) {
  const Machine& machine = *w.p.machine;
  for (std::size_t k = 0; k < machine.declared; ++k) {
    const Coefficient& c = machine.coefficients[k];
    if (c.candidate) continue;
    const Fit& last_fit = d.effects.empty() ? f.all_refit : f.all.fit;
    const auto error_of = [&](const Fit& g, const Eigen::VectorXd& sigma) {
      const auto at = std::find(g.free.begin(), g.free.end(), static_cast<int>(k));
      return at == g.free.end() ? 0.0 : sigma[at - g.free.begin()];
    };
    d.parameters.push_back({c.name, c.unit, c.nominal, w.p.tolerance[k], f.all_refit.values[k],
                            error_of(f.all_refit, f.refit_error), last_fit.values[k],
                            error_of(last_fit, d.effects.empty() ? f.refit_error : f.error)});
    const double off = (last_fit.values[k] - c.nominal) / std::max(1e-300, w.p.tolerance[k]);
    if (w.p.tolerance[k] > 0.0 && std::abs(off) > 3.0) {
      d.notes.push_back("Parameter " + c.name + " lies " + text(std::abs(off), "%.1f") +
                        " tolerances from its declared value: " + text(last_fit.values[k], "%.5g") + " " + c.unit +
                        " instead of " + text(c.nominal, "%.5g") + ".");
    }
  }
}

void list_candidates(Diagnosis& d, const Work& w, const Found& f) {
  const Machine& machine = *w.p.machine;
  for (std::size_t i = 0; i < f.before.candidate.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const int c = f.before.candidate[i];
    CandidateRow row{name_of(machine, c),
                     machine.coefficients[static_cast<std::size_t>(c)].unit,
                     f.before.z[k],
                     f.before.value[k],
                     nan,
                     nan,
                     f.before.kept[k],
                     0.0,
                     {},
                     ""};
    if (const auto t = f.alone.find(c); t != f.alone.end()) {
      row.bic = t->second.first;
      row.value = t->second.second;
    }
    if (!(f.before.error[k] > 0.0)) {
      row.remark = "leaves no trace to first order";
    } else if (!f.before.usable(k)) {
      row.remark = "unidentifiable while " + f.before.imitated_by[i] + " is free";
    } else {
      row.limit = (d.threshold + power_95) * f.before.error[k];
    }
    const auto j = f.left.find(c);
    const auto at = static_cast<std::size_t>(c);
    if (j >= 0 && f.left.usable(j) && std::abs(f.left.z[j]) > d.threshold &&
        f.part.fit.values[at] + f.left.value[j] < lower_bound(machine.coefficients[at])) {
      row.remark = "what is left asks for an unphysical sign";
      d.notes.push_back(row.name + ": what is left would be smaller with " + text(f.left.value[j]) + " " + row.unit +
                        " (score " + text(f.left.z[j], "%.1f") +
                        "), a sign that makes no physical sense. Not taken; the model errs in some other way there.");
    }
    d.candidates.push_back(std::move(row));
  }
  std::sort(d.candidates.begin(), d.candidates.end(), [](const CandidateRow& a, const CandidateRow& b) {
    const bool ua = a.limit > 0.0, ub = b.limit > 0.0;
    return ua != ub ? ua : std::abs(a.z) > std::abs(b.z);
  });
}

}  // namespace saltus::diagnosis
