// A record as a diagnosis needs it: stretches of measurement in which nothing is unknown but the start, the noise of
// each output, and what had to be left out.
#pragma once

#include <Eigen/Core>

#include <string>
#include <vector>

#include "hal/record.hpp"
#include "machine.hpp"

namespace saltus::diagnosis {

// One stretch. Rows are sample by sample, output by output, from sample `first` on. Where the stimulus repeats, the
// rows are means over its repeats, and what each repeat deviates from them tells the noise.
struct Segment {
  int experiment = 0;
  std::vector<double> t;  // (n) [s]
  std::vector<double> u;  // (n x inputs) held from its sample to the next
  std::size_t first = 0;
  std::vector<int> lines;                  // the input has power on: q / P cycles per cycle, P cycles the period
  Eigen::VectorXd y;                       // (rows) 0 where nothing was measured
  Eigen::VectorXd count;                   // (rows) measurements that went into it, 0: none
  std::vector<Eigen::VectorXd> deviation;  // (repeats)(rows) of each repeat from the mean; 0 where missing
  Eigen::VectorXd within;                  // (outputs) sum of squares of what measurements deviate from their means
  Start guess;
  std::vector<double> spread;  // (free coordinates of the guess) how far off it may be

  Course course(double h_max) const { return {t, u, first, h_max}; }
  // The spread of a free coordinate of a start, which may have more of them than the guess.
  double spread_of(std::size_t k) const { return k < spread.size() ? spread[k] : 1.0; }
  std::size_t samples() const { return t.size() - first; }                                // whose outputs there are
  double measured() const { return static_cast<double>((count.array() > 0.0).count()); }  // rows
};

struct Quality {
  std::size_t rows = 0;
  std::size_t missing = 0;         // values that were not measured
  std::size_t outliers = 0;        // values left out because no noise makes them
  std::size_t filled_inputs = 0;   // inputs taken from another repeat
  std::vector<double> resolution;  // (outputs) [unit] smallest step between values, 0 where there is none to speak of
};

struct Data {
  std::vector<Segment> segments;
  int repeats = 1;
  int sections = 0;             // [-] a cycle; 0 where the record is not paced by a clock
  int period_cycles = 0;        // [cycle] of a segment where the stimulus repeats
  Eigen::VectorXd noise;        // (outputs) [unit] standard deviation of one measurement
  bool noise_measured = false;  // from repeats
  double colour = 1.0;          // [-] by how much correlated noise widens the scatter of a sum of squares
  bool coloured = false;
  bool wandering = false;  // repeats of one stimulus differ by what moves the machine, far beyond its sensors
  Quality quality;
  std::vector<std::string> notes;

  std::size_t outputs() const { return static_cast<std::size_t>(noise.size()); }
  double measured() const {  // rows
    double n = 0.0;
    for (const Segment& s : segments) n += s.measured();
    return n;
  }
};

// Samples `from` to `to` of a segment, counted from its first output, with as much of the input's history as there is,
// `history` samples at most. What the start may be off by is left to whoever gives it one.
Segment part_of(const Segment& s, std::size_t from, std::size_t to, std::size_t history);

// What is taken of a stimulus that repeats. The mean of courses that differ is no course of the machine.
enum class Repeats { averaged, first_alone };

// Lays out a record for a machine, or throws RecordError saying what to mend.
Data prepare(const Record& record, const Machine& machine, Repeats taken = Repeats::averaged);

// The columns of the machine's inputs or outputs, in its order, or RecordError saying which is missing.
std::vector<std::size_t> columns_of(const Record& record, const Machine& machine, bool outputs);

// The smallest step between the values of a column where it explains most of them; 0 where values are dense.
double resolution_of(std::vector<double> values);

// Noise from second differences of residuals, for records without repeats.
void noise_from_residuals(Data& data, const std::vector<Eigen::VectorXd>& residual);

}  // namespace saltus::diagnosis
