// expect: the model names no Charts
#define NO_CHARTS
#define NO_MODEL_WITH_EFFECTS
#include "sound.hpp"
