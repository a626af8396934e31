// Pictures by gnuplot, as SVG.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace saltus {

// One curve of a panel, in the style gnuplot calls it ("lines", "points pt 7 ps 0.4", ...).
struct Curve {
  std::string title;  // empty: not in the key
  std::string style;
  std::vector<std::pair<double, double>> points;  // a NaN breaks a line
};

struct Panel {
  std::string title, x_label, y_label;
  std::vector<Curve> curves;
  std::string settings;  // further gnuplot commands for this panel alone: "set logscale y"
};

// A figure of panels, filled row by row.
struct Figure {
  int columns = 1;
  int width = 1000, height = 700;  // [px]
  std::vector<Panel> panels;

  // Throws std::runtime_error, naming the file and what to do, when gnuplot is missing or the file cannot be written.
  void write_svg(const std::string& path) const;
};

}  // namespace saltus
