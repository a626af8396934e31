#include "plot.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <memory>
#include <stdexcept>

#include "write_file.hpp"

namespace saltus {
namespace {

using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

// In gnuplot's single quotes nothing but the quote itself has a meaning: it becomes an apostrophe.
std::string quoted(const std::string& text) {
  std::string r = "'";
  for (const char c : text) {
    if (c == '\'') {
      r += "\xE2\x80\x99";
    } else {
      r += c == '\n' ? ' ' : c;
    }
  }
  return r + "'";
}

bool drawable(const Curve& curve) {
  for (const auto& [x, y] : curve.points) {
    if (std::isfinite(x) && std::isfinite(y)) return true;
  }
  return false;
}

void write_points(std::FILE* out, const Curve& curve) {
  for (const auto& [x, y] : curve.points) {
    if (std::isfinite(x) && std::isfinite(y)) {
      std::fprintf(out, "%.9g %.9g\n", x, y);
    } else {
      std::fputs("\n", out);
    }
  }
  std::fputs("e\n", out);
}

// What gnuplot makes of a script, by way of files that have no name.
std::string run_gnuplot(std::FILE* script) {
  const File drawing(std::tmpfile(), std::fclose);
  if (!drawing || std::fflush(script) != 0) throw std::runtime_error("no room for a temporary file; mend TMPDIR");
  std::rewind(script);
  posix_spawn_file_actions_t streams;
  posix_spawn_file_actions_init(&streams);
  posix_spawn_file_actions_adddup2(&streams, fileno(script), STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&streams, fileno(drawing.get()), STDOUT_FILENO);
  posix_spawn_file_actions_addopen(&streams, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  std::string program = "gnuplot", defaults = "-d";
  char* const arguments[] = {program.data(), defaults.data(), nullptr};
  pid_t child = 0;
  int status = posix_spawnp(&child, arguments[0], &streams, nullptr, arguments, environ);
  posix_spawn_file_actions_destroy(&streams);
  if (status != 0) throw std::runtime_error("gnuplot cannot be started; install the package gnuplot-nox");
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  std::string svg;
  std::rewind(drawing.get());
  char block[4096];
  for (std::size_t n = 0; (n = std::fread(block, 1, sizeof block, drawing.get())) > 0;) svg.append(block, n);
  if (status != 0 || svg.find("</svg>") == svg.npos) {
    throw std::runtime_error("gnuplot failed to draw; see that the package gnuplot-nox is installed whole");
  }
  return svg;
}

}  // namespace

std::string plain(const std::string& text) {
  std::string r;
  for (const char c : text) {
    if (c == '_') r += "\\";
    r += c;
  }
  return r;
}

std::string Figure::svg() const {
  const int rows = (static_cast<int>(panels.size()) + columns - 1) / columns;
  const File script(std::tmpfile(), std::fclose);
  if (!script) throw std::runtime_error("no room for a temporary file; mend TMPDIR");
  std::FILE* const out = script.get();
  std::fprintf(out,
               "set encoding utf8\n"
               "set terminal svg size %d,%d dynamic enhanced font 'DejaVu Sans,12' background rgb 'white'\n"
               "set multiplot layout %d,%d\n",
               width, height, rows, columns);
  std::fputs("set grid lc rgb '#dddddd'\nset border lc rgb '#555555'\n", out);
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
      if (!drawable(c)) continue;
      const std::string title = c.title.empty() ? "notitle" : "title " + quoted(c.title);
      std::fprintf(out, "%s'-' %s with %s", lead, title.c_str(), c.style.c_str());
      lead = ", ";
    }
    std::fputs(lead[0] == 'p' ? "set multiplot next\n" : "\n", out);
    for (const Curve& c : p.curves) {
      if (drawable(c)) write_points(out, c);
    }
  }
  std::fputs("unset multiplot\n", out);
  return run_gnuplot(out);
}

void Figure::write_svg(const std::string& path) const {
  check_writable(path);
  write_file(path, svg());
}

}  // namespace saltus
