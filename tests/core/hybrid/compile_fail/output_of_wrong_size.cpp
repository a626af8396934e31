// expect: this chart has no Vec<outputs, S> output
// expect: Low
#define OUTPUT_OF_WRONG_SIZE
#define NO_MODEL_WITH_EFFECTS
#include "sound.hpp"
