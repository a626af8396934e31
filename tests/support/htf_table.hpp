// A table of harmonic transfer functions, `m,f,output,re,im[,sigma,cycles]`, by line: f = line / 64 cycles per cycle.
#pragma once

#include <cmath>
#include <complex>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

namespace saltus::test {

struct HtfEntry {
  std::complex<double> value;
  double sigma = std::nan("");
  int cycles = 0;
};

class HtfTable {
 public:
  using Key = std::tuple<int, int, std::string>;  // m, line, output without underscores: y_M and yM are one
  static constexpr int resolution = 64;

  explicit HtfTable(const std::filesystem::path& path) {
    std::ifstream in(path);
    std::string row;
    if (!std::getline(in, header_)) throw std::runtime_error(path.string() + " cannot be read");
    while (std::getline(in, row)) {
      std::vector<std::string> cells;
      std::istringstream line(row);
      for (std::string cell; std::getline(line, cell, ',');) cells.push_back(cell);
      if (cells.size() < 5) throw std::runtime_error(path.string() + ": " + row);
      HtfEntry e{{std::stod(cells[3]), std::stod(cells[4])}};
      if (cells.size() > 5 && !cells[5].empty()) e.sigma = std::stod(cells[5]);
      if (cells.size() > 6) e.cycles = std::stoi(cells[6]);
      const double line_number = std::stod(cells[1]) * resolution;
      if (std::abs(line_number - std::round(line_number)) > 1e-6) throw std::runtime_error("no line: " + row);
      const Key key{std::stoi(cells[0]), static_cast<int>(std::lround(line_number)), plain(cells[2])};
      if (!entries_.emplace(key, e).second) throw std::runtime_error("twice: " + row);
    }
  }

  const std::string& header() const { return header_; }
  const std::map<Key, HtfEntry>& entries() const { return entries_; }
  const HtfEntry& at(int m, int line, const std::string& output) const { return entries_.at({m, line, plain(output)}); }

  // The lines it has of one harmonic and output, ascending.
  std::vector<int> lines(int m, const std::string& output) const {
    std::vector<int> r;
    for (const auto& [key, e] : entries_) {
      if (std::get<0>(key) == m && std::get<2>(key) == plain(output)) r.push_back(std::get<1>(key));
    }
    return r;
  }

  // Over the lines of `lines`: root of the sum of squares, and the largest modulus.
  struct Size {
    double norm = 0.0, largest = 0.0;
  };
  Size size(int m, const std::string& output, const std::vector<int>& lines) const {
    return size_of(lines, [&](int q) { return std::abs(at(m, q, output).value); });
  }
  // The same of its difference from another table.
  Size error(const HtfTable& truth, int m, const std::string& output, const std::vector<int>& lines) const {
    return size_of(lines, [&](int q) { return std::abs(at(m, q, output).value - truth.at(m, q, output).value); });
  }

 private:
  static std::string plain(std::string name) {
    std::erase(name, '_');
    return name;
  }
  template <class F>
  static Size size_of(const std::vector<int>& lines, F&& modulus) {
    Size s;
    for (const int q : lines) {
      const double a = modulus(q);
      s.norm += a * a;
      s.largest = std::max(s.largest, a);
    }
    s.norm = std::sqrt(s.norm);
    return s;
  }

  std::string header_;
  std::map<Key, HtfEntry> entries_;
};

// The reference tables of the hopper, computed apart from this program.
inline const HtfTable& reference_isochrons() {
  static const HtfTable table(std::filesystem::path(SALTUS_TEST_DATA) / "hopper/htf_isochron.csv");
  return table;
}
inline const HtfTable& reference_kinematic() {
  static const HtfTable table(std::filesystem::path(SALTUS_TEST_DATA) / "hopper/htf_kinematic.csv");
  return table;
}

}  // namespace saltus::test
