// expect: the model has no static constexpr std::array inputs
#define NO_INPUTS
#define NO_MODEL_WITH_EFFECTS
#include "sound.hpp"
