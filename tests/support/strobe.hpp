// A world whose return map is x -> a x (1 - x) + c, in closed form: x stands still while t runs from 0 to 1.
#pragma once

#include "core/hybrid/model.hpp"

namespace saltus::worlds {

namespace strobe {
struct Dark : Chart<2> {};  // (x, t [s])
struct Flash : Edge<Dark, Dark> {};
struct Over : Edge<Dark, Dark> {};  // where x t > limit: before the flash when x > limit
}  // namespace strobe
template <class S = double>
struct Strobe {
  using Charts = List<strobe::Dark>;
  using Edges = List<strobe::Flash, strobe::Over>;
  using X = Vec<2, S>;
  using U = Vec<0, S>;
  static constexpr std::string_view name = "strobe";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"x", "-"}};

  S a = 2.5;        // [-]
  S c = 0.0;        // [-]
  S limit = 10.0;   // [-]
  S height = 10.0;  // [-] has fallen above it
  S never = 0.0;    // [-] 1: no flash comes

  static constexpr auto parameters() {
    return std::array{Parameter{"a", "-", &Strobe::a}, Parameter{"c", "-", &Strobe::c},
                      Parameter{"limit", "-", &Strobe::limit}, Parameter{"height", "-", &Strobe::height},
                      Parameter{"never", "-", &Strobe::never}};
  }
  X flow(strobe::Dark, const X&, const U&) const noexcept { return {0.0, 1.0}; }
  S guard(strobe::Flash, const X& x, const U&) const noexcept { return 1.0 - x[1] * (1.0 - never); }
  S guard(strobe::Over, const X& x, const U&) const noexcept { return limit - x[0] * x[1]; }
  X reset(strobe::Flash, const X& x, const U&) const noexcept { return {a * x[0] * (1.0 - x[0]) + c, 0.0}; }
  X reset(strobe::Over, const X& x, const U&) const noexcept { return {0.5 * x[0], 0.0}; }
  Vec<1, S> output(strobe::Dark, const X& x, const U&) const noexcept { return Vec<1, S>(x[0]); }
  S upright(strobe::Dark, const X& x) const noexcept { return height - x[0]; }
  Start<strobe::Dark, S> start() const noexcept { return {X{0.55, 0.0}}; }
};

}  // namespace saltus::worlds
