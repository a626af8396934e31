// Planar chains of point masses in Cartesian coordinates: the mechanics of walkers by Newton's law for each mass,
// against their equations in angles.
#pragma once

#include <cmath>
#include <vector>

#include "core/linalg.hpp"

namespace saltus::test {

inline double cross(const Vec<2>& a, const Vec<2>& b) { return a[0] * b[1] - a[1] * b[0]; }

// A point: place [m], velocity [m/s], acceleration [m/s^2].
struct Moving {
  Vec<2> r = Vec<2>::Zero(), v = Vec<2>::Zero(), a = Vec<2>::Zero();

  // The point `length` [m] further along a link at angle q [rad] from the y axis, turning at w, accelerating at z.
  Moving along(double length, double q, double w, double z = 0.0) const {
    const Vec<2> out{std::sin(q), std::cos(q)};
    const Vec<2> across{std::cos(q), -std::sin(q)};
    return {r + length * out, v + length * w * across, a + length * (z * across - w * w * out)};
  }
};

struct Mass {
  double m;  // [kg]
  Moving at;
};
using Masses = std::vector<Mass>;

// [J]
inline double kinetic_energy(const Masses& masses) {
  double e = 0.0;
  for (const Mass& i : masses) e += 0.5 * i.m * i.at.v.squaredNorm();
  return e;
}
// [kg m^2/s], about a point at rest.
inline double angular_momentum(const Masses& masses, const Vec<2>& about) {
  double l = 0.0;
  for (const Mass& i : masses) l += i.m * cross(i.at.r - about, i.at.v);
  return l;
}
// [N m], what a joint at `about` must bear for the masses to move as they do under `gravity` [m/s^2]; 0 for a free one.
inline double torque(const Masses& masses, const Vec<2>& about, const Vec<2>& gravity) {
  double t = 0.0;
  for (const Mass& i : masses) t += i.m * cross(i.at.r - about, i.at.a - gravity);
  return t;
}

}  // namespace saltus::test
