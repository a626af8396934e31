// expect: this edge has no S guard
// expect: Up
#define NO_GUARD
#define NO_MODEL_WITH_EFFECTS
#include "sound.hpp"
