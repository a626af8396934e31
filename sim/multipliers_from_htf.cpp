#include "multipliers_from_htf.hpp"

#include <numbers>

#include "core/spectrum/fit.hpp"

namespace saltus {
namespace {

std::vector<ResponseSample> response(const Identification& id, int output, bool weighted) {
  std::vector<ResponseSample> r;
  for (const HtfEstimate& h : id.select(0, output)) {
    const double omega = 2.0 * std::numbers::pi * h.line / (static_cast<double>(id.period) * id.sections);
    const bool known = weighted && std::isfinite(h.sigma) && h.sigma > 0.0;
    r.push_back({omega, h.value, known ? 1.0 / (h.sigma * h.sigma) : 1.0});
  }
  return r;
}

template <class Fit>
MultiplierFit report(const Fit& fit, const char* form, int output, const Identification& id,
                     const std::vector<ResponseSample>& samples) {
  MultiplierFit r{form, output, {}, {}, fit.rms, fit.status, {}};
  for (std::size_t i = 0; i < fit.multipliers.size(); ++i) {
    r.multipliers.push_back(fit.multipliers[i]);
    r.sigma.push_back(fit.sigma[i]);
  }
  for (const ResponseSample& s : samples) {
    r.curve.emplace_back(s.omega * id.sections / (2.0 * std::numbers::pi), evaluate(fit, s.omega));
  }
  return r;
}

template <int R>
MultiplierFit image_poles(const Identification& id, int output) {
  const auto samples = response(id, output, true);
  return report(fit_image_poles<32, R>(samples), "image poles", output, id, samples);
}

}  // namespace

MultiplierFit fit_two_poles(const Identification& id, int output) {
  const auto samples = response(id, output, false);
  auto fit = fit_rational<1>(samples);
  for (Complex& m : fit.multipliers) m = std::pow(m, id.sections);
  for (std::size_t i = 0; i < fit.sigma.size(); ++i) {  // d(p^N) = N p^(N-1) dp
    fit.sigma[i] *= id.sections * std::pow(std::abs(fit.poles[i]), id.sections - 1);
  }
  return report(fit, "2 poles, 1 zero", output, id, samples);
}

MultiplierFit fit_image_poles(const Identification& id, int output, int count) {
  const auto lines = static_cast<int>(id.select(0, output).size());
  // Two equations a line; half as many again as there are coefficients, or the fit says nothing about its own error.
  if (id.sections != 32 || count < 1 || count > 4 || 2 * lines < 3 * ((count + 1) * 32 + count)) {
    MultiplierFit r;
    r.form = "image poles";
    r.output = output;
    return r;
  }
  switch (count) {
    case 1:
      return image_poles<1>(id, output);
    case 2:
      return image_poles<2>(id, output);
    case 3:
      return image_poles<3>(id, output);
    default:
      return image_poles<4>(id, output);
  }
}

MultiplierFit best_multipliers(const Identification& id, int outputs, int count) {
  MultiplierFit best;
  double least = std::numeric_limits<double>::infinity();
  const auto consider = [&](const MultiplierFit& fit) {
    if (!usable(fit.status) || fit.sigma.empty() || !(fit.sigma[0] < least)) return;
    least = fit.sigma[0];
    best = fit;
  };
  for (int c = 0; c < outputs; ++c) consider(fit_image_poles(id, c, count));
  if (usable(best.status)) return best;
  // Two poles misfit any periodic system, by more than the noise: the outputs' disagreement says by how much.
  std::vector<MultiplierFit> fits;
  for (int c = 0; c < outputs; ++c) {
    const MultiplierFit fit = fit_two_poles(id, c);
    if (usable(fit.status)) fits.push_back(fit);
  }
  if (fits.empty()) return best;
  best = fits[0];
  for (std::size_t i = 0; i < best.multipliers.size(); ++i) {
    Complex sum = 0.0;
    for (const MultiplierFit& f : fits) sum += f.multipliers[i];
    best.multipliers[i] = sum / static_cast<double>(fits.size());
    double spread = 0.0;
    for (const MultiplierFit& f : fits) spread = std::max(spread, std::abs(f.multipliers[i] - best.multipliers[i]));
    best.sigma[i] = fits.size() > 1 ? std::hypot(spread, best.sigma[i]) : std::numeric_limits<double>::quiet_NaN();
  }
  return best;
}

}  // namespace saltus
