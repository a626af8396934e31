#include "htf_figures.hpp"

#include <cmath>
#include <limits>
#include <numbers>

namespace saltus {
namespace {

struct Style {
  int m;
  const char* name;
  const char* colour;
};
constexpr Style styles[] = {{0, "H_{0}", "#1f4e9c"}, {1, "H_{1}", "#c0392b"}, {-1, "H_{-1}", "#e08e0b"}};

using Points = std::vector<std::pair<double, std::complex<double>>>;

// On a logarithmic axis: zero is a gap.
std::vector<std::pair<double, double>> magnitude(const Points& points) {
  std::vector<std::pair<double, double>> r;
  for (const auto& [f, h] : points) {
    r.emplace_back(f, std::abs(h) > 0.0 ? std::abs(h) : std::numeric_limits<double>::quiet_NaN());
  }
  return r;
}

// In degrees, a line broken where it wraps.
std::vector<std::pair<double, double>> phase(const Points& points, bool line) {
  std::vector<std::pair<double, double>> r;
  for (const auto& [f, h] : points) {
    const double angle = std::arg(h) * 180.0 / std::numbers::pi;
    if (line && !r.empty() && std::abs(angle - r.back().second) > 180.0) {
      r.emplace_back(f, std::numeric_limits<double>::quiet_NaN());
    }
    r.emplace_back(f, angle);
  }
  return r;
}

const Points* find(const std::vector<HtfCurve>& curves, int m) {
  for (const HtfCurve& c : curves) {
    if (c.m == m) return &c.points;
  }
  return nullptr;
}

std::string line_style(const char* colour, int width, const char* dash = "") {
  return "lines lw " + std::to_string(width) + " " + dash + " lc rgb '" + colour + "'";
}
std::string point_style(const char* colour) { return std::string("points pt 7 ps 0.35 lc rgb '") + colour + "'"; }

const char* const frequency_label = "f, cycles per cycle";

}  // namespace

Figure magnitude_figure(const std::vector<HtfPanel>& panels) {
  Figure figure;
  figure.columns = panels.size() > 1 ? 2 : 1;
  figure.height = panels.size() > 2 ? 760 : 420;
  for (const HtfPanel& p : panels) {
    Panel panel{p.output + ", " + p.sections,
                frequency_label,
                "|H| [" + p.unit + "]",
                {},
                "set logscale y\nset format y '10^{%L}'"};
    for (const Style& s : styles) {
      const Points* exact = find(p.exact, s.m);
      const Points* identified = find(p.identified, s.m);
      if (exact != nullptr)
        panel.curves.push_back({s.name, line_style(s.colour, identified != nullptr ? 1 : 2), magnitude(*exact)});
      if (identified != nullptr) {
        panel.curves.push_back({exact != nullptr ? "" : s.name, point_style(s.colour), magnitude(*identified)});
      }
    }
    figure.panels.push_back(panel);
  }
  return figure;
}

Figure fit_figure(const std::vector<HtfPanel>& panels) {
  Figure figure;
  figure.columns = static_cast<int>(panels.size());
  figure.width = panels.size() > 2 ? 1500 : 1000;
  figure.height = 620;
  for (const bool is_phase : {false, true}) {
    for (const HtfPanel& p : panels) {
      Panel panel{
          p.output + ", " + p.sections,
          frequency_label,
          is_phase ? "phase of H_{0} [deg]" : "|H_{0}| [" + p.unit + "]",
          {},
          is_phase ? "set yrange [-190:190]\nset ytics 90\nset key off" : "set logscale y\nset format y '10^{%L}'"};
      const Points* data = find(p.identified, 0);
      if (data == nullptr) data = find(p.exact, 0);
      if (data != nullptr) {
        panel.curves.push_back(
            {"identified", point_style("#1f4e9c"), is_phase ? phase(*data, false) : magnitude(*data)});
      }
      panel.curves.push_back(
          {"2 poles, 1 zero", line_style("black", 2), is_phase ? phase(p.fit, true) : magnitude(p.fit)});
      figure.panels.push_back(panel);
    }
  }
  return figure;
}

}  // namespace saltus
