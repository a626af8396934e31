// expect: this edge has no Vec<dim of the next chart, S> reset
// expect: Up
#define NO_RESET
#define NO_MODEL_WITH_EFFECTS
#include "sound.hpp"
