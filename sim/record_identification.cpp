#include "record_identification.hpp"

#include <unsupported/Eigen/FFT>

#include <algorithm>
#include <limits>
#include <map>
#include <memory>
#include <set>

namespace saltus {
namespace {

constexpr double excited = 1e-3;  // [-] of the largest line: a tone, not rounding of the file

struct Excitation {
  std::vector<int> lines;                  // that the estimator follows
  std::vector<Complex> u;                  // (1/L) sum_n u(n) exp(-2 pi i q n / L) there; none with several inputs
  std::vector<LineEquations::Tone> tones;  // what one experiment alone does not tell
  std::vector<double> constant, largest;   // of each input, and its largest line
};

// An experiment, cut to whole stimulus periods.
struct Part {
  int id = 0;
  Grid grid;
  std::int64_t first_sample = 0, begin = 0, end = 0;
  Excitation tones;
};

// One stimulus period of the input, averaged over the repeats.
std::vector<double> mean_period(const Record& record, const Experiment& e, const std::vector<double>& u, int length,
                                std::size_t first) {
  std::vector<double> mean(static_cast<std::size_t>(length), 0.0);
  std::vector<int> count(static_cast<std::size_t>(length), 0);
  double largest = 0.0;
  for (std::size_t n = first; n < u.size(); ++n) {
    if (!std::isfinite(u[n])) continue;
    const std::size_t slot = n % mean.size();
    ++count[slot];
    mean[slot] += (u[n] - mean[slot]) / count[slot];
    largest = std::max(largest, std::abs(u[n]));
  }
  for (std::size_t n = first; n < u.size(); ++n) {
    const std::size_t slot = n % mean.size();
    if (std::isfinite(u[n]) && std::abs(u[n] - mean[slot]) > 1e-4 * largest) {
      throw RecordError(record.name,
                        "the input of experiment " + std::to_string(e.id) + " does not repeat with the stimulus period",
                        "correct `# stimulus-period-cycles`, or record a periodic stimulus");
    }
  }
  for (const int c : count) {
    if (c == 0) {
      throw RecordError(record.name, "experiment " + std::to_string(e.id) + " has inputs that no repeat tells",
                        "record more than one stimulus period, or fill the input column");
    }
  }
  return mean;
}

// The tones of a period of each input; those that answer on each other's lines are left out and named in the notes.
// What comes of half multiples of the pumping frequency, and of several inputs, all experiments decide together.
Excitation find_tones(const std::vector<std::vector<double>>& inputs, int cycles, int id,
                      std::vector<std::string>& notes) {
  Excitation r;
  std::vector<std::vector<Complex>> spectra;
  std::map<int, std::set<int>> classes;
  for (const std::vector<double>& period : inputs) {
    Eigen::FFT<double> fft;
    std::vector<Complex> spectrum;
    fft.fwd(spectrum, period);
    for (Complex& u : spectrum) u /= static_cast<double>(period.size());
    const auto length = static_cast<int>(period.size());
    const auto size = [&](int q) { return std::abs(spectrum[static_cast<std::size_t>(q)]); };
    double largest = 0.0;
    for (int q = 1; 2 * q <= length; ++q) largest = std::max(largest, size(q));
    r.constant.push_back(spectrum[0].real());
    r.largest.push_back(largest);
    for (int q = 1; largest > 1e-12 && 2 * q <= length; ++q) {
      if (size(q) > excited * largest) classes[residue_class(q, cycles)].insert(q);
    }
    spectra.push_back(std::move(spectrum));
  }
  for (const auto& [residue, lines] : classes) {
    const bool alone = identifiable(*lines.begin(), cycles);
    if (!alone || lines.size() == 1) {
      for (const int q : lines) {
        const auto at = static_cast<std::size_t>(q);
        for (std::size_t j = 0; j < spectra.size(); ++j) {
          if (!alone || spectra.size() > 1) r.tones.push_back({q, spectra[j][at], static_cast<int>(j)});
        }
        if (residue == 0) continue;
        r.lines.push_back(q);
        if (spectra.size() == 1) r.u.push_back(spectra[0][at]);
      }
      continue;
    }
    if (notes.size() < 20) {
      std::string text = "experiment " + std::to_string(id) + ": left out " + std::to_string(lines.size()) +
                         " tone(s) of class " + std::to_string(residue) + " (lines";
      int shown = 0;
      for (const int q : lines) {
        if (++shown <= 6) text += " " + std::to_string(q);
      }
      notes.push_back(text + (shown > 6 ? " ..." : "") + "): their responses fall on the same output lines");
    }
  }
  return r;
}

// A constant that is the same in all experiments belongs to the machine's cycle; one that differs is a tone on line 0.
void find_constants(std::vector<Part>& parts, std::size_t inputs) {
  for (std::size_t j = 0; j < inputs; ++j) {
    double low = std::numeric_limits<double>::infinity(), high = -low, largest = 0.0;
    for (const Part& p : parts) {
      low = std::min(low, p.tones.constant[j]);
      high = std::max(high, p.tones.constant[j]);
      largest = std::max({largest, p.tones.largest[j], std::abs(p.tones.constant[j])});
    }
    if (!(high - low > excited * largest)) continue;
    for (Part& p : parts) p.tones.tones.push_back({0, p.tones.constant[j], static_cast<int>(j)});
  }
}

// The mean over the cycles from sample `begin` to `end`: on multiples of the pumping frequency, where it is put back
// when they are wanted, so that subtracting it changes no estimate and makes a missing sample neutral.
std::vector<double> mean_cycle(const std::vector<double>& y, std::int64_t begin, std::int64_t end, int sections) {
  std::vector<double> mean(static_cast<std::size_t>(sections), 0.0);
  std::vector<std::int64_t> count(mean.size(), 0);
  for (std::int64_t i = begin; i < end; ++i) {
    const double v = y[static_cast<std::size_t>(i)];
    const auto s = static_cast<std::size_t>(i % sections);
    if (std::isfinite(v)) mean[s] += (v - mean[s]) / static_cast<double>(++count[s]);
  }
  return mean;
}

// Samples at which some output was not measured.
std::int64_t count_missing(const Grid& grid, std::int64_t begin, std::int64_t end) {
  std::int64_t n = 0;
  for (std::int64_t i = begin; i < end; ++i) {
    n += std::any_of(grid.outputs.begin(), grid.outputs.end(),
                     [i](const std::vector<double>& y) { return !std::isfinite(y[static_cast<std::size_t>(i)]); });
  }
  return n;
}

// The lines of all outputs, stimulus period by stimulus period, to see how they scatter together.
class Periods {
 public:
  Periods(std::size_t tones, int harmonics, std::size_t outputs)
      : tones_(tones), orders_(2 * harmonics + 1), outputs_(static_cast<Eigen::Index>(outputs)) {}

