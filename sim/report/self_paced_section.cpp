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
    left.settings = right.settings = "set key top right";
    Curve measured{"measured", "points lc rgb '#999999' pt 7 ps 0.25", {}},
        refitted{"refitted", "lines lc rgb '#c0392b'", {}},
        with{after ? "with the effects" : "final", "lines lc rgb '#2471a3' lw 1.5", {}};
    Curve off_refitted = refitted, off_with = with;
    std::vector<double> size;
    for (const Trace* t : own) {
      for (std::size_t i = 0; i < t->t.size(); ++i) {
        measured.points.emplace_back(t->t[i], shown(t->measured[i], unit));
        refitted.points.emplace_back(t->t[i], shown(t->refit[i], unit));
        with.points.emplace_back(t->t[i], shown(t->after[i], unit));
        off_refitted.points.emplace_back(t->t[i], shown(t->measured[i] - t->refit[i], unit));
        off_with.points.emplace_back(t->t[i], shown(t->measured[i] - t->after[i], unit));
        if (std::isfinite(off_with.points.back().second)) size.push_back(std::abs(off_with.points.back().second));
      }
      for (Curve* c : {&refitted, &with, &off_refitted, &off_with}) c->points.emplace_back(t->t.back(), std::nan(""));
    }
    if (!size.empty()) {  // a model that is lost must not hide the one that is not
      std::sort(size.begin(), size.end());
      const double top = std::max(1e-9, 4.0 * size[size.size() * 95 / 100]);
      right.settings += format("\nset yrange [%.4g:%.4g]", -top, top);
    }
    left.curves = {measured, refitted, with};
    right.curves = {off_refitted, off_with};
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
    std::string beside;
    for (const auto& b : t.beside) beside += (beside.empty() ? "" : ", ") + b;
    h += std::string(t.taken ? "<tr class=\"chosen\"><td>" : "<tr><td>") + t.effect + "</td><td>" +
         (beside.empty() ? "the refitted model" : beside) +
         format("</td><td>%.0f</td><td>%.0f %%</td><td>%d of %d</td><td>%s</td></tr>\n", t.gain, 100.0 * t.predicted,
                t.better, t.parts, t.taken ? "taken" : "not claimed");
  }
  return h + "</table>\n";
}

}  // namespace saltus
