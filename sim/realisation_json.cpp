// A realisation as JSON and as CSV, and its model back from that JSON.
#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "realisation.hpp"

namespace saltus {
namespace {

using Eigen::MatrixXd;
using Index = Eigen::Index;

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

}  // namespace

std::string realisation_json(const Realisation& r) {
  const auto matrix = [](const MatrixXd& m) {
    nlohmann::json rows = nlohmann::json::array();
    for (Index i = 0; i < m.rows(); ++i) {
      nlohmann::json row = nlohmann::json::array();
      for (Index j = 0; j < m.cols(); ++j) row.push_back(m(i, j));
      rows.push_back(row);
    }
    return rows;
  };
  nlohmann::json j{{"sections_per_cycle", r.model.sections},
                   {"outputs", r.model.outputs},
                   {"dim", nlohmann::json::array()},
                   {"rank", r.rank},
                   {"htf_error", r.error},
                   {"singular_values", r.singular},
                   {"threshold", r.threshold},
                   {"missing_harmonics_limit", r.limit},
                   {"inconsistency", r.inconsistency},
                   {"stable", r.stable()},
                   {"multipliers", nlohmann::json::array()},
                   {"A", nlohmann::json::array()},
                   {"B", nlohmann::json::array()},
                   {"C", nlohmann::json::array()}};
  if (r.bounds) j["rank_bounds"] = {r.bounds->lower, r.bounds->upper};
  for (int n = 0; n < r.model.sections; ++n) {
    j["dim"].push_back(r.model.dim(n));
    j["A"].push_back(matrix(r.model.A[at(n)]));
    j["B"].push_back(matrix(r.model.B[at(n)]));
    j["C"].push_back(matrix(r.model.C[at(n)]));
  }
  for (std::size_t i = 0; i < r.multipliers.size(); ++i) {
    nlohmann::json z{{"re", r.multipliers[i].real()}, {"im", r.multipliers[i].imag()}, {"sigma", nullptr}};
    if (i < r.sigma.size()) z["sigma"] = r.sigma[i];
    j["multipliers"].push_back(z);
  }
  return j.dump(1) + "\n";
}

PeriodicModel periodic_model_of(const std::string& text) {
  constexpr Index most = 256;
  const auto refuse = [](const std::string& why) { throw std::invalid_argument(why); };
  const nlohmann::json j = nlohmann::json::parse(text, nullptr, false);
  for (const char* key : {"sections_per_cycle", "outputs", "dim", "A", "B", "C"}) {
    if (!j.is_object() || !j.contains(key)) refuse(std::string("it is no state-space model in JSON: no '") + key + "'");
  }
  PeriodicModel r;
  try {
    r.sections = j.at("sections_per_cycle");
    r.outputs = j.at("outputs");
    const std::vector<Index> dim = j.at("dim");
    const std::size_t sections = dim.size();
    const auto sensible = [](Index d) { return d >= 0 && d <= most; };
    if (r.sections < 1 || sections != at(r.sections)) refuse("'dim' has not one number for each section");
    if (r.outputs < 1 || !sensible(r.outputs) || !std::all_of(dim.begin(), dim.end(), sensible)) {
      refuse("'outputs' or 'dim' has a number that is none of outputs or states");
    }
    const auto read = [&](const char* name, std::size_t n, Index rows, Index cols) {
      const std::vector<std::vector<double>> given = j.at(name).at(n);
      const auto fits = [&](const std::vector<double>& row) { return row.size() == at(cols); };
      if (given.size() != at(rows) || !std::all_of(given.begin(), given.end(), fits)) {
        refuse(std::string(name) + " of section " + std::to_string(n) + " is not " + std::to_string(rows) + " x " +
               std::to_string(cols));
      }
      MatrixXd m(rows, cols);
      for (Index i = 0; i < rows; ++i) {
        for (Index k = 0; k < cols; ++k) m(i, k) = given[at(i)][at(k)];
      }
      return m;
    };
    for (std::size_t n = 0; n < sections; ++n) {
      const Index next = dim[(n + 1) % sections];
      r.A.push_back(read("A", n, next, dim[n]));
      r.B.push_back(read("B", n, next, 1));
      r.C.push_back(read("C", n, r.outputs, dim[n]));
    }
  } catch (const nlohmann::json::exception& e) {
    refuse(e.what());
  }
  return r;
}

std::string realisation_csv(const Realisation& r) {
  std::string csv = "matrix,section,row,column,value\n";
  const auto write = [&](const char* name, int n, const MatrixXd& m) {
    for (Index i = 0; i < m.rows(); ++i) {
      for (Index j = 0; j < m.cols(); ++j) {
        char line[96];
        std::snprintf(line, sizeof line, "%s,%d,%d,%d,%.17g\n", name, n, static_cast<int>(i), static_cast<int>(j),
                      m(i, j));
        csv += line;
      }
    }
  };
  for (int n = 0; n < r.model.sections; ++n) {
    write("A", n, r.model.A[at(n)]);
    write("B", n, r.model.B[at(n)]);
    write("C", n, r.model.C[at(n)]);
  }
  return csv;
}

}  // namespace saltus
