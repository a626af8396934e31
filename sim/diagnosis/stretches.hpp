// A record that no clock paces, cut into stretches: within one the same leg stands, nothing is missing from the input,
// and nothing is unknown but the start.
#pragma once

#include <optional>
#include <span>

#include "fit.hpp"

namespace saltus::diagnosis {

struct Cut {
  double length = 0.0;     // [s] of a stretch; 0: chosen by the record
  double exclude = 0.035;  // [s] left out on either side of an event, where the structure rings
  bool exact = false;      // stretches of just that length, what is left over is not used
  std::vector<bool> skip;  // (rows) never used; empty: none
};

// Where a stretch comes from.
struct Origin {
  int experiment = 0;
  int cycle = 0;                  // 0 where the record does not count them
  std::size_t row = 0;            // its first
  double begin = 0.0, end = 0.0;  // [s]
};

struct Stretches {
  Data data;
  std::vector<Origin> origin;  // (segments)
  double length = 0.0;         // [s] what was aimed at
  double spacing = 0.0;        // [s] between samples, the median
  double jitter = 0.0;         // [-] largest deviation from it, as a share
  std::size_t ringing = 0;     // rows left out around changes of chart
};

// The machine's chart for every chart of the record, or RecordError saying which it does not have.
std::vector<int> charts_of(const Record& record, const Machine& machine);

// Throws RecordError saying what to mend.
Stretches cut_into_stretches(const Record& record, const Machine& machine, const Cut& cut);

// The start that the first `samples` of a stretch ask for: Gauss-Newton from rest, for so short a time the outputs are
// nearly linear in it. False where the model cannot follow.
bool start_from(const Problem& p, const Segment& s, std::span<const double> values, std::size_t samples, Start& start);

// The same from ever more samples, so that a start near an unstable rest is found; nothing where the first few fail.
std::optional<Start> start_from_data(const Problem& p, const Segment& s, std::span<const double> values);

// How much an error of the start grows within a stretch, at most, by what it moves in the outputs.
double growth(const Problem& p, const Segment& s, std::span<const double> values, const Start& start);

// Halves, and halves again, the stretches in which a small error of the start grows tenfold: beyond that the end says
// nothing about the model. The guesses of the new ones are made.
void halve_unstable(const Problem& p, Stretches& s, const std::string& record);

// Stretches in which the best resolved output hardly moves: nothing to learn about motion, by sorted index.
std::vector<int> standing_still(const Stretches& s);

// Rows around which a force acted that the machine cannot have made, by far larger than what is missing elsewhere:
// somebody touched it. Empty when there are none, or too many to be accidents.
std::vector<bool> touched(const Record& record, const Machine& machine, const Cut& cut);

// Guesses every stretch's start from its first samples, and how far off the guess may be.
void guess_starts_from_data(const Problem& p, Data& data, const std::string& record);

}  // namespace saltus::diagnosis
