// expect: this edge leads to a chart that is not in Charts
// expect: Up
#define EDGE_TO_NOWHERE
#define NO_MODEL_WITH_EFFECTS
#include "sound.hpp"
