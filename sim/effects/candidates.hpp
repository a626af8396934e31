// All candidate effects of a model: every force law at every port, an offset of every guard, and the model's own.
#pragma once

#include "force_laws.hpp"

namespace saltus {

// Effects a model has beyond the general ones: specialise it beside the model.
//   template <class S> struct OwnEffects<Hopper<S>> { using type = List<MyEffect<S>, ...>; };
template <class M>
struct OwnEffects {
  using type = List<>;
};

namespace effects {

// The edges whose guards may be off: all, unless a model names those of its declared part as `OffsetEdges`.
template <class M>
struct OffsetEdgesOf {
  using type = typename M::Edges;
};
template <class M>
requires requires { typename M::OffsetEdges; }
struct OffsetEdgesOf<M> {
  using type = typename M::OffsetEdges;
};

template <class... Ls>
struct Joined;
template <class... As>
struct Joined<List<As...>> {
  using type = List<As...>;
};
template <class... As, class... Bs, class... Rest>
struct Joined<List<As...>, List<Bs...>, Rest...> {
  using type = typename Joined<List<As..., Bs...>, Rest...>::type;
};

template <class P, class S, bool Clocked>
struct LawsAt {
  using always = List<Viscous<P, S>, Quadratic<P, S>, Coulomb<P, S>, AsymmetricCoulomb<P, S>, ConstantForce<P, S>>;
  using cubic = std::conditional_t<(Internal<P> || Rotary<P>)&&!Turning<P>, List<Cubic<P, S>>, List<>>;
  using joint = std::conditional_t<Rotary<P>, List<Stribeck<P, S>>, List<>>;
  using repeating = std::conditional_t<Clocked, List<PeriodicForce<P, S>, ForceProfile<P, S>>, List<>>;
  using type = typename Joined<always, cubic, joint, repeating>::type;
};

template <class M, class Ports, class Edges, class Own>
struct Gather;
template <class M, class... Ps, class... Es, class Own>
struct Gather<M, List<Ps...>, List<Es...>, Own> {
  using S = ScalarOf<M>;
  using type =
      typename Joined<List<>, typename LawsAt<Ps, S, clocked<M>>::type..., List<GuardOffset<Es, S>...>, Own>::type;
};

template <class M, class L>
struct WithList;
template <class M, class... Es>
struct WithList<M, List<Es...>> {
  using type = With<M, Es...>;
};

}  // namespace effects

template <class M>
using Candidates = typename effects::Gather<M, typename PortsOf<M>::type, typename effects::OffsetEdgesOf<M>::type,
                                            typename OwnEffects<M>::type>::type;

// The model with every candidate added, all of them zero: the model itself, but ready to be asked what it lacks.
template <class M>
using WithCandidates = typename effects::WithList<M, Candidates<M>>::type;

}  // namespace saltus
