// expect: this chart has no Vec<dim, S> flow
// expect: Low
#define NO_FLOW
#define NO_MODEL_WITH_EFFECTS
#include "sound.hpp"
