#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "record.hpp"

namespace saltus {
namespace {

constexpr std::int64_t longest_grid = std::int64_t{1}
                                      << 25;  // [-] samples: the reader's longest experiment and its ends

// A missing input is that of the nearest repeat before it, or else of the first one after it. Returns how many were.
std::size_t fill_from_repeats(std::vector<double>& u, std::size_t period) {
  std::size_t filled = 0;
  const auto take = [&](std::size_t to, std::size_t from) {
    if (!std::isnan(u[to]) || std::isnan(u[from])) return;
    u[to] = u[from];
    ++filled;
  };
  for (std::size_t i = period; i < u.size(); ++i) take(i, i - period);
  for (std::size_t i = u.size(); i-- > period;) take(i - period, i);
  return filled;
}

}  // namespace

std::vector<Experiment> experiments(const Record& record) {
  std::vector<Experiment> list;
  for (std::size_t row = 0; row < record.experiment.size(); ++row) {
    if (list.empty() || list.back().id != record.experiment[row]) list.push_back({record.experiment[row], row, 0});
    ++list.back().rows;
  }
  return list;
}

Grid on_grid(const Record& record, const Experiment& experiment) {
  if (!record.sections_per_cycle) {
    throw RecordError(record.name, "the record is not sampled at sections of a cycle",
                      "give it the columns `cycle` and `section`, and `# sections-per-cycle: N`");
  }
  const std::size_t first = experiment.first_row;
  const std::size_t end = first + experiment.rows;
  const auto has_rows = [end](const Channel& c) { return c.values.size() >= end; };
  const auto refuse = [&](const char* what) {
    throw RecordError(record.name, "experiment " + std::to_string(experiment.id) + ": " + what,
                      "take it from experiments(record), and the record from read_record");
  };
  if (end <= first || record.cycle.size() < end || record.section.size() < end ||
      !std::all_of(record.inputs.begin(), record.inputs.end(), has_rows) ||
      !std::all_of(record.outputs.begin(), record.outputs.end(), has_rows)) {
    refuse("it has no rows, or not in every column");
  }

  Grid grid;
  grid.sections = *record.sections_per_cycle;
  grid.first_cycle = record.cycle[first];
  const std::int64_t cycles = std::int64_t{record.cycle[end - 1]} - grid.first_cycle + 1;
  if (cycles < 1 || grid.sections < 1 || cycles > longest_grid / grid.sections) refuse("its cycles span no grid");
  grid.cycles = static_cast<int>(cycles);

  const auto samples = static_cast<std::size_t>(cycles * grid.sections);
  std::vector<std::size_t> sample(experiment.rows);  // of each row
  std::int64_t previous = -1;                        // rising to the last row, so that every sample lies in the grid
  for (std::size_t i = 0; i < sample.size(); ++i) {
    const std::int64_t cycle = std::int64_t{record.cycle[first + i]} - grid.first_cycle;
    const std::int64_t section = record.section[first + i];
    const std::int64_t here = cycle * grid.sections + section;
    if (section < 0 || section >= grid.sections || here <= previous) refuse("its rows are not in order");
    sample[i] = static_cast<std::size_t>(here);
    previous = here;
  }
  grid.missing_rows = samples - experiment.rows;

  const auto lay_out = [&](const std::vector<Channel>& channels, std::vector<std::vector<double>>& dense) {
    for (const Channel& c : channels) {
      std::vector<double>& values = dense.emplace_back(samples, std::numeric_limits<double>::quiet_NaN());
      for (std::size_t i = 0; i < sample.size(); ++i) values[sample[i]] = c.values[first + i];
    }
  };
  lay_out(record.inputs, grid.inputs);
  lay_out(record.outputs, grid.outputs);

  for (std::vector<double>& u : grid.inputs) {
    if (record.stimulus_period_cycles && *record.stimulus_period_cycles > 0) {
      const std::size_t period =
          static_cast<std::size_t>(*record.stimulus_period_cycles) * static_cast<std::size_t>(grid.sections);
      grid.filled_inputs += fill_from_repeats(u, period);
    }
    grid.missing_inputs +=
        static_cast<std::size_t>(std::count_if(u.begin(), u.end(), [](double v) { return std::isnan(v); }));
  }
  return grid;
}

int settling_cycles(const Record& record, const Grid& grid) {
  const int settle = record.settle_cycles.value_or(0);
  return settle > 0 && grid.first_cycle >= settle ? settle : std::max(0, settle - grid.first_cycle);
}

}  // namespace saltus
