#include "orbit_figures.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>

namespace saltus {
namespace {

constexpr const char* colours[] = {"#1f4e9c", "#c0392b", "#2e8b57", "#8e44ad", "#e08e0b", "#16a0a0"};
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

std::string style(const char* base, std::size_t colour, const char* more = "") {
  return std::string(base) + " lc rgb '" + colours[colour % std::size(colours)] + "' " + more;
}

// A name with its index lowered.
std::string indexed(const std::string& name) {
  const auto at = name.find('_');
  if (at == std::string::npos) return name;
  const auto end = std::min(name.find(' '), name.size());
  return name.substr(0, at) + "_{" + name.substr(at + 1, end - at - 1) + "}" +
         (end < name.size() ? "\xC2\xA0" + name.substr(end + 1) : "");  // a plain space after an index is lost
}

// The key below the panel, which has `rows` of it.
std::string key(int rows) {
  return "set bmargin " + std::to_string(5 + rows) + "\nset key outside bottom center horizontal width 1\n";
}

// One colour a curve of the portrait, one dash a chart; transients grey, behind.
Panel portrait(const OrbitReport& r) {
  Panel panel{plain(r.model) + ": phase portrait",
              indexed(r.x_label),
              indexed(r.y_label),
              {},
              key(r.portrait.size() > 8 ? 4 : 2)};
  std::vector<std::string> titles;
  for (const auto& s : r.portrait) {
    if (s.transient) panel.curves.push_back({"", "lines lw 1 lc rgb '#c4c4c4'", s.points});
  }
  for (const auto& s : r.portrait) {
    if (s.transient) continue;
    const auto title = std::find(titles.begin(), titles.end(), s.title);
    const auto colour = static_cast<std::size_t>(title - titles.begin());
    if (title == titles.end()) titles.push_back(s.title);
    const auto chart = std::find(r.charts.begin(), r.charts.end(), s.chart) - r.charts.begin();
    const std::string dash = "dt " + std::to_string(chart + 1);
    std::string name = s.title.empty() ? plain(s.chart) : indexed(s.title) + ", " + plain(s.chart);
    for (const Curve& c : panel.curves) {
      if (c.title == name) name.clear();
    }
    panel.curves.push_back({name, style("lines lw 2", colour, dash.c_str()), s.points});
  }
  std::size_t mark = 0;
  for (const auto& [edge, points] : r.marks) {
    std::vector<std::pair<double, double>> jumps;
    std::vector<std::pair<double, double>> before;
    for (std::size_t i = 0; i + 1 < points.size(); i += 2) {
      before.push_back(points[i]);
      jumps.insert(jumps.end(), {points[i], points[i + 1], {nan, nan}});
    }
    panel.curves.push_back({"", "lines lw 1 dt 3 lc rgb '#777777'", jumps});
    char shape[64];
    std::snprintf(shape, sizeof shape, "points pt %d ps 0.8 lc rgb '#222222'", static_cast<int>(7 + 2 * mark++));
    panel.curves.push_back({plain(edge), shape, before});
  }
  return panel;
}

// The unit circle; errors as circles where they can be seen, and as numbers in the key.
Panel unit_circle(const OrbitReport& r) {
  Panel panel{"multipliers on section 0", "real part", "imaginary part", {}, ""};
  double reach = 1.15;
  std::vector<std::pair<double, double>> circle;
  const auto ring = [](double x, double y, double radius) {
    std::vector<std::pair<double, double>> points;
    for (int i = 0; i <= 120; ++i) {
      const double a = 2.0 * std::numbers::pi * i / 120.0;
      points.emplace_back(x + radius * std::cos(a), y + radius * std::sin(a));
    }
    return points;
  };
  panel.curves.push_back({"", "lines lw 1 lc rgb '#555555'", ring(0.0, 0.0, 1.0)});
  const WideMultipliers& m = r.multipliers;
  for (int i = 0; i < m.nonzero; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const Complex z = m.value[at];
    reach = std::max(reach, 1.1 * std::abs(z));
    if (z.imag() < 0.0) continue;
    std::vector<std::pair<double, double>> points{{z.real(), z.imag()}};
    char title[128];
    if (z.imag() > 0.0) {
      points.emplace_back(z.real(), -z.imag());
      std::snprintf(title, sizeof title, "%.6f ± %.6fi, error %.0e", z.real(), z.imag(), m.error[at]);
    } else {
      std::snprintf(title, sizeof title, "%.6f, error %.0e", z.real(), m.error[at]);
    }
    panel.curves.push_back({title, style("points pt 7 ps 0.9", at), points});
    if (m.error[at] > 2e-3) {
      for (const auto& [x, y] : points) panel.curves.push_back({"", style("lines lw 1", at), ring(x, y, m.error[at])});
    }
  }
  if (m.dim > m.nonzero) {
    char title[64];
    const int zeros = m.dim - m.nonzero;
    const double error = m.error[static_cast<std::size_t>(m.nonzero)];
    if (zeros == 1) {
      std::snprintf(title, sizeof title, "0, once, error %.0e", error);
    } else {
      std::snprintf(title, sizeof title, "0, %d times, error %.0e", zeros, error);
    }
    panel.curves.push_back({title, "points pt 4 ps 1.2 lc rgb '#222222'", {{0.0, 0.0}}});
  }
  char settings[160];
  std::snprintf(settings, sizeof settings, "set size ratio -1\nset xrange [-%g:%g]\nset yrange [-%g:%g]\n", reach,
                reach, reach, reach);
  panel.settings = settings + key(4);
  return panel;
}

// Errors of the multipliers, on a logarithmic scale.
Panel errors(const OrbitReport& r) {
  Panel panel{"modulus and error of each multiplier", "multiplier, by falling modulus", "", {}, ""};
  std::vector<std::pair<double, double>> moduli;
  std::vector<std::pair<double, double>> error;
  const WideMultipliers& m = r.multipliers;
  for (int i = 0; i < m.dim; ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (i < m.nonzero) moduli.emplace_back(i + 1, std::abs(m.value[at]));
    error.emplace_back(i + 1, std::max(1e-17, m.error[at]));
  }
  panel.curves.push_back({"modulus", style("points pt 7 ps 0.9", 0), moduli});
  panel.curves.push_back({"error", style("points pt 2 ps 0.9", 1), error});
  char settings[160];
  std::snprintf(settings, sizeof settings,
                "set logscale y\nset format y '10^{%%L}'\nunset mytics\nset xrange [0.5:%g]\nset yrange "
                "[1e-18:100]\nset xtics 1\n",
                m.dim + 0.5);
  panel.settings = settings + key(1);
  return panel;
}

// What the ranks were read from: singular values of each DP_q above and below their tolerance.
Panel ranks(const OrbitReport& r) {
  Panel panel{"singular values of DP, and their tolerance", "singular value", "", {}, ""};
  int largest = 1;
  for (int j = 0; j < r.fine.count; ++j) {
    const auto at = static_cast<std::size_t>(j);
    const auto& g = r.analysis.guard[at];
    const int dim = r.fine[j].dim;
    largest = std::max(largest, dim);
    std::vector<std::pair<double, double>> sigma;
    for (int i = 0; i < dim; ++i) sigma.emplace_back(i + 1, std::max(1e-17, g.rank.sigma[static_cast<std::size_t>(i)]));
    const std::string chart = r.charts[static_cast<std::size_t>(r.fine[j].chart)];
    panel.curves.push_back({chart + ": rank " + std::to_string(g.rank.value),
                            style(at == 0 ? "points pt 7 ps 0.8" : "points pt 6 ps 1.4", at), sigma});
    const double tolerance = std::max(1e-17, g.rank.tolerance);
    panel.curves.push_back({"", style("lines lw 1 dt 2", at), {{0.5, tolerance}, {dim + 0.5, tolerance}}});
  }
  char settings[160];
  std::snprintf(settings, sizeof settings,
                "set logscale y\nset format y '10^{%%L}'\nunset mytics\nset xrange [0.5:%g]\nset yrange "
                "[1e-18:1e3]\nset xtics 1\n",
                largest + 0.5);
  panel.settings = settings + key(1);
  return panel;
}

}  // namespace

Figure orbit_figure(const OrbitReport& r) {
  Figure figure;
  figure.columns = 2;
  figure.width = 1080;
  figure.height = 1000;
  figure.panels.push_back(portrait(r));
  if (r.analysis.doubt == Doubt::none) {
    figure.panels.push_back(unit_circle(r));
    figure.panels.push_back(errors(r));
    figure.panels.push_back(ranks(r));
  } else {
    figure.columns = 1;
  }
  return figure;
}

}  // namespace saltus
