#include "record_identification.hpp"

#include <unsupported/Eigen/FFT>

#include <algorithm>
#include <map>
#include <memory>

namespace saltus {
namespace {

constexpr double excited = 1e-3;  // [-] of the largest line: a tone, not rounding of the file

struct Excitation {
  std::vector<int> lines;
  std::vector<Complex> u;  // (1/L) sum_n u(n) exp(-2 pi i q n / L)
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

// The tones of a period; those that answer on each other's lines are left out and named in the notes.
Excitation find_tones(const std::vector<double>& period, int cycles, int id, std::vector<std::string>& notes) {
  Eigen::FFT<double> fft;
  std::vector<Complex> spectrum;
  fft.fwd(spectrum, period);
  const auto length = static_cast<int>(period.size());
  double largest = 0.0;
  for (int q = 1; 2 * q <= length; ++q) largest = std::max(largest, std::abs(spectrum[static_cast<std::size_t>(q)]));
  Excitation r;
  if (!(largest > 1e-12 * length)) return r;
  std::map<int, std::vector<int>> classes;
  for (int q = 1; 2 * q <= length; ++q) {
    if (std::abs(spectrum[static_cast<std::size_t>(q)]) > excited * largest)
      classes[residue_class(q, cycles)].push_back(q);
  }
  for (const auto& [residue, lines] : classes) {
    if (lines.size() == 1 && identifiable(lines[0], cycles)) {
      r.lines.push_back(lines[0]);
      r.u.push_back(spectrum[static_cast<std::size_t>(lines[0])] / static_cast<double>(length));
      continue;
    }
    if (notes.size() < 20) {
      std::string text = "experiment " + std::to_string(id) + ": left out " + std::to_string(lines.size()) +
                         " tone(s) of class " + std::to_string(residue) + " (lines";
      for (std::size_t i = 0; i < std::min<std::size_t>(lines.size(), 6); ++i) text += " " + std::to_string(lines[i]);
      notes.push_back(text + (lines.size() > 6 ? " ..." : "") + "): their responses fall on the same output lines");
    }
  }
  return r;
}

// The mean over the cycles from sample `begin` to `end`: on multiples of the pumping frequency, where no tone is, so
// that subtracting it changes no estimate and makes a missing sample neutral.
template <class Sample>
std::vector<Sample> mean_cycle(const std::vector<double>& y, std::int64_t begin, std::int64_t end, int sections) {
  std::vector<Sample> mean(static_cast<std::size_t>(sections), Sample{});
  std::vector<std::int64_t> count(mean.size(), 0);
  for (std::int64_t i = begin; i < end; ++i) {
    const double v = y[static_cast<std::size_t>(i)];
    const auto s = static_cast<std::size_t>(i % sections);
    if (std::isfinite(v)) mean[s][0] += (v - mean[s][0]) / static_cast<double>(++count[s]);
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
  // Periods of which every output that there is was measured.
  void give(ClassScatter& to, std::span<const int> tones, int outputs) const {
    for (std::size_t k = 0; k < tones_; ++k) {
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
  if (record.inputs.size() != 1) {
    refuse("harmonic transfer functions are identified for one input at a time", "keep one column in `# inputs`");
  }
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
  using Estimator = LineEstimator<1>;
  const auto estimator = std::make_unique<Estimator>();
  bool any_period = false, any_tone = false;
  for (const Experiment& e : experiments(record)) {
    const Grid grid = on_grid(record, e);
    const std::string experiment = "experiment " + std::to_string(e.id);
    // The record's own cycle count decides the phase of the stimulus, and the settling where it counts from 0.
    const std::int64_t first_sample = static_cast<std::int64_t>(grid.first_cycle) * sections;
    const std::int64_t skipped = settling_cycles(record, grid);
    const bool counts_on = settle > 0 && grid.first_cycle >= settle;
    const std::int64_t begin = skipped * sections;
    const std::int64_t end = begin + (std::int64_t{grid.cycles} * sections - begin) / length * length;
    if (end <= begin) {
      id.notes.push_back(experiment + ": shorter than one stimulus period after settling, not used");
      continue;
    }
    any_period = true;
    if (counts_on) {
      id.notes.push_back(experiment + ": begins at cycle " + std::to_string(grid.first_cycle) + ", its first " +
                         std::to_string(settle) + " cycles left out as settling");
    }
    const std::vector<double> u = mean_period(record, e, grid.inputs[0], length, static_cast<std::size_t>(begin));
    // Slot 0 of the mean is sample 0 of the grid; the estimator counts from the record's cycle 0.
    std::vector<double> aligned(u.size());
    for (std::size_t n = 0; n < u.size(); ++n) {
      aligned[static_cast<std::size_t>(wrap(first_sample + static_cast<std::int64_t>(n), length))] = u[n];
    }
    const Excitation tones = find_tones(aligned, period, e.id, id.notes);
    any_tone = any_tone || !tones.lines.empty();
    id.samples += end - begin;
    id.missing += count_missing(grid, begin, end);
    for (std::size_t from = 0; from < tones.lines.size(); from += max_tones) {
      const std::size_t n = std::min<std::size_t>(max_tones, tones.lines.size() - from);
      const std::span<const int> lines(tones.lines.data() + from, n);
      Periods periods(n, harmonics, grid.outputs.size());
      int measured = 0;
      for (std::size_t c = 0; c < grid.outputs.size(); ++c) {
        const std::vector<double>& y = grid.outputs[c];
        if (estimator->configure(sections, period, lines, harmonics) != Status::ok ||
            estimator->set_baseline(mean_cycle<Estimator::Sample>(y, begin, end, sections)) != Status::ok) {
          refuse("the estimator cannot take it", "thin the record");
        }
        for (std::int64_t i = begin; i < end; ++i) {
          const std::int64_t before = estimator->periods();
          const Status s = estimator->push(first_sample + i, {y[static_cast<std::size_t>(i)]});
          id.worst = worse(id.worst, s);
          if (estimator->periods() != before) periods.take((i - begin) / length, *estimator, c);
        }
        const int holes = estimator->holes();
        if (holes > 0 && from == 0) {
          id.notes.push_back(experiment + ": " + std::to_string(holes) + " of the " + std::to_string(length) +
                             " samples of a stimulus period were never measured of " + record.outputs[c].name +
                             (holes == length ? ", which is left out" : " and count as undisturbed"));
        }
        if (holes == length) continue;
        ++measured;
        collect(*estimator, std::span<const Complex>(tones.u.data() + from, n), static_cast<int>(c), 1, id, noise);
      }
      periods.give(noise.classes, lines, measured);
    }
  }
  if (!any_period) {
    refuse("no experiment has a whole stimulus period after its settling cycles",
           "record longer, or correct `# settle-cycles`");
  }
  if (!any_tone) {
    refuse("no experiment excites the machine on lines that can be told apart",
           "record a stimulus; see `saltus design --help`");
  }
  for (std::size_t c = 0; c < record.outputs.size(); ++c) {
    if (!id.select(0, static_cast<int>(c)).empty()) continue;
    refuse(("nothing was measured of " + record.outputs[c].name + " where the machine is excited").c_str(),
           "fill its column");
  }
  finish(id, noise);
  return id;
}

}  // namespace saltus
