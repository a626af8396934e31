// expect: parameters
#define NO_PARAMETERS
#define NO_MODEL_WITH_EFFECTS
#include "sound.hpp"
