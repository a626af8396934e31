// Two charts whose return maps lose more rank than any chart or reset explains. Wendel & Ames 2010, sec. 5.1.
#pragma once

#include "core/hybrid/model.hpp"

namespace saltus {

namespace zero_rank {
struct D1 : Chart<2> {};      // (x, y), the quadrant x > 0, y > 0
struct D2 : Chart<3> {};      // (x, y, z), y > 0
struct E1 : Edge<D1, D2> {};  // at the y axis, which is kept
struct E2 : Edge<D2, D1> {};  // at the x-z plane, projected on the x axis
}  // namespace zero_rank

template <class S = double>
struct ZeroRank {
  using D1 = zero_rank::D1;
  using D2 = zero_rank::D2;
  using Charts = List<D1, D2>;
  using Edges = List<zero_rank::E1, zero_rank::E2>;
  using U = Vec<0, S>;
  static constexpr std::string_view name = "zero_rank";
  static constexpr std::array<Quantity, 0> inputs{};
  static constexpr std::array outputs{Quantity{"x", "-"}, Quantity{"y", "-"}, Quantity{"z", "-"}};
  static constexpr std::string_view note =
      "Wendel & Ames 2010, sec. 5.1, print rank 0 for both return maps. DP_1 is zero, but DP_2 has rank 1 and is "
      "nilpotent: it takes x to z, and only the second passage forgets z. Both spectra are {0}: rank and the number of "
      "non-zero multipliers are different questions.";

  static constexpr auto parameters() { return std::array<Parameter<ZeroRank, S>, 0>{}; }

  Vec<2, S> flow(D1, const Vec<2, S>& x, const U&) const noexcept {
    const S pull = 1.0 - x[0] * x[0] - x[1] * x[1];
    return {-x[1] + x[0] * pull, x[0] + x[1] * pull};
  }
  Vec<3, S> flow(D2, const Vec<3, S>& x, const U&) const noexcept { return {-x[0], -x[2], x[1]}; }
  S guard(zero_rank::E1, const Vec<2, S>& x, const U&) const noexcept { return x[0]; }
  S guard(zero_rank::E2, const Vec<3, S>& x, const U&) const noexcept { return x[1]; }
  Vec<3, S> reset(zero_rank::E1, const Vec<2, S>& x, const U&) const noexcept { return {0.0, x[1], 0.0}; }
  Vec<2, S> reset(zero_rank::E2, const Vec<3, S>& x, const U&) const noexcept { return {x[0] + 1.0, 0.0}; }
  Vec<3, S> output(D1, const Vec<2, S>& x, const U&) const noexcept { return {x[0], x[1], 0.0}; }
  Vec<3, S> output(D2, const Vec<3, S>& x, const U&) const noexcept { return x; }

  Start<D1, S> start() const noexcept { return {Vec<2, S>{1.1, 0.0}}; }
};
static_assert(check<ZeroRank<>>());

}  // namespace saltus
