// saltus identify MODEL --distortion: one odd stimulus, and what its silent lines show.
#include <cstdio>
#include <memory>

#include "../distortion.hpp"
#include "identify.hpp"

namespace saltus::program {
namespace {

nlohmann::json json_of(const DistortionLevel& level) {
  return {{"lines", level.lines()},
          {"rms", level.rms()},
          {"sigma", level.noise() > 0.0 ? nlohmann::json(level.sigma()) : nlohmann::json(nullptr)},
          {"noise", level.noise()},
          {"chance", level.chance()}};
}

void print(const char* output, const char* l, double excited, const DistortionLevel& even, const DistortionLevel& odd) {
  std::printf("  %-8s%-6s%12s", output, l, excited > 0.0 ? number(excited, "%.4g").c_str() : "");
  for (const DistortionLevel* d : {&even, &odd}) {
    std::printf("%12s%12s%10s", number(d->rms(), "%.3g").c_str(), number(d->noise(), "%.2g").c_str(),
                number(d->chance(), "%.1g").c_str());
  }
  std::printf("\n");
}

template <class M, class Family>
void measure(const M& m, const Family& family, const IdentifyOptions& o, const Multisine<max_tones>& stimulus,
             int experiment_tones, bool quiet) {
  const Distortion seen = measure_distortion(m, family, stimulus, o.plan.period, o.campaign);
  if (!usable(seen.status)) {
    throw RunError(std::string(M::name) + ": the machine gave no steady response (" + std::string(name(seen.status)) +
                   "); lower --amplitude");
  }
  nlohmann::json json{{"model", M::name},
                      {"sections", name_of(family)},
                      {"stimulus_period_cycles", o.plan.period},
                      {"amplitude", o.plan.amplitude},
                      {"tones", experiment_tones},
                      {"distortion", nlohmann::json::array()},
                      {"outputs", nlohmann::json::object()}};
  for (const HarmonicDistortion& h : seen.harmonics) {
    json["distortion"].push_back({{"l", h.l},
                                  {"output", M::outputs[static_cast<std::size_t>(h.output)].name},
                                  {"excited", h.excited},
                                  {"even", json_of(h.even)},
                                  {"odd", json_of(h.odd)}});
  }
  for (int c = 0; c < output_count<M>; ++c) {
    const auto i = static_cast<std::size_t>(c);
    json["outputs"][std::string(M::outputs[i].name)] = {{"even", json_of(seen.even[i])},
                                                        {"odd", json_of(seen.odd[i])},
                                                        {"even_found", seen.found_even(c)},
                                                        {"odd_found", seen.found_odd(c)}};
  }
  if (!quiet) {
    std::printf("%s, %s: %d odd tones of %g %s; root mean square of a line\n", std::string(M::name).c_str(),
                title_of(family), experiment_tones, o.plan.amplitude, std::string(M::inputs[0].unit).c_str());
    std::printf("  %-8s%-6s%12s%12s%12s%10s%12s%12s%10s\n", "output", "l", "excited", "even order", "noise", "chance",
                "odd order", "noise", "chance");
    for (const HarmonicDistortion& h : seen.harmonics) {
      print(std::string(M::outputs[static_cast<std::size_t>(h.output)].name).c_str(), std::to_string(h.l).c_str(),
            h.excited, h.even, h.odd);
    }
    for (int c = 0; c < output_count<M>; ++c) {
      const auto i = static_cast<std::size_t>(c);
      print(std::string(M::outputs[i].name).c_str(), "all", 0.0, seen.even[i], seen.odd[i]);
    }
    for (int c = 0; c < output_count<M> && !o.campaign.noise.empty(); ++c) {
      const auto i = static_cast<std::size_t>(c);
      std::printf("  %s: distortion of even order %s, of odd order %s\n", std::string(M::outputs[i].name).c_str(),
                  seen.found_even(c) ? "found" : "not found", seen.found_odd(c) ? "found" : "not found");
    }
  }
  if (!o.json.empty()) write_json(o.json, json);
}

}  // namespace

void identify_distortion(const IdentifyOptions& o, bool quiet) {
  DesignOptions design = o.design;
  design.odd = true;
  if (design.detection == 0) design.detection = std::max(1, o.plan.period / 16);
  const Plan plan = plan_of(o.plan, design);
  const Multisine<max_tones>& stimulus = plan.experiments.front();
  with_model(o.model, [&](auto m) {
    using M = decltype(m);
    if constexpr (input_count<M> == 1) {
      o.sections.visit<M>([&](const auto& family) { measure(m, family, o, stimulus, stimulus.tones(), quiet); });
    } else {
      throw UsageError("--distortion: it is of one input, and " + std::string(M::name) + " has several or none");
    }
  });
}

}  // namespace saltus::program
