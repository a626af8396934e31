// Roots of unity by integer index. Every angle of a periodic experiment is a whole multiple of 2 pi / L, so an integer
// taken modulo L, never a sum of angles, decides where on the circle a sample lies: nothing drifts.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>

#include "../linalg.hpp"
#include "../trigonometry.hpp"

namespace saltus {

// x modulo n in 0 ... n - 1, n >= 1.
constexpr std::int64_t wrap(std::int64_t x, std::int64_t n) noexcept {
  const std::int64_t r = x % n;
  return r < 0 ? r + n : r;
}

// e^{i angle}
inline Complex phasor(double angle) noexcept {
  const auto p = on_circle(angle);
  return {p.cos, p.sin};
}

// exp(2 pi i j / n) to within an ulp in each part, 1 <= n < 2^31. The index is reduced to the first octant as an
// integer, so quarter turns and mirror images are exact.
inline Complex root_of_unity(std::int64_t j, std::int64_t n) noexcept {
  std::int64_t t = 8 * wrap(j, n);  // the angle is (pi / 4) t / n
  const bool below = t > 4 * n;
  if (below) t = 8 * n - t;
  const bool left = t > 2 * n;
  if (left) t = 4 * n - t;
  const bool steep = t > n;
  if (steep) t = 2 * n - t;

  constexpr double quarter = 0x1.921fb54442d18p-1, quarter_rest = 0x1.1a62633145c07p-55;  // pi / 4 in two parts
  const double top = static_cast<double>(t), full = static_cast<double>(n);
  const double r = top / full, r_rest = std::fma(-r, full, top) / full;
  const double angle = quarter * r;
  const double rest = std::fma(quarter, r, -angle) + quarter * r_rest + quarter_rest * r;
  const trigonometry::Reduced reduced{angle, rest, 0};
  const double c = trigonometry::cosine(reduced), s = trigonometry::sine(reduced);

  double x = steep ? s : c, y = steep ? c : s;
  if (t == n) x = y = 0.5 * std::numbers::sqrt2;  // the diagonal, where the two could differ by an ulp
  return {left ? -x : x, below ? -y : y};
}

// All of them: exp(2 pi i j / L), j = 0 ... L - 1, with L chosen at run time up to Capacity.
template <int Capacity>
class Twiddles {
  static_assert(Capacity >= 1);

 public:
  // False, and nothing changed, unless 1 <= length <= Capacity.
  [[nodiscard]] bool configure(int length) noexcept {
    if (length < 1 || length > Capacity) return false;
    length_ = length;
    for (int j = 0; j < length; ++j) {
      const Complex w = root_of_unity(j, length);
      cos_[static_cast<std::size_t>(j)] = w.real();
      sin_[static_cast<std::size_t>(j)] = w.imag();
    }
    return true;
  }

  int length() const noexcept { return length_; }

  // cos and sin of 2 pi j / L, 0 <= j < L.
  double cos(int j) const noexcept { return cos_[static_cast<std::size_t>(j)]; }
  double sin(int j) const noexcept { return sin_[static_cast<std::size_t>(j)]; }

  // a b modulo L, for any two integers: the index of exp(2 pi i a b / L).
  int index(std::int64_t a, std::int64_t b) const noexcept {
    return static_cast<int>(wrap(a, length_) * wrap(b, length_) % length_);
  }

  // exp(2 pi i a b / L).
  Complex operator()(std::int64_t a, std::int64_t b = 1) const noexcept {
    const int j = index(a, b);
    return {cos(j), sin(j)};
  }

 private:
  std::array<double, Capacity> cos_{1.0};
  std::array<double, Capacity> sin_{};
  int length_ = 1;
};

}  // namespace saltus
