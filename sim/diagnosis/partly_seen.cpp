#include "partly_seen.hpp"

#include <algorithm>

namespace saltus::diagnosis {
namespace {

class PartlySeen final : public Machine {
 public:
  PartlySeen(const Machine& whole, std::vector<std::size_t> seen)
      : Machine(whole), whole_(whole), seen_(std::move(seen)) {
    outputs.clear();
    for (const std::size_t j : seen_) outputs.push_back(whole.outputs[j]);
    for (const Channel& o : whole.outputs) {
      if (std::any_of(outputs.begin(), outputs.end(), [&](const Channel& s) { return s.name == o.name; })) continue;
      for (Coefficient& c : coefficients) {
        if (c.of_sensor() && c.name.ends_with("@" + o.name)) c.candidate = false;
      }
    }
  }

  int starts() const override { return whole_.starts(); }
  int directions() const override { return whole_.directions(); }
  int width() const override { return whole_.width(); }
  std::vector<int> free_coordinates(int chart) const override { return whole_.free_coordinates(chart); }
  std::vector<Start> cycle(std::span<const double> values, int turns, int per_turn) const override {
    return whole_.cycle(values, turns, per_turn);
  }
  Response run(std::span<const double> values, const Course& course, const Start& start, std::span<const int> wanted,
               bool derivatives) const override {
    Response r = whole_.run(values, course, start, wanted, derivatives);
    const std::size_t ny = whole_.outputs.size(), samples = r.rows / ny;
    const auto per_row = static_cast<std::size_t>(width());
    std::size_t row = 0;
    for (std::size_t i = 0; i < samples; ++i) {
      for (const std::size_t j : seen_) {
        const std::size_t from = i * ny + j;
        r.y[row] = r.y[from];
        if (derivatives) {
          std::copy_n(r.gradient.begin() + static_cast<std::ptrdiff_t>(from * per_row), per_row,
                      r.gradient.begin() + static_cast<std::ptrdiff_t>(row * per_row));
        }
        ++row;
      }
    }
    r.rows = row;
    r.y.resize(row);
    if (derivatives) r.gradient.resize(row * per_row);
    return r;
  }

 private:
  const Machine& whole_;
  std::vector<std::size_t> seen_;
};

}  // namespace

std::unique_ptr<Machine> as_recorded(const Machine& machine, const Record& record) {
  std::vector<std::size_t> seen;
  for (std::size_t j = 0; j < machine.outputs.size(); ++j) {
    const auto named = [&](const auto& c) { return c.name == machine.outputs[j].name; };
    if (std::any_of(record.outputs.begin(), record.outputs.end(), named)) seen.push_back(j);
  }
  // One that the model does not know may be what it calls otherwise.
  if (seen.size() < record.outputs.size() || seen.empty() || seen.size() == machine.outputs.size()) return nullptr;
  return std::make_unique<PartlySeen>(machine, std::move(seen));
}

}  // namespace saltus::diagnosis
