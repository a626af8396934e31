#include "codec.hpp"

#include "../crc32c.hpp"
#include "saltus_wire/htf_t.hpp"
#include "saltus_wire/measurement_t.hpp"
#include "saltus_wire/status_t.hpp"
#include "saltus_wire/stimulus_t.hpp"

namespace saltus {

namespace wire = saltus_wire;
namespace {

constexpr std::size_t crc_size = 4;
static_assert(wire::stimulus_t::max_inputs == max_inputs && wire::measurement_t::max_outputs == max_outputs &&
              wire::htf_t::max_tones == HtfBins::capacity);

// The checksum is the last field, and covers all before it.
template <class Wire>
std::size_t seal(Wire& w, std::span<std::uint8_t> out) noexcept {
  const int size = w.getEncodedSize();
  const auto n = static_cast<std::size_t>(size);
  if (n > largest_message || n > out.size()) return 0;
  w.kind = Wire::this_kind;
  w.crc = 0;
  if (w.encode(out.data(), 0, size) != size) return 0;
  const std::uint32_t crc = crc32c(out.first(n - crc_size));
  for (std::size_t i = 0; i < crc_size; ++i) out[n - 1 - i] = static_cast<std::uint8_t>(crc >> (8 * i));  // big-endian
  return n;
}

// LCM may say any size, so that is checked first; then its fingerprint, then ours.
template <class Wire>
Decoded unseal(std::span<const std::uint8_t> in, Wire& w, Checksum checksum) noexcept {
  const int size = w.getEncodedSize();
  const auto n = static_cast<std::size_t>(size);
  if (in.size() != n) return {false, Fault::length};
  if (w.decode(in.data(), 0, size) != size) return {false, Fault::fingerprint};
  if (checksum == Checksum::checked && static_cast<std::uint32_t>(w.crc) != crc32c(in.first(n - crc_size))) {
    return {false, Fault::checksum};
  }
  if (w.kind != Wire::this_kind) return {false, Fault::kind};
  return {};
}

template <class E>
bool word(std::int32_t value, E last, E& e) noexcept {
  if (value < 0 || value > static_cast<std::int32_t>(last)) return false;
  e = static_cast<E>(value);
  return true;
}

// Counts are far from where arithmetic ends.
bool count(std::int64_t value, std::int64_t least = 0) noexcept {
  return value >= least && value < std::int64_t{1} << 62;
}

template <std::size_t N>
void put(const ShortText<N>& text, std::int8_t (&out)[N]) noexcept {
  for (std::size_t i = 0; i < N; ++i) out[i] = static_cast<std::int8_t>(text.chars[i]);
}
// Only printable ASCII comes in: the text goes to terminals.
template <std::size_t N>
void get(const std::int8_t (&in)[N], ShortText<N>& text) noexcept {
  text = {};
  for (std::size_t i = 0; i + 1 < N && in[i] != 0; ++i) {
    text.chars[i] = in[i] >= ' ' && in[i] < 127 ? static_cast<char>(in[i]) : '?';
  }
}

}  // namespace

std::size_t encode(const Stimulus<max_inputs>& m, int inputs, std::span<std::uint8_t> out) noexcept {
  wire::stimulus_t w{};
  w.order = static_cast<std::int32_t>(m.order);
  w.session = m.session;
  w.seq = m.seq;
  w.tick = m.tick;
  w.sent = m.sent;
  w.experiment = m.experiment;
  w.inputs = inputs;
  std::copy(m.u.begin(), m.u.end(), w.u);
  return seal(w, out);
}

Decoded decode(std::span<const std::uint8_t> in, Stimulus<max_inputs>& m, int& inputs, Checksum checksum) noexcept {
  wire::stimulus_t w{};
  if (const Decoded d = unseal(in, w, checksum); !d.good) return d;
  if (!word(w.order, Order::stop, m.order) || w.inputs < 0 || w.inputs > max_inputs || !count(w.seq) ||
      !count(w.tick) || !count(w.sent)) {
    return {false, Fault::kind};
  }
  m.session = w.session;
  m.seq = w.seq;
  m.tick = w.tick;
  m.sent = w.sent;
  m.experiment = w.experiment;
  inputs = w.inputs;
  std::copy(std::begin(w.u), std::end(w.u), m.u.begin());
  return {};
}

std::size_t encode(const Measurement<max_outputs>& m, int outputs, std::span<std::uint8_t> out) noexcept {
  wire::measurement_t w{};
  w.answer = static_cast<std::int32_t>(m.answer);
  w.session = m.session;
  w.machine = m.machine;
  w.seq = m.seq;
  w.tick = m.tick;
  w.sent = m.sent;
  w.status = static_cast<std::int32_t>(m.status);
  w.outputs = outputs;
  std::copy(m.y.begin(), m.y.end(), w.y);
  return seal(w, out);
}

Decoded decode(std::span<const std::uint8_t> in, Measurement<max_outputs>& m, int& outputs,
               Checksum checksum) noexcept {
  wire::measurement_t w{};
  if (const Decoded d = unseal(in, w, checksum); !d.good) return d;
  if (!word(w.answer, Answer::unknown, m.answer) || !word(w.status, Status::failed, m.status) || w.outputs < 0 ||
      w.outputs > max_outputs || !count(w.seq, -1) || !count(w.tick) || !count(w.sent, -1)) {
    return {false, Fault::kind};
  }
  m.session = w.session;
  m.machine = w.machine;
  m.seq = w.seq;
  m.tick = w.tick;
  m.sent = w.sent;
  outputs = w.outputs;
  std::copy(std::begin(w.y), std::end(w.y), m.y.begin());
  return {};
}

std::size_t encode(const Presence& m, std::span<std::uint8_t> out) noexcept {
  wire::status_t w{};
  w.role = static_cast<std::int32_t>(m.role);
  w.state = static_cast<std::int32_t>(m.activity);
  w.paced = static_cast<std::int32_t>(m.pace);
  w.id = m.id;
  w.session = m.session;
  w.born = m.born;
  w.sent = m.sent;
  w.tick = m.tick;
  w.missed = m.missed;
  w.experiment = m.experiment;
  w.sections = m.sections;
  w.stimulus_period = m.stimulus_period;
  w.settle = m.settle;
  w.cycle_period = m.cycle_period;
  static_assert(fault_count == sizeof w.faults / sizeof w.faults[0]);
  std::copy(m.faults.begin(), m.faults.end(), w.faults);
  put(m.who, w.name);
  put(m.model, w.model);
  put(m.note, w.note);
  return seal(w, out);
}

Decoded decode(std::span<const std::uint8_t> in, Presence& m) noexcept {
  wire::status_t w{};
  if (const Decoded d = unseal(in, w, Checksum::checked); !d.good) return d;
  if (!word(w.role, Role::experimenter, m.role) || !word(w.state, Activity::gone, m.activity) ||
      !word(w.paced, Pace::paced, m.pace)) {
    return {false, Fault::kind};
  }
  m.id = w.id;
  m.session = w.session;
  m.born = w.born;
  m.sent = w.sent;
  m.tick = w.tick;
  m.missed = w.missed;
  m.experiment = w.experiment;
  m.sections = w.sections;
  m.stimulus_period = w.stimulus_period;
  m.settle = w.settle;
  m.cycle_period = w.cycle_period;
  std::copy(std::begin(w.faults), std::end(w.faults), m.faults.begin());
  get(w.name, m.who);
  get(w.model, m.model);
  get(w.note, m.note);
  return {};
}

std::size_t encode(const HtfBins& m, std::span<std::uint8_t> out) noexcept {
  wire::htf_t w{};
  w.session = m.session;
  w.sent = m.sent;
  w.tick = m.tick;
  w.experiment = m.experiment;
  w.sections = m.sections;
  w.period = m.period;
  w.harmonic = m.harmonic;
  w.output = m.output;
  w.tones = m.tones;
  for (std::size_t k = 0; k < m.line.size(); ++k) {
    w.line[k] = m.line[k];
    w.re[k] = m.value[k].real();
    w.im[k] = m.value[k].imag();
  }
  return seal(w, out);
}

Decoded decode(std::span<const std::uint8_t> in, HtfBins& m) noexcept {
  wire::htf_t w{};
  if (const Decoded d = unseal(in, w, Checksum::checked); !d.good) return d;
  if (w.tones < 0 || w.tones > HtfBins::capacity) return {false, Fault::kind};
  m.session = w.session;
  m.sent = w.sent;
  m.tick = w.tick;
  m.experiment = w.experiment;
  m.sections = w.sections;
  m.period = w.period;
  m.harmonic = w.harmonic;
  m.output = w.output;
  m.tones = w.tones;
  for (std::size_t k = 0; k < m.line.size(); ++k) {
    m.line[k] = w.line[k];
    m.value[k] = {w.re[k], w.im[k]};
  }
  return {};
}

}  // namespace saltus
