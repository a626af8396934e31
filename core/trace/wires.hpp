// What may be wrong on the wires between a machine and its record: the input arrives late, smoothed, scaled or shifted;
// so does what the sensors report; the clock is off. All zero: the record is the truth. These act on known signals
// outside the model, so they add no state (Ankarali & Cowan 2014 see only e^{-i w tau} of them).
#pragma once

#include "../hybrid/model.hpp"

namespace saltus {

template <class M, class T = ScalarOf<M>>
struct Wires {
  static constexpr int nu = input_count<M>, ny = output_count<M>;
  static constexpr int parameter_count = 5 + 2 * nu + 2 * ny;

  T input_delay{};       // [s] the input acts this much later than recorded
  T input_lag{};         // [s] time constant of a first-order lag of the input
  T sensor_delay{};      // [s] the outputs are those of this much earlier
  T sensor_lag{};        // [s] time constant of a first-order lag of the outputs
  T clock_offset{};      // [s] the machine's clock is this much ahead of the record's
  std::array<T, static_cast<std::size_t>(nu)> input_gain{};   // [-] u (1 + gain) acts
  std::array<T, static_cast<std::size_t>(nu)> input_bias{};   // [unit of u]
  std::array<T, static_cast<std::size_t>(ny)> sensor_gain{};  // [-] y (1 + gain) is recorded
  std::array<T, static_cast<std::size_t>(ny)> sensor_bias{};  // [unit of y]

  // f(name, unit, value&, channel): channel -1 for what all inputs, or all outputs, share.
  template <class W, class F>
  static void visit(W& w, F&& f) {
    f("input_delay", "s", w.input_delay, -1);
    f("input_lag", "s", w.input_lag, -1);
    f("sensor_delay", "s", w.sensor_delay, -1);
    f("sensor_lag", "s", w.sensor_lag, -1);
    f("clock_offset", "s", w.clock_offset, -1);
    for (int i = 0; i < nu; ++i) {
      f("input_gain", "1", w.input_gain[static_cast<std::size_t>(i)], i);
      f("input_bias", M::inputs[static_cast<std::size_t>(i)].unit, w.input_bias[static_cast<std::size_t>(i)], i);
    }
    for (int i = 0; i < ny; ++i) {
      f("sensor_gain", "1", w.sensor_gain[static_cast<std::size_t>(i)], i);
      f("sensor_bias", M::outputs[static_cast<std::size_t>(i)].unit, w.sensor_bias[static_cast<std::size_t>(i)], i);
    }
  }
};

}  // namespace saltus
