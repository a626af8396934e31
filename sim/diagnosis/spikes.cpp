#include "spikes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "../median.hpp"

namespace saltus::diagnosis {
namespace {

// By how much value i differs from the parabola through two neighbours on either side.
double off_neighbours(const std::vector<double>& y, std::size_t i) {
  return y[i] - (4.0 * (y[i - 1] + y[i + 1]) - (y[i - 2] + y[i + 2])) / 6.0;
}

// What nine in ten of some sizes are at most.
double usual_of(std::vector<double> sizes) {
  const auto nine_in_ten = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() * 9 / 10);
  std::nth_element(sizes.begin(), nine_in_ten, sizes.end());
  return *nine_in_ten;
}

// Whether, with value i where its neighbours say, all of these fit together: of a step they do not.
bool stands_alone(std::vector<double> y, std::size_t i, double usual) {
  y[i] -= off_neighbours(y, i);
  for (const std::size_t k : {i - 2, i - 1, i + 1, i + 2}) {
    if (!(std::abs(off_neighbours(y, k)) < usual)) return false;
  }
  return true;
}

}  // namespace

std::size_t take_out_spikes(Record& record) {
  constexpr double far = 10.0, near = 3.0;       // [-] times what nine in ten values are off by at most
  constexpr std::size_t reach = 4, fewest = 20;  // values on either side that have a say, and to know what is usual
  std::size_t count = 0;
  for (saltus::Channel& c : record.outputs) {
    const std::vector<double> y = c.values;
    std::vector<double> off(y.size(), std::nan("")), sizes;
    for (std::size_t i = reach; i + reach < y.size(); ++i) {
      if (record.experiment[i - reach] != record.experiment[i + reach]) continue;
      off[i] = off_neighbours(y, i);
      if (std::isfinite(off[i])) sizes.push_back(std::abs(off[i]));
    }
    if (sizes.size() < fewest) continue;
    const double usual = usual_of(sizes);
    for (std::size_t i = 0; i < off.size() && usual > 0.0; ++i) {
      const double size = std::abs(off[i]);
      const bool turn = c.unit == "rad" && std::abs(size - 2.0 * std::numbers::pi) < 1.0;
      if (!(size > far * usual) || turn) continue;
      const auto first = y.begin() + static_cast<std::ptrdiff_t>(i - reach);
      if (!stands_alone({first, first + 2 * reach + 1}, reach, near * usual)) continue;
      c.values[i] = std::nan("");
      ++count;
    }
  }
  return count;
}

std::size_t leave_out_far(Data& data, const std::vector<int>& segments, const std::vector<Eigen::VectorXd>& residual) {
  constexpr double far = 6.0, apart = 8.0;  // [-] times what nine in ten are off by at most; how its neighbours differ
  constexpr Eigen::Index reach = 4;         // values on either side that have a say
  constexpr std::size_t enough = 3;         // pairs of them
  constexpr std::size_t fewest = 20;        // to know what is usual
  const auto ny = static_cast<Eigen::Index>(data.outputs());
  std::size_t count = 0;
  for (Eigen::Index j = 0; j < ny; ++j) {
    struct Off {
      std::size_t segment;
      Eigen::Index row;
      double by, neighbours;
    };
    std::vector<Off> off;
    std::vector<double> sizes;
    for (std::size_t k = 0; k < segments.size(); ++k) {
      const auto segment = static_cast<std::size_t>(segments[k]);
      const Eigen::VectorXd& used = data.segments[segment].count;
      for (Eigen::Index i = j; i < used.size(); i += ny) {
        if (!(used[i] > 0.0)) continue;
        std::vector<double> around, slopes;
        const auto at = [&](Eigen::Index n) { return i + n * ny; };
        const auto is_there = [&](Eigen::Index n) { return at(n) >= 0 && at(n) < used.size() && used[at(n)] > 0.0; };
        for (Eigen::Index n = 1; n <= reach; ++n) {
          if (!is_there(n) || !is_there(-n)) continue;
          slopes.push_back((residual[k][at(n)] - residual[k][at(-n)]) / static_cast<double>(2 * n));
        }
        if (slopes.size() < enough) continue;
        const double slope = median(slopes);
        for (Eigen::Index n = -reach; n <= reach; ++n) {
          if (n != 0 && is_there(n)) around.push_back(residual[k][at(n)] - slope * static_cast<double>(n));
        }
        const double middle = median(around);
        for (double& r : around) r = std::abs(r - middle);
        off.push_back({segment, i, std::abs(residual[k][i] - middle), median(around)});
        sizes.push_back(off.back().by);
      }
    }
    if (sizes.size() < fewest) continue;
    const double usual = usual_of(sizes);
    for (const Off& o : off) {
      if (!(o.by > far * usual) || !(o.by > apart * o.neighbours)) continue;
      data.segments[o.segment].count[o.row] = 0.0;
      ++count;
    }
  }
  return count;
}

}  // namespace saltus::diagnosis
