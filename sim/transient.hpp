// The decay of the start taken out of a record, instead of waiting for it.
#pragma once

#include <vector>

#include "core/linalg.hpp"
#include "hal/record.hpp"

namespace saltus {

struct TransientRemoval {
  bool removed = false;              // false: the record is too short for it, or shows none; it is unchanged
  std::vector<Complex> multipliers;  // of the decay
  double before = 0.0, after = 0.0;  // [-] root mean square of what does not repeat, over that of the output
  int cycles_saved = 0;              // settling cycles that dropping would have needed for the same
};

// The transient of a periodic system is y[c N + n] = sum_i lambda_i^c v_i[n] from its second cycle on, for lambda_i its
// multipliers: on every silent residue class of lines, and between a cycle and the same one a stimulus period later, it
// stands alone. A stimulus with tones in the classes E leaves, for each section, a linear problem in the v_i and the
// classes of E, the same for every section: the sample spectrum of a class is a sum of smooth local responses of known
// form, where the local polynomial method (Pintelon & Schoukens 2012, ch. 7) takes a polynomial. The multipliers are
// those that leave least over, shared by all experiments and outputs. `count` multipliers, 1 or 2; every sample from
// the second cycle on is used, settling cycles included, and the settling cycles are to be kept in the record.
TransientRemoval remove_transient(Record& record, int count);

}  // namespace saltus
