// expect: this chart has no Vec<outputs, S> output
// expect: Low
#define NO_OUTPUT
#define NO_MODEL_WITH_EFFECTS
#include "sound.hpp"
