// A model with all its candidate effects behind one run-time face, so that the diagnosis is compiled once.
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/status.hpp"
#include "core/trace/course.hpp"

namespace saltus::diagnosis {

// A number that can be refitted: a declared parameter of the model, or the coefficient of a candidate effect.
struct Coefficient {
  std::string name;  // "k", "quadratic_drag@body", "input_delay"
  std::string unit;
  double nominal = 0.0;       // declared value; of a candidate 0
  bool candidate = false;     // an effect that may be added
  int physical = 0;           // +1: only positive values make sense; 0: either sign
  double probe = 0.0;         // > 0: no derivative at zero; its signature is the secant to this value
  bool kinked = false;        // a force that jumps where a rate changes sign: dear to follow
  bool shifts_time = false;   // a delay or a lag: never below zero, of some fraction of a cycle at most
  std::string profile_of;     // a knot of a force profile at this port; not a cause
  std::string sine_of;        // the other coefficient of a force that repeats with the cycle, along the clock's cosine
  std::string refines;        // the candidate it is a refinement of, empty where none
  int physical_sum = 0;       // +1: only positive values of it and what it refines together make sense
  double uncertainty = -1.0;  // [-] standard deviation over the nominal value where nobody says; below zero: the usual
  bool changes_charts() const { return probe > 0.0; }
  bool of_sensor() const { return name.starts_with("sensor_"); }
};

struct Channel {
  std::string name, unit;
};

struct Start {
  int chart = 0;
  std::vector<double> x;  // (dimension of the chart)
};

// What a run along a course gives. Rows: sample by sample, output by output.
struct Response {
  Status status = Status::ok;
  std::size_t rows = 0;
  std::vector<double> y;         // (rows)
  std::vector<double> gradient;  // (rows x K) row after row; K = starts() + directions
  Start end;
  std::int64_t events = 0;
};

class Machine {
 public:
  virtual ~Machine() = default;

  std::string name;
  std::vector<Coefficient> coefficients;  // declared ones first
  std::size_t declared = 0;               // how many those are
  std::vector<Channel> inputs, outputs;
  std::vector<std::string> charts;
  int clock = -1;  // place of "omega", the clock's rate, among the coefficients; -1 without a clock
  bool has_clock = false;
  bool in_steps = false;    // what carries it from one step to the next is not in the model: the record says when
  double cycle_period = 1;  // [s] of the clock at declared parameters; 1 without a clock

  virtual int starts() const = 0;      // directions taken by the start
  virtual int directions() const = 0;  // coefficients that can be differentiated in one run
  virtual int width() const = 0;       // numbers in a row of the gradient

  // Coordinates of a chart that are free at the start (all but the clock), in order.
  virtual std::vector<int> free_coordinates(int chart) const = 0;

  // `derivatives` false: no gradient, at a fraction of the cost.
  virtual Response run(std::span<const double> values, const Course& course, const Start& start,
                       std::span<const int> wanted, bool derivatives) const = 0;
  Response values_only(std::span<const double> values, const Course& course, const Start& start) const {
    return run(values, course, start, {}, false);
  }
  // The model's own start after `turns` turns of its clock (or seconds) without input, and its state at each of
  // `per_turn` instants of the next turn: where it is when nobody disturbs it. Empty when it does not get there.
  virtual std::vector<Start> cycle(std::span<const double> values, int turns, int per_turn) const = 0;
};

// The least value of a coefficient that makes sense.
inline double lower_bound(const Coefficient& c) {
  const bool bounded = c.changes_charts() || c.shifts_time || (c.candidate && c.physical > 0);
  return bounded ? 0.0 : -std::numeric_limits<double>::infinity();
}
// Whether it has room to change from its nominal value by something of that sign.
inline bool may_change(const Coefficient& c, double by) { return by > 0.0 || c.nominal > lower_bound(c); }

inline bool may_change(const Machine& m, int coefficient, double by) {
  return may_change(m.coefficients[static_cast<std::size_t>(coefficient)], by);
}

// What a coefficient is called among candidates: a declared parameter with that word before its name.
std::string name_of(const Machine& m, int coefficient);
std::vector<std::string> names_of(const Machine& m, const std::vector<int>& coefficients);

// "a + b", or "no effect".
std::string together(const std::vector<std::string>& effects);

// The machine of that name, or null.
std::unique_ptr<Machine> make_machine(const std::string& model);

}  // namespace saltus::diagnosis
