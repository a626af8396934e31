// Sets of coefficients, by rising index.
#pragma once

#include <algorithm>
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

}  // namespace saltus::diagnosis
