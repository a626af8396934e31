#include "pieces.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/random.hpp"
#include "runs.hpp"
#include "sets.hpp"
#include "side_by_side.hpp"

namespace saltus::diagnosis {
namespace {

struct Piece {
  int segment = 0;
  std::size_t begin = 0, end = 0;  // samples of it
  Start start;
  double chi2 = 0.0;
  int parts = 1;  // pieces of the round before that it is joined of
};

// The pieces as segments of their own, of which fits can be asked.
struct Cut {
  Data data;
  Problem problem;
  std::vector<int> all;

  Cut(const Problem& p, const std::vector<Piece>& pieces) : problem(p) {
    data.sections = p.data->sections;
    data.noise = p.data->noise;
    for (const Piece& piece : pieces) {
      const Segment& s = p.data->segments[static_cast<std::size_t>(piece.segment)];
      Segment cut = part_of(s, piece.begin, piece.end, s.first);
      cut.spread = s.spread;
      cut.guess = piece.start;
      data.segments.push_back(std::move(cut));
    }
    problem.data = &data;
    all.resize(pieces.size());
    std::iota(all.begin(), all.end(), 0);
  }
  Cut(const Cut&) = delete;
};

// Starts that lead nowhere, moved by ever more of what they may be off by until the machine follows.
void mend_starts(const Cut& cut, std::vector<Start>& starts, const std::vector<double>& values) {
  const Machine& machine = *cut.problem.machine;
  side_by_side(starts.size(), [&](std::size_t k) {
    const Segment& s = cut.data.segments[k];
    const Start as_it_was = starts[k];
    const auto coordinates = machine.free_coordinates(as_it_was.chart);
    Random random(k);
    for (double reach = 1e-3; reach < 1.0 && !usable(respond(cut.problem, s, values, starts[k]).status); reach *= 1.3) {
      starts[k] = as_it_was;
      for (std::size_t i = 0; i < coordinates.size(); ++i)
        starts[k].x[static_cast<std::size_t>(coordinates[i])] += reach * s.spread_of(i) * random.normal();
    }
  });
}

constexpr double lost = 2.0;  // [-] of a piece's rows: its start is not found

// Fits the pieces from where they start; what it finds is theirs.
Fit fit_pieces(const Problem& p, std::vector<Piece>& pieces, const Fit& from, const std::vector<int>& effects,
               const FitOptions& options = {}) {
  const Cut cut(p, pieces);
  Fit f = from;
  f.start.clear();
  for (const Piece& piece : pieces) f.start.push_back(piece.start);
  mend_starts(cut, f.start, f.values);
  f = fit(cut.problem, cut.all, f, effects, options);
  const std::vector<double> chi2 = chi2_of_each(cut.problem, cut.all, f);
  for (std::size_t k = 0; k < pieces.size(); ++k) {
    pieces[k].start = f.start[k];
    pieces[k].chi2 = chi2[k];
  }
  return f;
}

double rows_of(const Problem& p, const Piece& piece) {
  return static_cast<double>(p.data->outputs() * (piece.end - piece.begin));
}

// chi squared of a segment run from a start.
double chi2_from(const Problem& p, const Segment& s, const Fit& values, const Start& start) {
  const Response r = respond(p, s, values.values, start);
  if (!usable(r.status)) return std::numeric_limits<double>::infinity();
  const Eigen::Map<const Eigen::VectorXd> y(r.y.data(), s.y.size());
  return weights(*p.data, s).cwiseProduct(s.y - y).squaredNorm();
}

// The same, for pieces of equal length. One that is lost then starts as that of the others does whose start leads
// through it best.
Fit fit_alike(const Problem& p, std::vector<Piece>& pieces, const Fit& from, const std::vector<int>& effects,
              const FitOptions& options) {
  const Fit f = fit_pieces(p, pieces, from, effects, options);
  const auto is_lost = [&](const Piece& piece) { return !(piece.chi2 < lost * rows_of(p, piece)); };
  if (std::none_of(pieces.begin(), pieces.end(), is_lost)) return f;
  const Cut cut(p, pieces);
  std::vector<Piece> again = pieces;
  std::atomic<bool> moved = false;
  side_by_side(pieces.size(), [&](std::size_t k) {
    if (!is_lost(pieces[k])) return;
    double least = pieces[k].chi2;
    for (const Piece& other : pieces) {
      if (is_lost(other)) continue;
      const double chi2 = chi2_from(cut.problem, cut.data.segments[k], f, other.start);
      if (!(chi2 < least)) continue;
      least = chi2;
      again[k].start = other.start;
      moved = true;
    }
  });
  if (!moved) return f;
  const Fit mended = fit_pieces(p, again, f, effects, options);
  if (!(mended.cost() < f.cost())) return f;
  pieces = std::move(again);
  return mended;
}

double cost_of(const Problem& p, const std::vector<Piece>& pieces, const Fit& values) {
  const Cut cut(p, pieces);
  Fit f = values;
  f.start.clear();
  for (const Piece& piece : pieces) f.start.push_back(piece.start);
  const std::vector<double> chi2 = chi2_of_each(cut.problem, cut.all, f);
  return std::accumulate(chi2.begin(), chi2.end(), f.penalty);
}

// Segments cut to `length` samples each, where the machine is as far as a fit knows; those in `whole` are not cut.
std::vector<Piece> cut_to(const Problem& p, const std::vector<int>& segments, const Fit& f, std::size_t length,
                          const std::vector<int>& whole) {
  const std::size_t inputs = p.machine->inputs.size();
  std::vector<Piece> pieces;
  for (const int index : segments) {
    const Segment& s = p.data->segments[static_cast<std::size_t>(index)];
    Start start = f.start[static_cast<std::size_t>(index)];
    if (has(whole, index)) {
      pieces.push_back({index, 0, s.samples(), start});
      continue;
    }
    for (std::size_t begin = 0; begin < s.samples(); begin += length) {
      pieces.push_back({index, begin, std::min(begin + length, s.samples()), start});
      if (begin + length >= s.samples()) break;
      const std::size_t at = s.first + begin;
      const Response on =
          p.machine->values_only(f.values,
                                 Course{std::span(s.t).subspan(at, length + 1),
                                        std::span(s.u).subspan(at * inputs, (length + 1) * inputs), 0, p.h_max},
                                 start);
      if (usable(on.status)) start = on.end;
    }
  }
  return pieces;
}

// Neighbours joined while they are no longer than `length`. What they are worth apart is kept in chi2.
std::vector<Piece> join(const std::vector<Piece>& pieces, std::size_t length) {
  std::vector<Piece> joined;
  for (const Piece& piece : pieces) {
    if (!joined.empty() && joined.back().segment == piece.segment && piece.end - joined.back().begin <= length) {
      Piece& last = joined.back();
      last.end = piece.end;
      last.chi2 += piece.chi2;
      ++last.parts;
    } else {
      joined.push_back(piece);
      joined.back().parts = 1;
    }
  }
  return joined;
}

// The best of starts drawn from what a segment leaves open around one, for a longer one. A step, such as one bounce
// more, may lie between two starts that look the same at first.
Start drawn(const Problem& known, const Segment& s, const Problem& longer, const Segment& more, const Fit& values,
            const Start& around, std::uint64_t seed) {
  constexpr int draws = 64;
  const Response y = sensitivities(known, s, values.values, around, {});
  const auto coordinates = known.machine->free_coordinates(around.chart);
  const auto m = static_cast<Eigen::Index>(coordinates.size());
  if (!usable(y.status)) return around;
  const Eigen::Map<const RowMajor> gradient(y.gradient.data(), s.y.size(), known.machine->width());
  const Eigen::MatrixXd J = weights(*known.data, s).asDiagonal() * gradient.leftCols(m);
  Eigen::MatrixXd information = J.transpose() * J;
  for (Eigen::Index i = 0; i < m; ++i)  // what nothing measured depends on, its guess alone tells
    information(i, i) += 1.0 / std::pow(s.spread_of(static_cast<std::size_t>(i)), 2);
  const Eigen::LLT<Eigen::MatrixXd> factor(information);
  if (factor.info() != Eigen::Success) return around;
  Random random(seed);
  Start best = around;
  double lowest = chi2_from(longer, more, values, around);
  for (int draw = 0; draw < draws; ++draw) {
    Eigen::VectorXd off(m);
    for (double& x : off) x = (draw % 2 == 0 ? 1.0 : 3.0) * random.normal();
    factor.matrixU().solveInPlace(off);
    Start start = around;
    for (std::size_t i = 0; i < coordinates.size(); ++i)
      start.x[static_cast<std::size_t>(coordinates[i])] += off[static_cast<Eigen::Index>(i)];
    const double chi2 = chi2_from(longer, more, values, start);
    if (!(chi2 < lowest)) continue;
    lowest = chi2;
    best = std::move(start);
  }
  return best;
}

// A join that costs more than what it ties can tell ran into a hollow.
double most_of(const Problem& p, const Piece& joined, double apart) { return apart + 15.0 + 0.05 * rows_of(p, joined); }

bool holds(const Problem& p, const Piece& joined, double apart) { return joined.chi2 < most_of(p, joined, apart); }

// From a piece whose start is known to a longer one that ran into a hollow: a little further at a time, and no further
// once its chi squared is past `most`.
Piece follow_on(const Problem& p, const Piece& known, std::size_t end, const Fit& values, double most) {
  const auto cycle = static_cast<std::size_t>(p.data->sections);
  std::vector<Piece> reached = {known};
  while (reached[0].end < end && reached[0].chi2 < most) {
    std::vector<Piece> next = reached;
    const std::size_t length = reached[0].end - reached[0].begin;
    next[0].end = std::min(end, reached[0].end + std::max(cycle, length / 8));
    const Cut before(p, reached), after(p, next);
    next[0].start = drawn(before.problem, before.data.segments[0], after.problem, after.data.segments[0], values,
                          reached[0].start, next[0].end);
    fit_pieces(p, next, values, {}, starts_alone);
    reached = std::move(next);
  }
  return reached[0];
}

// Joins neighbours up to `length` where that holds. False where most of it does not, and all together it is hopeless,
// or where what was to be joined by now is four times as many: they lack something else.
bool join_where_it_holds(const Problem& p, std::vector<Piece>& pieces, Fit& f, const std::vector<int>& effects,
                         std::size_t length, double hopeless, const FitOptions& options = {}) {
  const std::vector<Piece> apart = join(pieces, length);
  std::vector<Piece> joined = apart;
  const Fit together = fit_pieces(p, joined, f, effects, options);
  const bool follows = std::isfinite(together.chi2);
  const auto first_of = [&](std::size_t n) { return pieces.begin() + static_cast<std::ptrdiff_t>(n); };
  struct Stuck {
    std::size_t place;  // of its first part
    Piece piece;
    int parts;
    double apart = 0.0;  // chi squared of its parts
  };
  std::vector<Stuck> stuck;
  std::vector<Piece> mixed, as_before;
  std::size_t joins = 0, n = 0;
  for (std::size_t k = 0; k < joined.size(); ++k) {
    const int parts = joined[k].parts;
    const auto next = n + static_cast<std::size_t>(parts);
    joins += parts > 1;
    if (parts == 1 || (follows ? holds(p, joined[k], apart[k].chi2) : std::isfinite(joined[k].chi2))) {
      mixed.push_back(joined[k]);
      as_before.push_back(apart[k]);
    } else {
      stuck.push_back({mixed.size(), apart[k], parts});
      mixed.insert(mixed.end(), first_of(n), first_of(next));
      as_before.insert(as_before.end(), first_of(n), first_of(next));
    }
    n = next;
  }
  if (stuck.empty()) {
    pieces = std::move(joined);
    f = together;
    return true;
  }
  if (2 * stuck.size() > joins && !(together.chi2 < hopeless)) return false;
  // From where the joins that hold were brought, or from before, if the others spoiled that.
  const bool onward = follows && cost_of(p, mixed, together) < cost_of(p, as_before, f);
  pieces = onward ? std::move(mixed) : std::move(as_before);
  f = fit_pieces(p, pieces, onward ? together : f, effects, options);
  side_by_side(stuck.size(), [&](std::size_t k) {
    Stuck& s = stuck[k];
    const auto at = first_of(s.place);
    s.apart = std::accumulate(at, at + s.parts, 0.0, [](double sum, const Piece& x) { return sum + x.chi2; });
    s.piece = follow_on(p, *at, s.piece.end, f, most_of(p, s.piece, s.apart));
  });
  for (std::size_t k = stuck.size(); k-- > 0;) {  // from the end, so that places stay what they are
    const auto at = first_of(stuck[k].place), last = at + stuck[k].parts - 1;
    if (stuck[k].piece.end < last->end || !holds(p, stuck[k].piece, stuck[k].apart)) continue;
    f.chi2 += stuck[k].piece.chi2 - stuck[k].apart;
    *at = stuck[k].piece;
    pieces.erase(at + 1, last + 1);
  }
  return pieces.size() <= 4 * joined.size();
}

// The last joins where the values that the pieces leave open decide which way the machine goes: from values drawn
// from what they leave, with the starts that go with them, until every join holds.
void join_at_drawn_values(const Problem& p, std::vector<Piece>& pieces, Fit& f, const std::vector<int>& effects,
                          std::size_t length) {
  constexpr int draws = 12;
  constexpr double far = 50.0;  // [-] of chi squared above the best that pieces alone have
  Random random(pieces.size());
  std::vector<int> segments;
  for (const Piece& piece : pieces) segments = with(segments, piece.segment);
  for (int draw = 0; draw < draws; ++draw) {
    Fit moved = drawn_values(p, f, random);
    std::vector<Piece> there = pieces;
    moved = fit_pieces(p, there, moved, {}, starts_alone);
    if (!(moved.cost() < f.cost() + far)) continue;
    join_where_it_holds(p, there, moved, {}, length, std::numeric_limits<double>::infinity(), starts_alone);
    if (there.size() > segments.size()) continue;
    f = fit_pieces(p, there, moved, effects);
    pieces = std::move(there);
    return;
  }
}

}  // namespace

Fit fit_growing(const Problem& p, const std::vector<int>& segments, const Fit& from, const std::vector<int>& effects,
                double hopeless, const std::vector<int>& whole) {
  const auto cycle = static_cast<std::size_t>(p.data->sections);
  std::size_t longest = 0;
  for (const int s : segments) longest = std::max(longest, p.data->segments[static_cast<std::size_t>(s)].samples());
  std::vector<Piece> pieces = cut_to(p, segments, from, cycle, whole);
  // Cycle by cycle any parameter would fill a gap; the starts come first.
  Fit f = fit_alike(p, pieces, from, effects, starts_alone), none = from;
  none.chi2 = std::numeric_limits<double>::infinity();
  for (std::size_t length = cycle; length < 2 * longest; length *= 2) {
    if (length > cycle && !join_where_it_holds(p, pieces, f, effects, length, hopeless)) return none;
    if (length >= longest && pieces.size() > segments.size()) {  // once more, with what the others taught
      join_where_it_holds(p, pieces, f, effects, length, hopeless);
      if (pieces.size() > segments.size()) join_at_drawn_values(p, pieces, f, effects, length);
      if (pieces.size() > segments.size()) {
        pieces = join(pieces, length);
        f = fit_pieces(p, pieces, f, effects);
      }
    }
    if (!(f.chi2 < hopeless)) return none;
  }
  f.start = from.start;
  for (const Piece& piece : pieces) f.start[static_cast<std::size_t>(piece.segment)] = piece.start;
  return f;
}

double scan(const Problem& p, const std::vector<int>& segments, const Fit& from, int effect) {
  constexpr std::size_t most_cycles = 16;  // of each segment: enough for a first value
  const auto at = static_cast<std::size_t>(effect);
  const Coefficient& c = p.machine->coefficients[at];
  const auto cycle = static_cast<std::size_t>(p.data->sections);
  constexpr FitOptions starts{.refit_parameters = false, .iterations = 6, .enough = 1.0};
  using Lengths = std::vector<std::size_t>;                      // [cycle]
  const auto cost = [&](double value, const Lengths& lengths) {  // [-] of what it is where every run is lost
    Fit f = from;
    f.values[at] = c.nominal + value;
    double sum = 0.0, most = 0.0;
    for (const std::size_t n : lengths) {
      std::vector<Piece> pieces;
      for (const Piece& piece : cut_to(p, segments, f, n * cycle, {})) {
        if (piece.end <= most_cycles * cycle) pieces.push_back(piece);
      }
      if (!std::isfinite(fit_alike(p, pieces, f, {}, starts).chi2)) return std::numeric_limits<double>::infinity();
      for (const Piece& piece : pieces) {
        sum += std::min(piece.chi2, lost * rows_of(p, piece));
        most += lost * rows_of(p, piece);
      }
    }
    return sum / most;
  };
  double best = std::numeric_limits<double>::quiet_NaN(), lowest = std::numeric_limits<double>::infinity();
  const auto look = [&](double value, const Lengths& lengths) {
    const double now = cost(value, lengths);
    if (!(now < lowest)) return;
    lowest = now;
    best = value;
  };
  const double least = 0.1 * c.probe;
  int rising = 0;
  for (int k = 0; k <= 10 && rising < 3; ++k) {
    const double before = lowest;
    look(least * std::exp2(k), {1});
    rising = lowest < before ? 0 : rising + 1;
  }
  if (!(lowest < 0.95) || best == least) return std::numeric_limits<double>::quiet_NaN();
  const auto refine = [&](const Lengths& lengths, double step, double finest) {  // [octave]
    lowest = cost(best, lengths);
    for (; step >= finest; step *= 0.5) {
      const double middle = best;
      look(middle * std::exp2(step), lengths);
      look(middle / std::exp2(step), lengths);
    }
  };
  refine({2}, 0.5, 0.03);
  refine({2, 4}, 0.03, 0.015);
  return best;
}

}  // namespace saltus::diagnosis
