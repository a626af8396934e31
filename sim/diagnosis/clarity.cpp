// How clearly an effect of one size or another would be seen: of one that changes the charts no straight line tells.
#include <atomic>
#include <cmath>
#include <limits>

#include "runs.hpp"
#include "search.hpp"
#include "side_by_side.hpp"

namespace saltus::diagnosis {

std::vector<Seen> Search::clarity(int coefficient) const {
  constexpr double ratio = 1.5, widest = 30.0;  // [-] from size to size, and from the probe either way
  const auto at = static_cast<std::size_t>(coefficient);
  const Coefficient& c = p_.machine->coefficients[at];
  const Fit& f = base().fit;
  const Signatures& known = signatures_at(f);
  struct Here {
    Eigen::VectorXd weight, y;  // as the baseline has it
    WithoutStart without_start;
  };
  std::vector<Here> here(segments_.size());
  side_by_side(segments_.size(), [&](std::size_t j) {
    const auto k = static_cast<std::size_t>(segments_[j]);
    const Segment& s = p_.data->segments[k];
    const Response y = respond(p_, s, f.values, f.start[k]), slope = sensitivities(p_, s, f.values, f.start[k], {});
    const Eigen::VectorXd w = weights(*p_.data, s);
    const Eigen::Map<const RowMajor> gradient(slope.gradient.data(), s.y.size(), p_.machine->width());
    here[j] = {w, Eigen::Map<const Eigen::VectorXd>(y.y.data(), s.y.size()),
               WithoutStart(s, w.asDiagonal() * gradient.leftCols(p_.machine->starts()))};
  });
  Signatures one{known.nuisance, {coefficient}, known.N, Eigen::MatrixXd(known.N.rows(), 1), known.r, known.offset};
  // In standard errors; not a number where the machine does not follow.
  const auto seen = [&](double size) {
    std::vector<double> values = f.values;
    values[at] = c.nominal + size;
    std::atomic<bool> follows = true;
    side_by_side(segments_.size(), [&](std::size_t j) {
      const auto k = static_cast<std::size_t>(segments_[j]);
      const Segment& s = p_.data->segments[k];
      const Response y = respond(p_, s, values, f.start[k]);
      if (!usable(y.status)) {
        follows = false;
        return;
      }
      const Eigen::VectorXd d = Eigen::Map<const Eigen::VectorXd>(y.y.data(), s.y.size()) - here[j].y;
      one.C.col(0).segment(known.offset[j], s.y.size()) =
          here[j].without_start(Eigen::VectorXd(here[j].weight.cwiseProduct(d) / size));
    });
    if (!follows) return std::numeric_limits<double>::quiet_NaN();
    const Evidence e = weigh(p_, segments_, f, one);
    return e.error[0] > 0.0 ? size / e.error[0] : 0.0;
  };
  const double least = limit_z(), most = 10.0 * least;
  std::vector<Seen> r{{c.probe, seen(c.probe)}};
  if (!std::isfinite(r[0].z)) return {};
  while (r.front().z > 0.5 * least && r.front().size * widest > c.probe) {
    const double size = r.front().size / ratio;
    r.insert(r.begin(), {size, seen(size)});
  }
  while (r.back().z < most && r.back().size < c.probe * widest) {
    const double size = r.back().size * ratio, z = seen(size);
    if (!std::isfinite(z)) break;
    r.push_back({size, z});
  }
  return r;
}

double size_seen(const std::vector<Seen>& curve, double z) {
  if (curve.empty()) return std::numeric_limits<double>::quiet_NaN();
  if (!(curve[0].z < z)) return curve[0].size * z / curve[0].z;
  for (std::size_t i = 1; i < curve.size(); ++i) {
    const auto &a = curve[i - 1], &b = curve[i];
    if (b.z < z) continue;
    return a.size * std::pow(b.size / a.size, std::log(z / a.z) / std::log(b.z / a.z));
  }
  return std::numeric_limits<double>::quiet_NaN();
}

}  // namespace saltus::diagnosis
