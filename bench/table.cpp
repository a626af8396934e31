// saltus_bench_table FILE: the JSON of Google Benchmark as a table in Markdown. Benchmarks named "work | who" share a
// work; each is given as a multiple of the work's first. Every time is the shortest of its repetitions: the median
// where every turn was timed, else the mean, by the clock where the benchmark asks for that. What could not be run is
// listed with the reason.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace {

struct Row {
  std::string work, who, remarks;
  double time;  // [ns]; infinite: not run
};

std::string as_text(double ns) {
  char text[32];
  if (std::isinf(ns)) return "-";
  if (ns < 999.5) {
    std::snprintf(text, sizeof text, "%.3g ns", ns);
  } else if (ns < 999.5e3) {
    std::snprintf(text, sizeof text, "%.3g us", ns / 1e3);
  } else {
    std::snprintf(text, sizeof text, "%.3g ms", ns / 1e6);
  }
  return text;
}

// The unit of Google Benchmark's times.
double in_ns(const std::string& unit) { return unit == "s" ? 1e9 : unit == "ms" ? 1e6 : unit == "us" ? 1e3 : 1.0; }

// Cuts an ending off; false where there is none.
bool cut(std::string& name, const std::string& ending) {
  const bool there =
      name.size() > ending.size() && name.compare(name.size() - ending.size(), ending.size(), ending) == 0;
  if (there) name.resize(name.size() - ending.size());
  return there;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: saltus_bench_table FILE.json\n");
    return 2;
  }
  std::ifstream in(argv[1]);
  const auto file = nlohmann::json::parse(in, nullptr, false);
  if (!in.is_open() || file.is_discarded() || !file.contains("benchmarks")) {
    std::fprintf(stderr, "%s: no output of Google Benchmark in JSON\n", argv[1]);
    return 1;
  }
  const std::vector<std::string> known{"p99", "p99.99", "max"};  // [ns]
  std::vector<Row> rows;
  for (const auto& b : file["benchmarks"]) {
    if (b.value("run_type", "iteration") != "iteration") continue;
    std::string name = b.value("run_name", b.value("name", ""));
    const bool by_the_clock = cut(name, "/real_time") || cut(name, "/manual_time");
    cut(name, "/iterations:1");
    const auto bar = name.find(" | ");
    Row row{name.substr(0, bar), bar == std::string::npos ? "" : name.substr(bar + 3), b.value("label", ""),
            b.value(by_the_clock ? "real_time" : "cpu_time", 0.0) * in_ns(b.value("time_unit", "ns"))};
    row.time = b.value("median", row.time);
    if (b.value("error_occurred", false)) {
      row.remarks = "left out: " + b.value("error_message", "");
      row.time = std::numeric_limits<double>::infinity();
    }
    if (const auto argument = row.who.find('/'); argument != std::string::npos) {  // belongs to the work
      row.work += row.who.substr(argument);
      row.who.resize(argument);
    }
    for (const std::string& k : known) {
      if (!b.contains(k)) continue;
      row.remarks += (row.remarks.empty() ? "" : ", ") + k + " " + as_text(b[k].get<double>());
    }
    const auto same =
        std::find_if(rows.begin(), rows.end(), [&](const Row& r) { return r.work == row.work && r.who == row.who; });
    if (same == rows.end()) {
      rows.push_back(row);
    } else if (row.time < same->time) {
      *same = row;
    }
  }
  // Ours first, whatever order they ran in.
  std::stable_partition(rows.begin(), rows.end(), [](const Row& r) { return r.who == "saltus"; });
  std::puts("| work | by | time | ratio | |\n|---|---|---|---|---|");
  for (const Row& first : rows) {
    const auto of_the_work = [&](const Row& r) { return r.work == first.work; };
    if (&first != &*std::find_if(rows.begin(), rows.end(), of_the_work)) continue;
    for (const Row& r : rows) {
      if (!of_the_work(r)) continue;
      std::printf("| %s | %s | %s | ", &first == &r ? r.work.c_str() : "", r.who.c_str(), as_text(r.time).c_str());
      if (!r.who.empty() && std::isfinite(r.time / first.time)) std::printf("%.3g", r.time / first.time);
      std::printf(" | %s |\n", r.remarks.c_str());
    }
  }
}
