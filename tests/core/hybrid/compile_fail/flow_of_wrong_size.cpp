// expect: this chart has no Vec<dim, S> flow
// expect: Low
#define FLOW_OF_WRONG_SIZE
#define NO_MODEL_WITH_EFFECTS
#include "sound.hpp"
