#pragma once

#include <vector>

namespace saltus {

// The middle of the values, of an even number the mean of the two in the middle; 0 of none. Finite values only.
double median(std::vector<double> values);

}  // namespace saltus