  // What an estimator of one output has at the end of a period.
  void take(std::int64_t period, const LineEstimator<1>& estimator, std::size_t output) {
    auto& [lines, filled] = of_[period];
    lines.resize(tones_, Eigen::VectorXcd::Zero(orders_ * outputs_));
    ++filled;
    for (std::size_t k = 0; k < tones_; ++k) {
      for (int i = 0; i < orders_; ++i) {
        lines[k][static_cast<Eigen::Index>(output) * orders_ + i] =
            estimator.line(static_cast<int>(k), i - estimator.harmonics(), 0);
      }
    }
  }
  // Periods of which every output that there is was measured. On half multiples of the pumping frequency errors are
  // not circular, and no covariance alone tells how they go together.
  void give(ClassScatter& to, std::span<const int> tones, int cycles, int outputs) const {
    for (std::size_t k = 0; k < tones_; ++k) {
      if (!identifiable(tones[k], cycles)) continue;
      std::vector<Eigen::VectorXcd> whole;
      for (const auto& [period, of] : of_) {
        if (of.second == outputs) whole.push_back(of.first[k]);
      }
      to.add(tones[k], (orders_ - 1) / 2, whole);
    }
  }

 private:
  std::size_t tones_;
  int orders_;
  Eigen::Index outputs_;
  std::map<std::int64_t, std::pair<std::vector<Eigen::VectorXcd>, int>> of_;
};

}  // namespace

Identification identify_record(const Record& record, int harmonics) {
  const auto refuse = [&](const char* what, const char* mend) { throw RecordError(record.name, what, mend); };
  if (!record.clock_paced()) {
    refuse("its sections are not paced by a clock",
           "give `# sections: clock` and `# sections-per-cycle`, with columns cycle and section");
  }
  if (!record.stimulus_period_cycles)
    refuse("it names no stimulus period", "give `# stimulus-period-cycles: P`, or add --any");
  if (record.inputs.empty()) refuse("it has no input", "name the column of the stimulus in `# inputs`");
  const int sections = *record.sections_per_cycle;
  const int period = *record.stimulus_period_cycles;
  if (sections > 256 || period > 512) {
    refuse("more than 256 sections a cycle or 512 cycles a stimulus period", "thin the record");
  }
  const int settle = record.settle_cycles.value_or(0);
  const int length = sections * period;
  harmonics = std::min({harmonics, max_harmonics, (sections - 1) / 2});  // beyond, H_m is H_(m - sections) again

  Identification id;
  id.sections = sections;
  id.period = period;
  LineNoise noise;
  LineEquations equations(sections, period);
  using Estimator = LineEstimator<1>;
  const auto estimator = std::make_unique<Estimator>();
  std::vector<Part> parts;
  for (const Experiment& e : experiments(record)) {
    Part p{e.id, on_grid(record, e), 0, 0, 0, {}};
    const std::string experiment = "experiment " + std::to_string(e.id);
    // The record's own cycle count decides the phase of the stimulus, and the settling where it counts from 0.
    p.first_sample = static_cast<std::int64_t>(p.grid.first_cycle) * sections;
    const bool counts_on = settle > 0 && p.grid.first_cycle >= settle;
    p.begin = std::int64_t{settling_cycles(record, p.grid)} * sections;
    p.end = p.begin + (std::int64_t{p.grid.cycles} * sections - p.begin) / length * length;
    if (p.end <= p.begin) {
      id.notes.push_back(experiment + ": shorter than one stimulus period after settling, not used");
      continue;
    }
    if (counts_on) {
      id.notes.push_back(experiment + ": begins at cycle " + std::to_string(p.grid.first_cycle) + ", its first " +
                         std::to_string(settle) + " cycles left out as settling");
    }
    std::vector<std::vector<double>> inputs;
    for (const std::vector<double>& input : p.grid.inputs) {
      const std::vector<double> u = mean_period(record, e, input, length, static_cast<std::size_t>(p.begin));
      // Slot 0 of the mean is sample 0 of the grid; the estimator counts from the record's cycle 0.
      std::vector<double> aligned(u.size());
      for (std::size_t n = 0; n < u.size(); ++n) {
        aligned[static_cast<std::size_t>(wrap(p.first_sample + static_cast<std::int64_t>(n), length))] = u[n];
      }
      inputs.push_back(std::move(aligned));
    }
    p.tones = find_tones(inputs, period, e.id, id.notes);
    parts.push_back(std::move(p));
  }
  find_constants(parts, record.inputs.size());
  const bool pumped = std::any_of(parts.begin(), parts.end(), [&](const Part& p) {
    const auto& all = p.tones.tones;
    return std::any_of(all.begin(), all.end(), [&](const auto& t) { return residue_class(t.line, period) == 0; });
  });
  for (const Part& p : parts) {
    const Excitation& tones = p.tones;
    id.samples += p.end - p.begin;
    id.missing += count_missing(p.grid, p.begin, p.end);
    equations.begin(tones.tones);
    std::vector<Periods> periods;  // of the tones that are followed at a time
    for (std::size_t from = 0; from < tones.lines.size(); from += max_tones) {
      periods.emplace_back(std::min<std::size_t>(max_tones, tones.lines.size() - from), harmonics,
                           p.grid.outputs.size());
    }
    int measured = 0;
    for (std::size_t c = 0; c < p.grid.outputs.size(); ++c) {
      const std::vector<double>& y = p.grid.outputs[c];
      const std::vector<double> cycle = mean_cycle(y, p.begin, p.end, sections);
      std::vector<Estimator::Sample> baseline;
      for (const double v : cycle) baseline.push_back({v});
      // What the configured estimator makes of the output; false where nothing was measured of it.
      const auto listen = [&](Status configured, Periods* one_by_one) {
        if (configured != Status::ok || estimator->set_baseline(baseline) != Status::ok) {
          refuse("the estimator cannot take it", "thin the record");
        }
        for (std::int64_t i = p.begin; i < p.end; ++i) {
          const std::int64_t before = estimator->periods();
          const Status s = estimator->push(p.first_sample + i, {y[static_cast<std::size_t>(i)]});
          id.worst = worse(id.worst, s);
          if (one_by_one != nullptr && estimator->periods() != before)
            one_by_one->take((i - p.begin) / length, *estimator, c);
        }
        return estimator->holes() < length;
      };
      for (std::size_t from = 0; from < tones.lines.size(); from += max_tones) {
        const std::size_t n = std::min<std::size_t>(max_tones, tones.lines.size() - from);
        const std::span<const int> lines(tones.lines.data() + from, n);
        const bool heard = listen(estimator->configure(sections, period, lines, harmonics), &periods[from / max_tones]);
        const int holes = estimator->holes();
        if (holes > 0 && from == 0) {
          id.notes.push_back("experiment " + std::to_string(p.id) + ": " + std::to_string(holes) + " of the " +
                             std::to_string(length) + " samples of a stimulus period were never measured of " +
                             record.outputs[c].name + (heard ? " and count as undisturbed" : ", which is left out"));
        }
        if (!heard) continue;
        measured += from == 0;
        const auto u = std::span<const Complex>(tones.u).subspan(tones.u.empty() ? 0 : from, tones.u.empty() ? 0 : n);
        collect(*estimator, u, static_cast<int>(c), 1, id, noise, equations);
      }
      if (pumped && listen(follow_pump(*estimator, sections, period), nullptr)) {
        collect_pump(*estimator, cycle, static_cast<int>(c), 1, noise, equations);
      }
    }
    for (std::size_t i = 0; i < periods.size(); ++i) {
      const std::size_t from = i * max_tones, n = std::min<std::size_t>(max_tones, tones.lines.size() - from);
      periods[i].give(noise.classes, std::span<const int>(tones.lines.data() + from, n), period, measured);
    }
  }
  equations.solve(harmonics, id);
  const bool any_tone = !id.htf.empty() || std::any_of(parts.begin(), parts.end(), [&](const Part& p) {
    const auto& all = p.tones.lines;
    return !p.tones.u.empty() && std::any_of(all.begin(), all.end(), [&](int q) { return identifiable(q, period); });
  });
  if (parts.empty()) {
    refuse("no experiment has a whole stimulus period after its settling cycles",
           "record longer, or correct `# settle-cycles`");
  }
  if (!any_tone) {
    refuse("no experiment excites the machine on lines that can be told apart",
           "record a stimulus; see `saltus design --help`");
  }
  for (std::size_t c = 0; c < record.outputs.size(); ++c) {
    const auto of_it = [c](const HtfEstimate& h) { return h.output == static_cast<int>(c); };
    if (std::any_of(id.htf.begin(), id.htf.end(), of_it)) continue;
    refuse(("nothing was measured of " + record.outputs[c].name + " where the machine is excited").c_str(),
           "fill its column");
  }
  finish(id, noise);
  return id;
}

}  // namespace saltus
