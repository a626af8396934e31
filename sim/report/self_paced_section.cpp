#include "self_paced_section.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "../format.hpp"

namespace saltus {
namespace {

using namespace diagnosis;

// Angles are shown in degrees.
bool angle(const std::string& unit) { return unit.substr(0, 3) == "rad"; }
double shown(double x, const std::string& unit) { return angle(unit) ? x * 180.0 / std::numbers::pi : x; }
std::string shown_unit(const std::string& unit) { return angle(unit) ? "deg" + unit.substr(3) : unit; }

// A long run: how far off it is as a root mean square over a fortieth of it, on a logarithmic axis, and no more points
// than can be seen.
constexpr std::size_t is_long = 1000, points = 600;

Curve running_size(const Curve& like, const std::vector<double>& t, const std::vector<double>& error) {
  Curve c{like.title, like.style, {}};
  const std::size_t window = error.size() / 40;
  double sum = 0.0;
  for (std::size_t i = 0; i < error.size(); ++i) {
    const auto square = [&](std::size_t k) { return std::isfinite(error[k]) ? error[k] * error[k] : 0.0; };
    sum += square(i);
    if (i >= window) sum -= square(i - window);
    if (i + 1 >= window && i % (window / 8) == 0)
      c.points.emplace_back(t[i - window / 2], std::sqrt(std::max(0.0, sum) / static_cast<double>(window)));
  }
  return c;
}

}  // namespace

std::vector<Figure> free_run_figures(const Diagnosis& d) {
  std::vector<Figure> figures;
  const auto& traces = d.self_paced.traces;
  const bool after = !d.effects.empty();
  for (std::size_t o = 0; o < d.output_names.size(); ++o) {
    std::vector<const Trace*> own;
    for (const Trace& t : traces) {
      if (t.output == o) own.push_back(&t);
    }
    if (own.empty()) continue;
    const std::size_t most = own.front()->t.size() < 100 ? 16 : 6;  // short runs: more of them fit
    if (own.size() > most) own.resize(most);
    const std::string& unit = d.output_units[o];
    Figure f;
    f.columns = 2;
    f.height = 320;
    Panel left, right;
    left.title = plain(d.output_names[o]) + ": free runs";
    left.x_label = right.x_label = "time / s";
    left.y_label = shown_unit(unit);
    right.title = plain(d.output_names[o]) + ": how far off";
    right.y_label = shown_unit(unit);
    left.settings = right.settings = "set key top right horizontal";
    const bool lengthy = own.front()->t.size() >= is_long;
    const std::size_t every = std::max<std::size_t>(1, own.front()->t.size() / points);
    Curve measured{"measured", lengthy ? "lines lc rgb '#aaaaaa' lw 4" : "points lc rgb '#999999' pt 7 ps 0.25", {}},
        refitted{after ? "before" : "refitted", "lines lc rgb '#c0392b'", {}},
        with{after ? "after" : "final", "lines lc rgb '#2471a3' lw 1.5", {}};
    Curve off_refitted = refitted, off_with = with;
    std::vector<double> size;
    for (const Trace* t : own) {
      for (std::size_t i = 0; i < t->t.size(); i += every) {
        measured.points.emplace_back(t->t[i], shown(t->measured[i], unit));
        refitted.points.emplace_back(t->t[i], shown(t->refit[i], unit));
        with.points.emplace_back(t->t[i], shown(t->after[i], unit));
        off_refitted.points.emplace_back(t->t[i], shown(t->measured[i] - t->refit[i], unit));
        off_with.points.emplace_back(t->t[i], shown(t->measured[i] - t->after[i], unit));
        if (std::isfinite(off_with.points.back().second)) size.push_back(std::abs(off_with.points.back().second));
      }
      for (Curve* c : {&measured, &refitted, &with, &off_refitted, &off_with})
        c->points.emplace_back(t->t.back(), std::nan(""));
    }
    if (!size.empty()) {  // a model that is lost must not hide the one that is not
      std::sort(size.begin(), size.end());
      const double top = std::max(1e-9, 4.0 * size[size.size() * 95 / 100]);
      right.settings += format("\nset yrange [%.4g:%.4g]", -top, top);
    }
    double top = 0.0, bottom = 0.0;
    for (const Curve* c : {&measured, &with, &refitted}) {
      const double bound = c == &refitted ? 2.0 * std::max(top, -bottom) : 1e300;  // nor here
      for (const auto& [t, y] : c->points) {
        if (!std::isfinite(y)) continue;
        top = std::max(top, std::min(y, bound));
        bottom = std::min(bottom, std::max(y, -bound));
      }
    }
    left.settings += format("\nset yrange [%.3g:%.3g]", bottom, top + 0.25 * (top - bottom));  // room for the key
    left.curves = {refitted, measured, with};
    right.curves = {off_refitted, off_with};
    if (lengthy) {
      right.curves.clear();
      for (const Trace* t : own) {
        std::vector<double> before, now;
        for (std::size_t i = 0; i < t->t.size(); ++i) {
          before.push_back(shown(t->measured[i] - t->refit[i], unit));
          now.push_back(shown(t->measured[i] - t->after[i], unit));
        }
        right.curves.push_back(running_size(off_refitted, t->t, before));
        right.curves.push_back(running_size(off_with, t->t, now));
        off_refitted.title = off_with.title = "";
      }
      right.title += ", root mean square";
      double low = 1e300, high = 0.0;
      for (const Curve& c : right.curves) {
        for (const auto& [when, off] : c.points) {
          if (off > 0.0) low = std::min(low, off);
          high = std::max(high, off);
        }
      }
      right.settings =
          format("set key top right horizontal\nset logscale y\nset yrange [%.3g:%.3g]", 0.7 * low, 4.0 * high);
    }
    f.panels = {left, right};
    figures.push_back(std::move(f));
  }
  return figures;
}

std::string free_run_headline(const Diagnosis& d) {
  // Of the longest held-out ones; where nothing was held out, of those there are.
  const FreeRun* best = &d.self_paced.runs.front();
  for (const FreeRun& f : d.self_paced.runs) {
    if (f.data == best->data && f.horizon > best->horizon) best = &f;
  }
  std::string h =
      format("Free runs over %.3g s, ", best->horizon) + best->data + ", error at declared, refitted and final values:";
  for (std::size_t o = 0; o < best->after.size(); ++o) {
    const std::string& u = d.output_units[o];
    h += (o == 0 ? " " : ", ") + d.output_names[o] +
         format(" <b>%.3g &rarr; %.3g &rarr; %.3g</b> ", shown(best->before[o], u), shown(best->refit[o], u),
                shown(best->after[o], u)) +
         shown_unit(u);
  }
  return h;
}

std::string free_run_table(const Diagnosis& d) {
  std::string h =
      "<table><tr><th>root mean square of the "
      "error</th><th>runs</th><th>declared</th><th>refitted</th><th>after</th><th>after, at the end</th>"
      "<th>after, the median run</th><th>noise</th></tr>\n";
  for (const FreeRun& f : d.self_paced.runs) {
    for (std::size_t o = 0; o < f.after.size(); ++o) {
      const std::string& u = d.output_units[o];
      h += "<tr><td>" + d.output_names[o] + format(" over %.3g s, ", f.horizon) + f.data + " [" + shown_unit(u) +
           "]</td>" +
           format("<td>%d</td><td>%.3g</td><td>%.3g</td><td>%.3g</td><td>%.3g</td><td>%.3g</td><td>%.2g</td></tr>\n",
                  f.runs, shown(f.before[o], u), shown(f.refit[o], u), shown(f.after[o], u), shown(f.end_after[o], u),
                  shown(f.median_after[o], u), shown(d.noise[o], u));
    }
  }
  h += "</table>\n";
  for (const FreeRun& f : d.self_paced.runs) {
    if (f.unstable == 0) continue;
    h +=
        format("<p class=\"muted\">%d more of %.3g s, ", f.unstable, f.horizon) + f.data +
        ", are not told: the machine is unstable there, and an error of the start grows more than twentyfold, whatever "
        "the model.</p>\n";
  }
  return h;
}

std::string step_table(const Diagnosis& d) {
  if (d.self_paced.steps.empty()) return "";
  std::string h =
      "<table><tr><th>effect</th><th>beside</th><th>gain in likelihood</th><th>error left, predicting parts not "
      "fitted</th><th>parts better</th>"
      "<th></th></tr>\n";
  for (const Step& t : d.self_paced.steps) {
    const std::string beside = listed(t.beside);
    std::string what_became = t.taken ? "taken" : "not claimed";
    if (!t.instead.empty()) {
      what_became += format(" instead of %s: free runs off by %.0f %% of what they are with it", t.instead.c_str(),
                            100.0 * t.free_run);
    }
    h += std::string(t.taken ? "<tr class=\"chosen\"><td>" : "<tr><td>") + t.effect + "</td><td>" +
         (beside.empty() ? "the refitted model" : beside) +
         format("</td><td>%.0f</td><td>%.0f %%</td><td>%d of %d</td><td>%s</td></tr>\n", t.gain, 100.0 * t.predicted,
                t.better, t.parts, what_became.c_str());
  }
  return h + "</table>\n";
}

}  // namespace saltus
