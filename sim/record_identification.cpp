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

}  // namespace

Identification identify_record(const Record& record, int harmonics) {
  const auto refuse = [&](const char* what, const char* mend) { throw RecordError(record.name, what, mend); };
  if (!record.clock_paced()) {
    refuse("its sections are not paced by a clock",
           "give `# sections: clock` and `# sections-per-cycle`, with columns cycle and section");
  }
  if (!record.stimulus_period_cycles) refuse("it names no stimulus period", "give `# stimulus-period-cycles: P`");
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

  Identification id;
  id.sections = sections;
  id.period = period;
  LineNoise noise;
  using Estimator = LineEstimator<1>;
  const auto estimator = std::make_unique<Estimator>();
  bool any_period = false;
  for (const Experiment& e : experiments(record)) {
    const Grid grid = on_grid(record, e);
    // The record's own cycle count decides the settling and the phase of the stimulus.
    const std::int64_t first_sample = static_cast<std::int64_t>(grid.first_cycle) * sections;
    const std::int64_t begin = std::max<std::int64_t>(0, settle - grid.first_cycle) * sections;
    const auto available = static_cast<std::int64_t>(grid.cycles) * sections - begin;
    if (available < length) {
      id.notes.push_back("experiment " + std::to_string(e.id) +
                         ": shorter than one stimulus period after settling, not used");
      continue;
    }
    any_period = true;
    const std::vector<double> u = mean_period(record, e, grid.inputs[0], length, static_cast<std::size_t>(begin));
    // Slot 0 of the mean is sample 0 of the grid; the estimator counts from the record's cycle 0.
    std::vector<double> aligned(u.size());
    for (std::size_t n = 0; n < u.size(); ++n) {
      aligned[static_cast<std::size_t>(wrap(first_sample + static_cast<std::int64_t>(n), length))] = u[n];
    }
    const Excitation tones = find_tones(aligned, period, e.id, id.notes);
    id.samples += available / length * length;
    id.missing += static_cast<std::int64_t>(grid.missing_rows);
    for (std::size_t from = 0; from < tones.lines.size(); from += max_tones) {
      const std::size_t n = std::min<std::size_t>(max_tones, tones.lines.size() - from);
      const std::span<const int> lines(tones.lines.data() + from, n);
      for (std::size_t c = 0; c < grid.outputs.size(); ++c) {
        const std::vector<double>& y = grid.outputs[c];
        // The mean cycle lies on multiples of the pumping frequency, where no tone is: subtracting it changes no
        // estimate and makes a missing sample neutral.
        std::vector<Estimator::Sample> baseline(static_cast<std::size_t>(sections), Estimator::Sample{});
        for (int s = 0; s < sections; ++s) {
          double sum = 0.0;
          std::int64_t count = 0;
          for (std::int64_t i = begin + s; i < begin + available / length * length; i += sections) {
            const double v = y[static_cast<std::size_t>(i)];
            if (std::isfinite(v)) sum += v, ++count;
          }
          if (count > 0) baseline[static_cast<std::size_t>(s)][0] = sum / static_cast<double>(count);
        }
        if (estimator->configure(sections, period, lines, std::min(harmonics, max_harmonics)) != Status::ok ||
            estimator->set_baseline(baseline) != Status::ok) {
          refuse("the estimator cannot take it", "thin the record");
        }
        for (std::int64_t i = begin; i < begin + available / length * length; ++i) {
          const Status s = estimator->push(first_sample + i, {y[static_cast<std::size_t>(i)]});
          id.worst = worse(id.worst, s);
        }
        collect(*estimator, std::span<const Complex>(tones.u.data() + from, n), static_cast<int>(c), 1, id, noise);
      }
    }
  }
  if (!any_period)
    refuse("no experiment has a whole stimulus period after its settling cycles",
           "record longer, or correct `# settle-cycles`");
  if (id.htf.empty())
    refuse("no experiment excites the machine on lines that can be told apart",
           "record a stimulus; see `saltus design --help`");
  finish(id, noise);
  return id;
}

}  // namespace saltus
