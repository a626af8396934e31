// expect: this effect acts nowhere on this model
// expect: Push<small::Wheel
#include "sound.hpp"
saltus::With<small::Model<>, small::Push<small::Wheel>> model;
