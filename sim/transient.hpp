// The decay of the start taken out of a record, instead of waiting for it.
#pragma once

#include <limits>
#include <vector>

#include "core/linalg.hpp"
#include "hal/record.hpp"

namespace saltus {

enum class TransientChoice {
  automatic,  // modelled where that is expected to be more accurate
  drop,       // the settling cycles are all that is done
  model,      // modelled wherever the record is long enough
};

struct TransientRemoval {
  bool removed = false;              // false: dropping does as well, or the record is too short; it is unchanged
  std::vector<Complex> multipliers;  // of the decay
  double before = 0.0, after = 0.0;  // [-] root mean square of what does not repeat, over that of the output
  int cycles_saved = 0;              // settling cycles that dropping would have needed for the same
  // Expected error of H_0 on the excited lines over H_0, root of the mean square over the outputs [-]; NaN where the
  // record is too short to tell.
  double dropped = std::numeric_limits<double>::quiet_NaN();   // the settling cycles dropped: what is left, and noise
  double modelled = std::numeric_limits<double>::quiet_NaN();  // the transient modelled: noise, and that of the model
  double inflation = 1.0;  // [-] of the standard errors by the noise of the model, where it was removed
};

// The transient of a periodic system is y[c N + n] = sum_i lambda_i^c v_i[n] from its second cycle on, for lambda_i its
// multipliers: on every silent residue class of lines, and between a cycle and the same one a stimulus period later, it
// stands alone. A stimulus with tones in the classes E leaves, for each section, a linear problem in the v_i and the
// classes of E, the same for every section: the sample spectrum of a class is a sum of smooth local responses of known
// form, where the local polynomial method (Pintelon & Schoukens 2012, ch. 7) takes a polynomial. The multipliers are
// those that leave least over, shared by all experiments and outputs; the v_i of all experiments span the same few
// shapes, the motions of the state, and what noise adds to them elsewhere is cut away. The first cycle, where the
// nilpotent part of the map shows too, is free: it becomes what the others say. `count` multipliers, 1 or 2; the
// settling cycles are to be kept in the record. The choice weighs the transient left by dropping against the noise
// that the model's free numbers let through, both from what the record itself shows.
TransientRemoval remove_transient(Record& record, int count, TransientChoice choice = TransientChoice::automatic);

}  // namespace saltus
