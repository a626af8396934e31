#include "plot.hpp"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <stdexcept>

namespace saltus {
namespace {

std::string quoted(const std::string& text) {
  std::string r = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') r += '\\';
    r += c == '\n' ? ' ' : c;
  }
  return r + "\"";
}

void write_points(std::FILE* out, const Curve& curve) {
  for (const auto& [x, y] : curve.points) {
    if (std::isfinite(x) && std::isfinite(y)) {
      std::fprintf(out, "%.6g %.6g\n", x, y);
    } else {
      std::fputs("\n", out);
    }
  }
  std::fputs("e\n", out);
}

}  // namespace

void Figure::write_svg(const std::string& path) const {
  const std::string beside = path + ".part";
  const int rows = (static_cast<int>(panels.size()) + columns - 1) / columns;
  {
    const std::unique_ptr<std::FILE, int (*)(std::FILE*)> gnuplot(popen("gnuplot 2>/dev/null", "w"), pclose);
    if (!gnuplot) throw std::runtime_error("gnuplot cannot be started; install the package gnuplot-nox");
    std::FILE* const out = gnuplot.get();
    std::fprintf(out, "set terminal svg size %d,%d dynamic enhanced font 'DejaVu Sans,12' background rgb 'white'\n",
                 width, height);
    std::fprintf(out, "set output %s\nset multiplot layout %d,%d\n", quoted(beside).c_str(), rows, columns);
    std::fputs(
        "set grid lc rgb '#dddddd'\nset border lc rgb '#555555'\nset key opaque box lc rgb '#cccccc' samplen 2\n", out);
    for (const Panel& p : panels) {
      std::fprintf(out, "set title %s\nset xlabel %s\nset ylabel %s\n", quoted(p.title).c_str(),
                   quoted(p.x_label).c_str(), quoted(p.y_label).c_str());
      std::fputs(
          "unset logscale\nset autoscale\nset size noratio\nset format '%g'\nset xtics auto\nset ytics auto\nset key "
          "default opaque box lc rgb '#cccccc' samplen 2\n",
          out);
      std::fprintf(out, "%s\n", p.settings.c_str());
      const char* lead = "plot ";
      for (const Curve& c : p.curves) {
        const std::string title = c.title.empty() ? "notitle" : "title " + quoted(c.title);
        std::fprintf(out, "%s'-' %s with %s", lead, title.c_str(), c.style.c_str());
        lead = ", ";
      }
      std::fputs("\n", out);
      for (const Curve& c : p.curves) write_points(out, c);
    }
    std::fputs("unset multiplot\n", out);
  }
  std::error_code error;
  const auto size = std::filesystem::file_size(beside, error);
  if (!error && size > 0) std::filesystem::rename(beside, path, error);
  if (error || size == 0) {
    std::error_code ignored;
    std::filesystem::remove(beside, ignored);
    throw std::runtime_error(
        path +
        ": gnuplot wrote no picture; install the package gnuplot-nox, and choose a folder that may be written to");
  }
}

}  // namespace saltus
