#include "diagnosis_page.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "../format.hpp"
#include "plot.hpp"
#include "self_paced_section.hpp"

namespace saltus {
namespace {

using namespace diagnosis;

std::string escaped(const std::string& text) {
  std::string r;
  for (const char c : text) {
    switch (c) {
      case '&':
        r += "&amp;";
        break;
      case '<':
        r += "&lt;";
        break;
      case '>':
        r += "&gt;";
        break;
      case '"':
        r += "&quot;";
        break;
      default:
        r += c;
    }
  }
  return r;
}
std::string number(double x, const char* pattern = "%.4g") { return std::isfinite(x) ? format(pattern, x) : "&ndash;"; }

// A figure as an inline SVG element.
std::string drawn(const Figure& figure) {
  const std::string svg = figure.svg();
  const auto begin = svg.find("<svg");
  // Identifiers of several figures on one page must not meet.
  static int serial = 0;
  const std::string prefix = "f" + std::to_string(serial++) + "_";
  std::string r;
  for (std::size_t i = begin == std::string::npos ? 0 : begin; i < svg.size(); ++i) {
    bool done = false;
    for (const char* key : {" id='", "url(#", "xlink:href='#", " id=\"", "href=\"#"}) {
      const std::string k = key;
      if (svg.compare(i, k.size(), k) == 0) {
        r += k + prefix;
        i += k.size() - 1;
        done = true;
        break;
      }
    }
    if (!done) r += svg[i];
  }
  return "<figure>" + r + "</figure>\n";
}

std::string residual_figure(const Diagnosis& d) {
  if (d.mean_cycle.empty() || d.mean_cycle.front().after.empty()) return "";
  Figure figure;
  figure.columns = static_cast<int>(d.mean_cycle.size());
  figure.width = 1000;
  figure.height = 400;
  for (std::size_t j = 0; j < d.mean_cycle.size(); ++j) {
    const MeanCycle& c = d.mean_cycle[j];
    Panel p;
    p.title = plain(d.output_names[j]) + ": mean residual over the cycle";
    p.x_label = "phase of the cycle";
    p.y_label = j == 0 ? "residual / its standard error" : "";
    const auto curve = [&](const std::vector<double>& y, const char* title, const char* style) {
      Curve k;
      k.title = title;
      k.style = style;
      for (std::size_t i = 0; i < y.size(); ++i)
        k.points.emplace_back(static_cast<double>(i) / static_cast<double>(y.size()), y[i]);
      p.curves.push_back(std::move(k));
    };
    Curve upper{"noise band, 95 %", "lines lc rgb '#999999' dt 2", {{0.0, 1.96}, {1.0, 1.96}}};
    Curve lower{"", "lines lc rgb '#999999' dt 2", {{0.0, -1.96}, {1.0, -1.96}}};
    p.curves.push_back(upper);
    p.curves.push_back(lower);
    curve(c.refit, "refitted, without effect", "linespoints lc rgb '#c0392b' pt 7 ps 0.4");
    curve(c.after, d.effects.empty() ? "final" : "with the effect", "linespoints lc rgb '#2471a3' pt 7 ps 0.4");
    // The key below: over the curves it would hide some.
    p.settings = "set bmargin 8\nset key outside bottom center horizontal";
    figure.panels.push_back(std::move(p));
  }
  return drawn(figure);
}

std::string response_figure(const Diagnosis& d) {
  if (d.responses.empty()) return "";
  std::string all;
  for (std::size_t o = 0; o < d.output_names.size(); ++o) {
    Figure figure;
    figure.columns = 3;
    figure.width = 1000;
    figure.height = 300;
    for (int m = -1; m <= 1; ++m) {
      Panel p;
      p.title = format("H_{%d}, %s", m, plain(d.output_names[o]).c_str());
      p.x_label = "frequency / cycles per cycle";
      p.y_label = m == -1 ? "magnitude" : "";
      p.settings = m == -1 ? "set logscale y\nset format y '10^{%L}'\nset key top right"
                           : "set logscale y\nset format y '10^{%L}'\nunset key";
      Curve bars{"", "lines lc rgb '#bbbbbb' lw 0.8", {}},
          measured{"measured, 95 %", "points lc rgb '#777777' pt 7 ps 0.35", {}},
          refit{"refitted", "lines lc rgb '#c0392b'", {}},
          after{d.effects.empty() ? "final" : "with the effect", "lines lc rgb '#2471a3'", {}};
      std::vector<const Response1*> lines;
      for (const Response1& r : d.responses) {
        if (r.m == m && r.output == o) lines.push_back(&r);
      }
      std::sort(lines.begin(), lines.end(), [](const Response1* a, const Response1* b) { return a->f < b->f; });
      const auto size = [](const double* h) { return std::hypot(h[0], h[1]); };
      double bottom = std::numeric_limits<double>::infinity();  // where a bar ends that reaches down to nothing
      for (const Response1* r : lines) bottom = std::min({bottom, size(r->measured), size(r->refit), size(r->after)});
      for (const Response1* r : lines) {
        constexpr double nan = std::numeric_limits<double>::quiet_NaN();
        const double bar = 1.96 / std::numbers::sqrt2 * r->sigma;  // of the two parts of a number one is along it
        measured.points.emplace_back(r->f, size(r->measured));
        bars.points.insert(
            bars.points.end(),
            {{r->f, std::max(bottom, size(r->measured) - bar)}, {r->f, size(r->measured) + bar}, {nan, nan}});
        refit.points.emplace_back(r->f, size(r->refit));
        after.points.emplace_back(r->f, size(r->after));
      }
      p.curves = {bars, measured, refit, after};
      figure.panels.push_back(std::move(p));
    }
    all += drawn(figure);
  }
  // What is left, in standard errors: this is where before and after differ visibly.
  Figure figure;
  figure.columns = 2;
  figure.width = 1000;
  figure.height = 300;
  for (int which = 0; which < 2; ++which) {
    Panel p;
    p.title = which == 0 ? "misfit of H_0, refitted model"
                         : (d.effects.empty() ? "misfit of H_0, final model" : "misfit of H_0, with the effect");
    p.x_label = "frequency / cycles per cycle";
    p.y_label = which == 0 ? "|measured - model| / its standard error" : "";
    for (std::size_t o = 0; o < d.output_names.size(); ++o) {
      Curve c{plain(d.output_names[o]),
              o == 0 ? "points pt 7 ps 0.5 lc rgb '#2471a3'" : "points pt 6 ps 0.5 lc rgb '#d68910'",
              {}};
      for (const Response1& r : d.responses) {
        if (r.m != 0 || r.output != o) continue;
        const double* model = which == 0 ? r.refit : r.after;
        c.points.emplace_back(r.f, std::hypot(r.measured[0] - model[0], r.measured[1] - model[1]) / r.sigma);
      }
      p.curves.push_back(std::move(c));
    }
    p.curves.push_back({"95 % of noise below",
                        "lines dt 2 lc rgb '#999999'",
                        {{0.0, std::sqrt(-std::log(0.05))}, {10.0, std::sqrt(-std::log(0.05))}}});
    double top = 4.0;
    for (const Response1& r : d.responses) {
      if (r.m == 0) top = std::max(top, std::hypot(r.measured[0] - r.refit[0], r.measured[1] - r.refit[1]) / r.sigma);
    }
    p.settings = format("set yrange [0:%.3g]\nset key top right", 1.1 * top);
    figure.panels.push_back(std::move(p));
  }
  return all + drawn(figure);
}

std::string profile_figure(const Diagnosis& d) {
  if (d.profiles.empty()) return "";
  Figure figure;
  figure.columns = static_cast<int>(std::min<std::size_t>(3, d.profiles.size()));
  figure.width = 1000;
  figure.height = 300;
  for (const Profile& q : d.profiles) {
    Panel p;
    p.title = format("missing force at %s (explains %.0f of chi^2)", plain(q.port).c_str(), q.explained);
    p.x_label = "phase of the cycle";
    p.y_label = "force / " + q.unit;
    Curve force{"", "linespoints lc rgb '#1e8449' pt 7 ps 0.5", {}}, up{"", "lines lc rgb '#a9dfbf'", {}}, down = up;
    for (std::size_t i = 0; i <= q.force.size(); ++i) {
      const std::size_t k = i % q.force.size();
      const double x = static_cast<double>(i) / static_cast<double>(q.force.size());
      force.points.emplace_back(x, q.force[k]);
      up.points.emplace_back(x, q.force[k] + 1.96 * q.error[k]);
      down.points.emplace_back(x, q.force[k] - 1.96 * q.error[k]);
    }
    p.curves = {up, down, force, {"", "lines lc rgb '#bbbbbb'", {{0.0, 0.0}, {1.0, 0.0}}}};
    figure.panels.push_back(std::move(p));
  }
  return drawn(figure);
}

// By port, over the phases at which parameters do not imitate such a force.
std::string limits_of_bumps(const Diagnosis& d) {
  std::vector<std::string> ports;
  for (const Profile& q : d.profiles) {
    double least = std::numeric_limits<double>::infinity(), most = 0.0;
    for (const double limit : q.limit) {
      if (!(limit > 0.0)) continue;
      least = std::min(least, limit);
      most = std::max(most, limit);
    }
    if (most > 0.0)
      ports.push_back(format("%.2g to %.2g %s at %s", least, most, q.unit.c_str(), escaped(q.port).c_str()));
  }
  return listed(ports);
}

std::string self_paced_section(const Diagnosis& d) {
  std::string h =
      "<h2>Free runs</h2>\n<p>Each run starts where the record is, is driven as recorded and left alone; what the "
      "model then predicts is held "
      "against the measurement. Nothing of a run but its first samples was used to predict it.</p>\n" +
      free_run_table(d);
  for (const Figure& f : free_run_figures(d)) h += drawn(f);
  if (!d.self_paced.steps.empty()) {
    h +=
        "<h2>How each effect earned its place</h2>\n<p>No model of a real machine is true down to its sensors' noise, "
        "so nothing is tested against that. "
        "What is left of the measurement is correlated in time: " +
        format(
            "%.0f independent numbers in all. An effect is taken when it gains more than %.0f in likelihood against "
            "that, half of it more for every effect found before, ",
            d.self_paced.independent, d.threshold * d.threshold) +
        "and when, fitted on part of the data, it leaves at most 93 % of the error of predicting the rest (the "
        "geometric mean over the parts left out in turn) and most parts are predicted better. Two that hide each other "
        "are tried together, each against the other alone. Of laws of one port that gain at "
        "least three quarters as much, the one is taken whose free runs over the fitted part are off the least, by a "
        "tenth or more.</p>\n" +
        step_table(d);
  }
  return h;
}

const char* const style = R"(<style>
body{font:15px/1.5 system-ui,"DejaVu Sans",sans-serif;color:#222;max-width:1040px;margin:2em auto;padding:0 1em}
h1{font-size:1.5em;margin-bottom:.2em}h2{font-size:1.15em;margin-top:2em;border-bottom:1px solid #ddd;padding-bottom:.2em}
table{border-collapse:collapse;margin:.6em 0;width:100%}th,td{padding:.25em .7em;text-align:right;border-bottom:1px solid #eee}
th{background:#f6f6f6;font-weight:600}th:first-child,td:first-child{text-align:left}td.t{text-align:left;color:#666}
.verdict{padding:.8em 1.1em;border-left:6px solid #888;background:#f7f7f7;margin:1em 0}.verdict b{font-size:1.2em}
.effect_found{border-color:#2471a3}.no_discrepancy,.parameters_only{border-color:#1e8449}.ambiguous{border-color:#d68910}.unexplained{border-color:#c0392b}
.big{font-size:1.6em;font-weight:600}figure{margin:1em 0}svg{max-width:100%;height:auto}.muted{color:#666}tr.chosen td{background:#eaf2f8;font-weight:600}
</style>)";

const char* words(Verdict v) {
  switch (v) {
    case Verdict::effect_found:
      return "Effect found";
    case Verdict::no_discrepancy:
      return "No discrepancy";
    case Verdict::parameters_only:
      return "Parameters only";
    case Verdict::ambiguous:
      return "Ambiguous";
    case Verdict::unexplained:
      return "Unexplained";
  }
  return "";
}

}  // namespace

std::string write_diagnosis_page(const Diagnosis& d, const std::string& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw std::runtime_error(folder + ": cannot be made; choose a folder that may be written to");
  std::string h =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width\">\n<title>" +
      escaped(d.model) + ": " + words(d.verdict) + "</title>\n" + style + "</head><body>\n";
  h += "<h1>What does the model " + escaped(d.model) + " lack?</h1>\n<p class=\"muted\">Record " + escaped(d.record) +
       "; " +
       (d.self_paced.is
            ? format("%d experiment%s in %d stretches, %d candidates tried.", d.experiments,
                     d.experiments == 1 ? "" : "s", d.self_paced.stretches, d.tried)
            : format("%d experiments, %d repeats, %d candidates tried.", d.experiments, d.repeats, d.tried)) +
       "</p>\n";
  h += "<div class=\"verdict " + name(d.verdict) + "\"><b>" + words(d.verdict) + "</b><br>\n";
  for (const Finding& f : d.effects) {
    h += "<span class=\"big\">" + escaped(f.name) + " = " + number(f.value) + escaped(after_number(f.unit)) +
         "</span><br>95 % between " + number(f.low) + " and " + number(f.high) + ", " + number(std::abs(f.z), "%.0f") +
         " standard errors" + (f.declared == 0.0 ? "" : " from the declared " + number(f.declared)) +
         (std::isfinite(f.phase) ? ", largest at " + number(f.phase, "%.2f") + " of the cycle" : "");
    for (std::size_t i = 0; i < f.ties.size(); ++i) h += (i == 0 ? "; could as well be " : ", ") + escaped(f.ties[i]);
    h += "<br>\n";
  }
  if (d.self_paced.is && !d.self_paced.runs.empty()) h += free_run_headline(d) + "<br>\n";
  if (std::isfinite(d.heldout.after)) {
    h += "Error on held-out data, in units of the noise: <b>" + number(d.heldout.before) + " &rarr; " +
         number(d.heldout.refit) + " &rarr; " + number(d.heldout.after) + "</b> (declared, refitted, " +
         (d.effects.empty() ? "final" : "with the effect") + ")";
  }
  h += "</div>\n<h2>The story</h2>\n<p>";
  for (const std::string& line : d.story) h += escaped(line) + "<br>\n";
  h += "</p>\n";

  h += "<h2>Error before and after</h2>\n<table><tr><th>normalised error, 1 = "
       "noise</th><th>declared</th><th>refitted</th><th>after</th><th>noise floor</th></tr>\n";
  const auto errors = [&](const char* label, const Errors& e) {
    h += std::string("<tr><td>") + label + "</td><td>" + number(e.before) + "</td><td>" + number(e.refit) +
         "</td><td>" + number(e.after) + "</td><td>1</td></tr>\n";
  };
  errors("all data", d.all);
  errors("held-out data", d.heldout);
  for (const OutputError& o : d.outputs) {
    h += "<tr><td>" + escaped(o.name) + ", root mean square [" + escaped(o.unit) + "]</td><td>" + number(o.before) +
         "</td><td>" + number(o.refit) + "</td><td>" + number(o.after) + "</td><td>" + number(o.noise) + "</td></tr>\n";
  }
  h += "</table>\n";
  if (!d.held_out.empty()) {
    h += "<p class=\"muted\">Held out: experiment";
    for (std::size_t i = 0; i < d.held_out.size(); ++i) h += (i == 0 ? " " : ", ") + std::to_string(d.held_out[i]);
    h += ".";
    if (!d.effects.empty() && d.excess_explained > 0.0) {
      h += format(
          " There the effect explains %.1f %% of the excess over the noise that refitting leaves, %.2f %% of the "
          "declared model's.",
          100.0 * d.excess_explained, 100.0 * d.excess_explained_declared);
    } else if (!d.effects.empty() && d.excess_explained_declared > 0.0) {
      h += format(
          " There the effect explains %.2f %% of the excess over the noise that the declared model leaves; refitting "
          "alone leaves too little to tell.",
          100.0 * d.excess_explained_declared);
    }
    h += "</p>\n";
  }
  if (!d.views_after.empty())
    h +=
        "<table><tr><th>is anything left?</th><th>declared</th><th>refitted</th><th>after</th><th>p, after</th></tr>\n";
  for (std::size_t i = 0; i < d.views_after.size() && i < d.views_refit.size() && i < d.views_declared.size(); ++i) {
    h += "<tr><td>" + escaped(d.views_after[i].name) + ", power over that of the noise</td><td>" +
         number(d.views_declared[i].ratio) + "</td><td>" + number(d.views_refit[i].ratio) + "</td><td>" +
         number(d.views_after[i].ratio) + "</td><td>" + number(d.views_after[i].p, "%.2g") + "</td></tr>\n";
  }
  if (!d.views_after.empty()) h += "</table>\n";
  h += residual_figure(d);
  if (d.self_paced.is) h += self_paced_section(d);

  const std::string profile = profile_figure(d);
  if (!profile.empty()) {
    h += "<h2>Where the force is missing</h2>\n<p>The force at each port, over the cycle, that the refitted model's "
         "residual asks for, with its 95 % band.";
    if (d.where.known) {
      h += format(" Largest at <b>%s</b>, chart <b>%s</b>, between %.2f and %.2f of the cycle.",
                  escaped(d.where.port).c_str(), escaped(d.where.chart).c_str(), d.where.from, d.where.to);
    }
    const std::string limits = limits_of_bumps(d);
    if (!limits.empty()) h += " Of a force at one phase alone, the least that would be seen is " + limits + ".";
    h += "</p>\n" + profile;
  }
  const std::string response = response_figure(d);
  if (!response.empty()) h += "<h2>Harmonic transfer functions</h2>\n" + response;

  h += "<h2>Candidates</h2>\n<p class=\"muted\">z: score after refitting everything declared; significant beyond " +
       number(d.threshold, "%.2f") +
       " (all candidates together, 1 % false alarms). Kept: share of the signature that parameters and starts cannot "
       "imitate. BIC: against the "
       "refitted model, negative is "
       "better.</p>\n<table><tr><th>candidate</th><th>z</th><th>estimate</th><th>unit</th><th>BIC</th><th>kept</th>"
       "<th>detection limit</th><th></th></tr>\n";
  for (const CandidateRow& c : d.candidates) {
    const bool chosen =
        std::any_of(d.effects.begin(), d.effects.end(), [&](const Finding& f) { return f.name == c.name; });
    h += std::string("<tr") + (chosen ? " class=\"chosen\"" : "") + "><td>" + escaped(c.name) + "</td><td>" +
         (c.limit > 0.0 ? number(c.z, "%.1f") : "&ndash;") + "</td><td>" +
         (c.limit > 0.0 ? number(c.value, "%.3g") : "&ndash;") + "</td><td class=\"t\">" + escaped(c.unit) +
         "</td><td>" + number(c.bic, "%.0f") + "</td><td>" + number(c.kept, "%.3f") + "</td><td>" +
         (c.limit > 0.0 ? number(c.limit, "%.2g") : "&ndash;") + "</td><td class=\"t\">" + escaped(c.remark) +
         "</td></tr>\n";
  }
  h += "</table>\n";
  if (!d.twins.empty() || !d.rivals.empty()) {
    h += "<h2>What else it could be</h2>\n";
    h +=
        d.self_paced.is
            ? "<p class=\"muted\">Each effect found was exchanged for what looks most like it. BIC below zero: it fits "
              "the fitted part better than what was found; error above 1: fitted on some parts it predicts the others "
              "worse.</p>\n<table><tr><th>rival</th><th>BIC, less that of what was found</th><th>error of predicting "
              "parts not fitted, over that of what was found</th></tr>\n"
            : "<table><tr><th>rival</th><th>BIC above the best</th></tr>\n";
    for (const Rival& r : d.rivals) {
      h += "<tr><td>" + escaped(together(r.names)) + "</td><td>" + number(r.bic, "%.1f") + "</td>" +
           (d.self_paced.is ? "<td>" + number(r.predicted, "%.2f") + "</td>" : std::string()) + "</tr>\n";
    }
    h += "</table>\n<table><tr><th>look alike on this record</th><th>cosine of the signatures</th></tr>\n";
    for (const Twin& t : d.twins) {
      h += "<tr><td>" + escaped(t.first) + " and " + escaped(t.second) + "</td><td>" + number(t.cosine, "%.5f") +
           "</td></tr>\n";
    }
    h += "</table>\n";
    if (!d.separate.empty()) h += "<p>" + escaped(d.separate) + "</p>\n";
  }

  h += "<h2>Parameters</h2>\n<table><tr><th>parameter</th><th>unit</th><th>declared</th><th>tolerance</"
       "th><th>refitted</th><th>&plusmn;</th><th>after</th><th>&plusmn;</th></tr>\n";
  for (const ParameterRow& p : d.parameters) {
    h += "<tr><td>" + escaped(p.name) + "</td><td class=\"t\">" + escaped(p.unit) + "</td><td>" +
         number(p.declared, "%.6g") + "</td><td>" + (p.tolerance > 0.0 ? number(p.tolerance, "%.2g") : "exact") +
         "</td><td>" + number(p.refitted, "%.6g") + "</td><td>" + number(p.refitted_error, "%.2g") + "</td><td>" +
         number(p.with_effect, "%.6g") + "</td><td>" + number(p.with_effect_error, "%.2g") + "</td></tr>\n";
  }
  h += "</table>\n<h2>Data and limits</h2>\n<p>";
  h += format("%zu rows; %zu values missing, %zu left out as outliers, %zu inputs taken from another repeat. ",
              d.quality.rows, d.quality.missing, d.quality.outliers, d.quality.filled_inputs);
  for (std::size_t j = 0; j < d.noise.size(); ++j) {
    h += "Noise of " + escaped(d.output_names[j]) + ": " + number(d.noise[j], "%.3g") + " " +
         escaped(d.output_units[j]) + (d.noise_measured ? ", from the repeats. " : ", from the residual. ");
  }
  h += "</p>\n<ul>\n";
  for (const std::string& n : d.notes) h += "<li>" + escaped(n) + "</li>\n";
  h += "</ul>\n<p class=\"muted\">Time:";
  for (const auto& [what, s] : d.seconds) h += " " + escaped(what) + " " + number(s, "%.1f") + " s;";
  h += "</p>\n</body></html>\n";

  const std::string path = folder + "/index.html";
  std::ofstream out(path, std::ios::binary);
  out << h;
  out.close();
  if (!out) throw std::runtime_error(path + ": cannot be written; choose a folder that may be written to");
  return path;
}

}  // namespace saltus
