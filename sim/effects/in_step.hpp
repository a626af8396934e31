// A walker between its impacts. Which leg stands, and since when, is for the record to say: feet scuff, knees bounce,
// ground is uneven, and no guard of straight legs on a plane is met when the machine's foot comes down.
#pragma once

#include "core/hybrid/model.hpp"

namespace saltus {

// The charts, ports and parameters of a walker; no edges.
template <template <class> class Walker, class S = double>
struct InStep : Walker<S> {
  using Scalar = S;
  template <class T>
  using rebind = InStep<Walker, T>;
  using Edges = List<>;
  static constexpr bool in_steps = true;

  static constexpr auto parameters() {
    constexpr auto own = Walker<S>::parameters();
    std::array<Parameter<InStep, S>, own.size()> all{};
    for (std::size_t i = 0; i < own.size(); ++i) all[i] = {own[i].name, own[i].unit, own[i].member};
    return all;
  }
};

}  // namespace saltus
