// Pictures by gnuplot, as SVG.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace saltus {

// gnuplot's enhanced text takes an underscore for a subscript; this is the text as it stands.
std::string plain(const std::string& text);

// One curve of a panel, in the style gnuplot calls it ("lines", "points pt 7 ps 0.4", ...).
struct Curve {
  std::string title;  // empty: not in the key
  std::string style;
  std::vector<std::pair<double, double>> points;  // a NaN breaks a line; a curve of nothing else is left out
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

  // Throw std::runtime_error, saying what to do, when gnuplot is missing or fails, or the file cannot be written.
  std::string svg() const;
  void write_svg(const std::string& path) const;
};

}  // namespace saltus
