// Roots of unity by integer index. Every angle of a periodic experiment is a whole multiple of 2 pi / L, so an integer
// taken modulo L, never a sum of angles, decides where on the circle a sample lies: nothing drifts.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <type_traits>

#include "../linalg.hpp"
#include "../trigonometry.hpp"

namespace saltus {

// x modulo n in 0 ... n - 1, n >= 1.
constexpr std::int64_t wrap(std::int64_t x, std::int64_t n) noexcept {
  const auto short_x = static_cast<std::int32_t>(x), short_n = static_cast<std::int32_t>(n);
  // A division of 32 bits is an instruction where one of 64 is a subroutine.
  const std::int64_t r = short_x == x && short_n == n ? short_x % short_n : x % n;
  return r < 0 ? r + n : r;
}

// e^{i angle}
inline Complex phasor(double angle) noexcept {
  const auto p = on_circle(angle);
  return {p.cos, p.sin};
}

// exp(2 pi i j / n) to within an ulp in each part, 1 <= n < 2^31 (of T = float: 2^24). The index is reduced to the
// first octant as an integer, so quarter turns and mirror images are exact.
template <class T = double>
std::complex<T> root_of_unity(std::int64_t j, std::int64_t n) noexcept {
  static_assert(std::is_same_v<T, double> || std::is_same_v<T, float>);
  std::int64_t t = 8 * wrap(j, n);  // the angle is (pi / 4) t / n
  const bool below = t > 4 * n;
  if (below) t = 8 * n - t;
  const bool left = t > 2 * n;
  if (left) t = 4 * n - t;
  const bool steep = t > n;
  if (steep) t = 2 * n - t;

  constexpr double in_double = 0x1.921fb54442d18p-1, beyond = 0x1.1a62633145c07p-55;  // pi / 4
  constexpr T quarter = static_cast<T>(in_double), quarter_rest = static_cast<T>((in_double - quarter) + beyond);
  const T top = static_cast<T>(static_cast<std::int32_t>(t)), full = static_cast<T>(static_cast<std::int32_t>(n));
  const T r = top / full, r_rest = std::fma(-r, full, top) / full;
  const T angle = quarter * r;
  const T rest = std::fma(quarter, r, -angle) + quarter * r_rest + quarter_rest * r;
  const trigonometry::Reduced<T> reduced{angle, rest, 0};
  const T c = trigonometry::cosine(reduced), s = trigonometry::sine(reduced);

  T x = steep ? s : c, y = steep ? c : s;
  if (t == n) x = y = std::numbers::sqrt2_v<T> / 2;  // the diagonal, where the two could differ by an ulp
  return {left ? -x : x, below ? -y : y};
}

// All of them: exp(2 pi i j / L), j = 0 ... L - 1, with L chosen at run time up to Capacity.
template <int Capacity, class T = double>
class Twiddles {
  static_assert(Capacity >= 1);

 public:
  // False, and nothing changed, unless 1 <= length <= Capacity.
  [[nodiscard]] bool configure(int length) noexcept {
    if (length < 1 || length > Capacity) return false;
    length_ = length;
    for (int j = 0; j < length; ++j) {
      const std::complex<T> w = root_of_unity<T>(j, length);
      cos_[static_cast<std::size_t>(j)] = w.real();
      sin_[static_cast<std::size_t>(j)] = w.imag();
    }
    return true;
  }

  int length() const noexcept { return length_; }

  // cos and sin of 2 pi j / L, 0 <= j < L.
  T cos(int j) const noexcept { return cos_[static_cast<std::size_t>(j)]; }
  T sin(int j) const noexcept { return sin_[static_cast<std::size_t>(j)]; }

  // a b modulo L, for any two integers: the index of exp(2 pi i a b / L).
  int index(std::int64_t a, std::int64_t b) const noexcept {
    return static_cast<int>(wrap(a, length_) * wrap(b, length_) % length_);
  }

  // exp(2 pi i a b / L).
  std::complex<T> operator()(std::int64_t a, std::int64_t b = 1) const noexcept {
    const int j = index(a, b);
    return {cos(j), sin(j)};
  }

 private:
  std::array<T, Capacity> cos_{1};
  std::array<T, Capacity> sin_{};
  int length_ = 1;
};

}  // namespace saltus
