// Sets of coefficients, by rising index.
#pragma once

#include <algorithm>
#include <iterator>
#include <optional>
#include <utility>
#include <vector>

namespace saltus::diagnosis {

inline bool has(const std::vector<int>& set, int e) { return std::find(set.begin(), set.end(), e) != set.end(); }
inline std::vector<int> with(std::vector<int> set, int e) {
  if (!has(set, e)) set.push_back(e);
  std::sort(set.begin(), set.end());
  return set;
}
inline std::vector<int> without(std::vector<int> set, int e) {
  set.erase(std::remove(set.begin(), set.end(), e), set.end());
  return set;
}
// What one set has in the other's place, and the other in its, where that is one each.
inline std::optional<std::pair<int, int>> swapped(const std::vector<int>& one, const std::vector<int>& other) {
  std::vector<int> mine, its;
  std::set_difference(one.begin(), one.end(), other.begin(), other.end(), std::back_inserter(mine));
  std::set_difference(other.begin(), other.end(), one.begin(), one.end(), std::back_inserter(its));
  if (mine.size() != 1 || its.size() != 1) return std::nullopt;
  return std::pair(mine[0], its[0]);
}

}  // namespace saltus::diagnosis
