// Which lines may share an experiment (Ankarali & Cowan 2014, section V).
//
// A line is an integer q: q / P cycles per cycle, where the stimulus repeats after P cycles; the pumping frequency is
// the line P. A periodic system answers a real tone q at every line +-q + m P, so two tones whose residues modulo P
// agree up to sign answer on the same lines and cannot be told apart. A multiple of P / 2 is its own mirror image: one
// play of it is one equation for two responses, so that it takes two plays of other phases; at line 0 the two are one,
// but on the lines of class 0 lies the machine's own cycle, which takes an experiment in which that class is silent.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "../random.hpp"

namespace saltus {

// min(q mod P, P - q mod P). Identifiable lines have a class in 1 ... (P - 1) / 2; 0 and P / 2 hold the half multiples.
constexpr int residue_class(std::int64_t q, int period) noexcept {
  const std::int64_t r = ((q % period) + period) % period;
  return static_cast<int>(std::min(r, period - r));
}

// Rule (16): one play tells a line that is no multiple of half the pumping frequency, where its own mirror image
// answers on its lines.
constexpr bool identifiable(std::int64_t q, int period) noexcept { return (2 * (q % period)) % period != 0; }

// The pairwise rule: neither q_i - q_j nor q_i + q_j is a multiple of P, that is, the classes differ.
constexpr bool compatible(std::int64_t qi, std::int64_t qj, int period) noexcept {
  return residue_class(qi, period) != residue_class(qj, period);
}

// The last line strictly below the frequency f_max [cycles per cycle].
inline int last_line_below(double f_max, int period) noexcept {
  return static_cast<int>(std::ceil(f_max * period)) - 1;
}

// How often a line is to be played for its responses to be told: see above.
constexpr int plays(int q, int period) noexcept { return identifiable(q, period) || q == 0 ? 1 : 2; }

// The lines of one class: any two of them clash, and so do two plays of one, so no plan has fewer experiments than the
// largest has plays. Every experiment gives one equation on an output line of the class, and this is what the class has
// of unknowns there.
struct Clique {
  int residue = 0;  // [-] in 1 ... (P - 1) / 2; with half multiples 0 ... P / 2
  int size = 0;     // [play] the machine's own cycle in class 0 included
};

// The largest class among the lines 1 ... last; or 0 ... last where half multiples are to be played.
constexpr Clique largest_class(int last, int period, bool half_multiples = false) noexcept {
  Clique best;
  const auto consider = [&](int r, int size) {
    if (size > best.size) best = {r, size};
  };
  for (int r = 1; r <= (period - 1) / 2; ++r) {
    const auto count = [&](int first) { return last < first ? 0 : (last - first) / period + 1; };
    consider(r, count(r) + count(period - r));
  }
  if (!half_multiples) return best;
  consider(0, 2 + 2 * (last / period));
  if (period % 2 == 0) consider(period / 2, 2 * ((last + period / 2) / period));
  return best;
}

// The lines of a band, ascending, as often as they are to be played, each with the subset (experiment) it is excited
// in.
template <int MaxLines>
struct Partition {
  std::array<int, MaxLines> line{};    // [-]
  std::array<int, MaxLines> subset{};  // [-] in 0 ... subsets - 1
  int lines = 0;
  int subsets = 0;
  Clique bound;  // no partition of these lines has fewer than bound.size subsets

  // Writes the lines of a subset, as many as fit; returns how many the subset has.
  constexpr int collect(int which, std::span<int> out) const noexcept {
    std::size_t n = 0;
    for (std::size_t i = 0; i < static_cast<std::size_t>(lines); ++i) {
      if (subset[i] != which) continue;
      if (n < out.size()) out[n] = line[i];
      ++n;
    }
    return static_cast<int>(n);
  }
};

namespace detail {

// The lines of 1 ... last, or with half multiples of 0 ... last, in no subset yet. False, and empty, when there are
// none or they do not fit.
template <int MaxLines>
constexpr bool list_lines(int last, int period, bool half_multiples, Partition<MaxLines>& out) noexcept {
  out = {};
  if (period < 3 || last < 1) return false;
  for (int q = half_multiples ? 0 : 1; q <= last; ++q) {
    if (!half_multiples && !identifiable(q, period)) continue;
    for (int play = 0; play < plays(q, period); ++play) {
      if (out.lines == MaxLines) return out = {}, false;
      out.line[static_cast<std::size_t>(out.lines++)] = q;
    }
  }
  out.bound = largest_class(last, period, half_multiples);
  return out.lines > 0;
}

}  // namespace detail

// The paper's procedure: the identifiable lines of 1 ... last dealt at random into `subsets` experiments that obey the
// rules; the sizes differ by one line at most. False, and `out` empty, when that is impossible: fewer subsets than the
// largest class has plays, more subsets than plays, or more plays than MaxLines. With half multiples these are there
// too, from line 0 on, each in as many subsets as plays() says, and one subset at least has no line of class 0.
template <int MaxLines>
[[nodiscard]] constexpr bool random_partition(int last, int period, int subsets, std::uint64_t seed,
                                              Partition<MaxLines>& out, bool half_multiples = false) noexcept {
  if (!detail::list_lines(last, period, half_multiples, out)) return false;
  if (subsets < out.bound.size || subsets > out.lines) return out = {}, false;
  out.subsets = subsets;
  Random random(seed);
  std::array<int, MaxLines> load{};  // lines in each subset
  std::array<int, MaxLines> met{};   // class that entered each subset last
  met.fill(-1);
  const auto count = static_cast<std::size_t>(subsets);
  for (int r = 0; r <= period / 2; ++r) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(out.lines); ++i) {
      if (residue_class(out.line[i], period) != r) continue;
      // One of the least loaded subsets the class has not entered, each equally likely.
      int least = MaxLines;
      std::uint64_t ties = 0;
      for (std::size_t s = 0; s < count; ++s) {
        if (met[s] == r || load[s] > least) continue;
        ties = load[s] < least ? 1 : ties + 1;
        least = load[s];
      }
      std::uint64_t pick = random.uniform_int(ties);
      std::size_t s = 0;
      while (met[s] == r || load[s] != least || pick-- != 0) ++s;
      met[s] = r;
      ++load[s];
      out.subset[i] = static_cast<int>(s);
    }
  }
  return true;
}

// The fewest experiments: as many as the largest class has plays (out.bound proves that fewer cannot do). Every subset
// has at most one line of each class, exactly one where the classes are of equal size, and spans the whole band. False,
// and `out` empty, when there is no line or there are more than MaxLines. Half multiples as in random_partition().
template <int MaxLines>
[[nodiscard]] constexpr bool optimal_partition(int last, int period, Partition<MaxLines>& out,
                                               bool half_multiples = false) noexcept {
  if (!detail::list_lines(last, period, half_multiples, out)) return false;
  out.subsets = out.bound.size;
  for (int r = 0; r <= period / 2; ++r) {
    int next = r;  // shifting the classes against each other mixes low lines with high ones
    for (std::size_t i = 0; i < static_cast<std::size_t>(out.lines); ++i) {
      if (residue_class(out.line[i], period) == r) out.subset[i] = next++ % out.subsets;
    }
  }
  return true;
}

}  // namespace saltus
