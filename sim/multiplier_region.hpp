// Floquet multipliers with their confidence regions, from harmonic transfer functions with standard errors.
#pragma once

#include <limits>
#include <vector>

#include "identification.hpp"

namespace saltus {

struct MultiplierRegion {
  Status status = Status::failed;           // missing: without standard errors, the residual's scatter was used
  std::vector<Complex> multipliers;         // by falling modulus, conjugates +i first
  std::vector<Eigen::Matrix2d> covariance;  // of (re, im) of each, by the delta method
  double known = std::numeric_limits<double>::infinity();  // real degrees of freedom of that covariance
  std::vector<std::vector<Complex>> replicates;            // parametric bootstrap: [replicate][multiplier]
  double chi_square = 0.0, freedom = 0.0;                  // of the fit, real numbers; noise known from repeats
  int series = 0;                                          // harmonics times outputs that share the denominator

  double sigma(std::size_t i) const;  // sqrt(E |error|^2)
  // How far the ellipse that holds the true one with probability `level` reaches, in standard deviations of a
  // direction.
  double reach(double level) const;
  // True where z lies inside that ellipse of multiplier i.
  bool holds(std::size_t i, Complex z, double level) const;
  // The same by the bootstrap: inside the ellipse of the replicates' own covariance.
  bool holds_by_bootstrap(std::size_t i, Complex z, double level) const;
};

struct RegionOptions {
  int count = 2;       // non-zero multipliers
  int harmonics = -1;  // H_-harmonics ... H_harmonics at most, of every output, share the poles; -1: all that there are
  int replicates = 0;  // of the bootstrap
  std::uint64_t seed = 1;
};

// All H_m of all outputs of a periodic system of period N are B_m(z) / A(z^N) with one A of degree `count`, whose roots
// are the multipliers, and B of (count + 1) N taps (see ImagePoleFit): real ones for H_0, complex ones for the others,
// which H_m shares with H_-m, for H_-m(-omega) is the conjugate of H_m(omega). The taps are projected out (variable
// projection, Golub & Pereyra 1973, in Kaufman's form), which leaves `count` unknowns for all series together.
// Harmonics that do not stand above the noise (test_harmonics) are left out. Every estimate weighs by its own standard
// error; how the errors of a line go together (Identification::classes) enters the covariance, so that it holds for
// noise that went through the machine too. Fails when there are too few lines.
MultiplierRegion multiplier_region(const Identification& id, int outputs, const RegionOptions& options = {});

// Probability that two independent estimates of one multiplier differ as much as these by chance: the multipliers do
// not depend on the sections (Ankarali & Cowan 2014, VI.C.2), so a small one says that a section or a clock is off.
double agreement(const MultiplierRegion& a, const MultiplierRegion& b, std::size_t i);

}  // namespace saltus
