// Responses that one experiment cannot tell apart, from what several say together. On the output line o every
// experiment gives one equation,
//   Y(o) = sum over the input lines p congruent to o modulo P of H_{(o - p) / P}(p) U(p),  + the machine's own cycle
//                                                                                          where P divides o,
// and a tone on q excites p = q and p = -q, which are congruent where q is a multiple of P / 2 (Ankarali & Cowan 2014,
// rule (16)). There H_m(-q) is the conjugate of H_{-m}(q): two plays of other phases tell both. With several inputs the
// sum goes over these too: as many plays as there are inputs, at amplitudes that are independent, tell all.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/linalg.hpp"

namespace saltus {

struct Identification;

class LineEquations {
 public:
  // What an experiment plays: half the amplitude of a cosine and its phase, the whole of a constant or of the line at
  // half the samples [input unit].
  struct Tone {
    int line = 0;
    Complex u;
    int input = 0;
  };

  LineEquations() = default;
  // N sections a cycle, the stimulus repeats after P cycles.
  LineEquations(int sections, int period) : sections_(sections), period_(period) {}

  // The tones of the experiment that add() is about from now on.
  void begin(std::vector<Tone> tones);
  // Y of an output on an output line, the mean of so many stimulus periods. False, and nothing added, where the
  // experiment has told that line or its mirror image before: they are one equation.
  bool add(int line, int output, Complex y, std::int64_t periods);
  void append(const LineEquations& more);

  // Every response that the equations determine, H_-harmonics ... H_harmonics of every line, by least squares, put
  // behind those that `id` has; where a line is left out a note of `id` says why. sigma is that for a noise of 1 in one
  // period: finish() makes it a standard error. Both of a pair that are each other's conjugates are exactly so.
  void solve(int harmonics, Identification& id) const;

 private:
  struct Term {
    int line;  // p, in -L / 2 ... L / 2
    int input;
    Complex u;
  };
  struct Equation {
    int line;  // o, in 0 ... L / 2
    int output;
    Complex y;
    std::int64_t periods;
    std::vector<Term> terms;
  };

  int folded(std::int64_t line) const;  // into -L / 2 < line <= L / 2

  int sections_ = 1, period_ = 1;
  std::vector<Tone> tones_;
  std::size_t first_ = 0;  // equation of the experiment
  std::vector<Equation> equations_;
};

}  // namespace saltus
