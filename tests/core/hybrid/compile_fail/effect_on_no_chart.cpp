// expect: this effect acts nowhere on this model
// expect: Draught
#include "sound.hpp"
template <class S = double>
struct Draught {
  static constexpr auto parameters() { return std::array<saltus::Parameter<Draught, S>, 0>{}; }
  saltus::Vec<3, S> flow(small::Elsewhere, const saltus::Vec<3, S>& x, const saltus::Vec<1, S>&) const { return x; }
};
saltus::With<small::Model<>, Draught<>> model;
