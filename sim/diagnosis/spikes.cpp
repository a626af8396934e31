#include "spikes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace saltus::diagnosis {
namespace {

// By how much value i differs from the parabola through two neighbours on either side.
double off_neighbours(const std::vector<double>& y, std::size_t i) {
  return y[i] - (4.0 * (y[i - 1] + y[i + 1]) - (y[i - 2] + y[i + 2])) / 6.0;
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
  for (Channel& c : record.outputs) {
    const std::vector<double> y = c.values;
    std::vector<double> off(y.size(), std::nan("")), sizes;
    for (std::size_t i = reach; i + reach < y.size(); ++i) {
      if (record.experiment[i - reach] != record.experiment[i + reach]) continue;
      off[i] = off_neighbours(y, i);
      if (std::isfinite(off[i])) sizes.push_back(std::abs(off[i]));
    }
    if (sizes.size() < fewest) continue;
    const auto nine_in_ten = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() * 9 / 10);
    std::nth_element(sizes.begin(), nine_in_ten, sizes.end());
    const double usual = *nine_in_ten;
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

}  // namespace saltus::diagnosis
