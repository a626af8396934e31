// expect: one chart has a clock, so every chart must have one
// expect: Low
#define CHART_WITHOUT_CLOCK
#define NO_MODEL_WITH_EFFECTS
#include "sound.hpp"
