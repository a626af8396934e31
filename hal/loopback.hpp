// A link within one process: two rings, one each way. The transport of tests and of an emulated machine.
#pragma once

#include <cstddef>

#include "link.hpp"
#include "ring.hpp"

namespace saltus {

// One end; a pair of references, freely copied, but used by one thread. The rings must outlive it.
template <class Out, class In, std::size_t Capacity>
class LoopbackEnd {
 public:
  LoopbackEnd(Ring<Out, Capacity>& out, Ring<In, Capacity>& in) noexcept : out_(&out), in_(&in) {}

  [[nodiscard]] bool try_send(const Out& message) noexcept { return out_->try_push(message); }
  [[nodiscard]] bool try_receive(In& message) noexcept { return in_->try_pop(message); }

  // Messages this end could not send because the other did not receive.
  [[nodiscard]] std::size_t dropped() const noexcept { return out_->dropped(); }

 private:
  Ring<Out, Capacity>* out_;
  Ring<In, Capacity>* in_;
};

// Loopback<Stimulus<Nu>, Measurement<Ny>, 64> wire; the experimenter's thread takes one end, the machine's the other.
template <class Command, class Reply, std::size_t Capacity>
class Loopback {
 public:
  using ExperimenterEnd = LoopbackEnd<Command, Reply, Capacity>;
  using MachineEnd = LoopbackEnd<Reply, Command, Capacity>;
  static_assert(Link<ExperimenterEnd, Command, Reply> && Link<MachineEnd, Reply, Command>);

  [[nodiscard]] ExperimenterEnd experimenter() noexcept { return {commands_, replies_}; }
  [[nodiscard]] MachineEnd machine() noexcept { return {replies_, commands_}; }

 private:
  Ring<Command, Capacity> commands_;
  Ring<Reply, Capacity> replies_;
};

}  // namespace saltus
