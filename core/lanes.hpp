// W doubles side by side, one a lane of the processor's vectors: a scalar that a model may be written in, like Dual.
// Every lane has the bits that the same code gives a double.
//
// What a comparison says may differ from lane to lane, so it is a Mask, which is no bool: a model that branches on a
// value does not compile over lanes, and runs on doubles.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>

#if defined(__AVX__)
#include <immintrin.h>
#elif defined(__SSE2__)
#include <emmintrin.h>
#endif

#include "scalar.hpp"

// A kernel over lanes is one function, all that it calls inlined, so that its numbers stay where they are. Not under a
// sanitizer, which would make it endless.
#define SALTUS_LANE_KERNEL [[gnu::flatten]]
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#undef SALTUS_LANE_KERNEL
#define SALTUS_LANE_KERNEL
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#undef SALTUS_LANE_KERNEL
#define SALTUS_LANE_KERNEL
#endif
#endif

namespace saltus {

namespace lane_wise {
// Doubles in a register. More lanes are several registers, so that nothing is ever passed as a vector that the
// processor does not have.
#if defined(__AVX512F__)
inline constexpr int native = 8;
#elif defined(__AVX__)
inline constexpr int native = 4;
#elif defined(__SSE2__) || defined(__aarch64__)
inline constexpr int native = 2;
#else
inline constexpr int native = 1;
#endif

// T is a 64-bit number.
template <class T, int W>
struct Registers {
  static_assert(W >= 1 && (W & (W - 1)) == 0, "lanes come in powers of two");
  static constexpr int width = std::min(W, native), count = W / width;
  typedef T Wide __attribute__((vector_size(static_cast<std::size_t>(width) * sizeof(T))));
  Wide part[count];

  T operator[](int lane) const noexcept { return part[lane / width][lane % width]; }
  void set(int lane, T x) noexcept { part[lane / width][lane % width] = x; }
};

// r = f(a, b, ...), register by register; no loop, so that the parts stay in registers.
template <int I, class F, class R, class... A>
[[gnu::always_inline]] inline void one(const F& f, R& r, const A&... a) noexcept {
  r.part[I] = f(a.part[I]...);
}
template <class F, class R, class... A, int... I>
[[gnu::always_inline]] inline void each(std::integer_sequence<int, I...>, const F& f, R& r, const A&... a) noexcept {
  (one<I>(f, r, a...), ...);
}
// f(f(first, second), third) ... of the registers.
template <int I = 1, class F, class R>
[[gnu::always_inline]] inline typename R::Wide fold(const F& f, const R& r, const typename R::Wide& so_far) noexcept {
  if constexpr (I == R::count) {
    return so_far;
  } else {
    return fold<I + 1>(f, r, f(so_far, r.part[I]));
  }
}
template <class R, class F, class... A>
[[gnu::always_inline]] inline R map(const F& f, const A&... a) noexcept {
  R r;
  each(std::make_integer_sequence<int, R::count>{}, f, r, a...);
  return r;
}
}  // namespace lane_wise

// Yes, every bit of the lane, or no, none.
template <int W>
struct Mask : lane_wise::Registers<std::int64_t, W> {
  using Wide = typename lane_wise::Registers<std::int64_t, W>::Wide;

  // Lane i as bit i.
  static Mask of(unsigned bits) noexcept {
    Mask r;
    for (int i = 0; i < W; ++i) r.set(i, -static_cast<std::int64_t>(bits >> i & 1));
    return r;
  }
  [[gnu::always_inline]] unsigned bits() const noexcept {
    unsigned r = 0;
    for (int i = 0; i < Mask::count; ++i) r |= of_register(this->part[i]) << (i * Mask::width);
    return r;
  }
  [[gnu::always_inline]] static unsigned of_register(const Wide& m) noexcept {
#if defined(__AVX512F__)
    if constexpr (Mask::width == 8) return _mm512_cmplt_epi64_mask((__m512i)m, _mm512_setzero_si512());
#endif
#if defined(__AVX__)
    if constexpr (Mask::width == 4) return static_cast<unsigned>(_mm256_movemask_pd((__m256d)m));
#endif
#if defined(__SSE2__)
    if constexpr (Mask::width == 2) return static_cast<unsigned>(_mm_movemask_pd((__m128d)m));
#endif
    unsigned r = 0;
    for (int i = 0; i < Mask::width; ++i) r |= static_cast<unsigned>(m[i] & 1) << i;
    return r;
  }

  [[gnu::always_inline]] friend inline Mask operator&(const Mask& a, const Mask& b) noexcept {
    return lane_wise::map<Mask>([](const Wide& x, const Wide& y) { return x & y; }, a, b);
  }
  [[gnu::always_inline]] friend inline Mask operator|(const Mask& a, const Mask& b) noexcept {
    return lane_wise::map<Mask>([](const Wide& x, const Wide& y) { return x | y; }, a, b);
  }
  [[gnu::always_inline]] friend inline Mask operator^(const Mask& a, const Mask& b) noexcept {
    return lane_wise::map<Mask>([](const Wide& x, const Wide& y) { return x ^ y; }, a, b);
  }
  [[gnu::always_inline]] friend inline Mask operator~(const Mask& a) noexcept {
    return lane_wise::map<Mask>([](const Wide& x) { return ~x; }, a);
  }
};

template <int W>
[[gnu::always_inline]] inline bool any(const Mask<W>& m) noexcept {
  using Wide = typename Mask<W>::Wide;
  return Mask<W>::of_register(lane_wise::fold([](const Wide& a, const Wide& b) { return a | b; }, m, m.part[0])) != 0;
}
template <int W>
[[gnu::always_inline]] inline bool all(const Mask<W>& m) noexcept {
  using Wide = typename Mask<W>::Wide;
  return Mask<W>::of_register(lane_wise::fold([](const Wide& a, const Wide& b) { return a & b; }, m, m.part[0])) ==
         (1u << Mask<W>::width) - 1;
}

template <int W>
struct Lanes : lane_wise::Registers<double, W> {
  using Wide = typename lane_wise::Registers<double, W>::Wide;
  using Bits = typename Mask<W>::Wide;

  Lanes() noexcept = default;
  [[gnu::always_inline]] Lanes(double x) noexcept {  // NOLINT(google-explicit-constructor): a constant, in every lane
    *this = lane_wise::map<Lanes>([x]() { return x - Wide{}; });
  }

  // The bits of every lane.
  [[gnu::always_inline]] Mask<W> bits() const noexcept {
    return lane_wise::map<Mask<W>>([](const Wide& x) { return (Bits)x; }, *this);
  }
  [[gnu::always_inline]] static Lanes of(const Mask<W>& bits) noexcept {
    return lane_wise::map<Lanes>([](const Bits& x) { return (Wide)x; }, bits);
  }

  [[gnu::always_inline]] friend inline Lanes operator+(const Lanes& a, const Lanes& b) noexcept {
    return lane_wise::map<Lanes>([](const Wide& x, const Wide& y) { return x + y; }, a, b);
  }
  [[gnu::always_inline]] friend inline Lanes operator-(const Lanes& a, const Lanes& b) noexcept {
    return lane_wise::map<Lanes>([](const Wide& x, const Wide& y) { return x - y; }, a, b);
  }
  [[gnu::always_inline]] friend inline Lanes operator*(const Lanes& a, const Lanes& b) noexcept {
    return lane_wise::map<Lanes>([](const Wide& x, const Wide& y) { return x * y; }, a, b);
  }
  [[gnu::always_inline]] friend inline Lanes operator/(const Lanes& a, const Lanes& b) noexcept {
    return lane_wise::map<Lanes>([](const Wide& x, const Wide& y) { return x / y; }, a, b);
  }
  [[gnu::always_inline]] friend inline Lanes operator-(const Lanes& a) noexcept {
    return lane_wise::map<Lanes>([](const Wide& x) { return -x; }, a);
  }
  [[gnu::always_inline]] friend inline Lanes operator+(const Lanes& a) noexcept { return a; }
  [[gnu::always_inline]] Lanes& operator+=(const Lanes& o) noexcept { return *this = *this + o; }
  [[gnu::always_inline]] Lanes& operator-=(const Lanes& o) noexcept { return *this = *this - o; }
  [[gnu::always_inline]] Lanes& operator*=(const Lanes& o) noexcept { return *this = *this * o; }
  [[gnu::always_inline]] Lanes& operator/=(const Lanes& o) noexcept { return *this = *this / o; }

  [[gnu::always_inline]] friend inline Mask<W> operator<(const Lanes& a, const Lanes& b) noexcept {
    return lane_wise::map<Mask<W>>([](const Wide& x, const Wide& y) { return (Bits)(x < y); }, a, b);
  }
  [[gnu::always_inline]] friend inline Mask<W> operator<=(const Lanes& a, const Lanes& b) noexcept {
    return lane_wise::map<Mask<W>>([](const Wide& x, const Wide& y) { return (Bits)(x <= y); }, a, b);
  }
  [[gnu::always_inline]] friend inline Mask<W> operator>(const Lanes& a, const Lanes& b) noexcept { return b < a; }
  [[gnu::always_inline]] friend inline Mask<W> operator>=(const Lanes& a, const Lanes& b) noexcept { return b <= a; }
  [[gnu::always_inline]] friend inline Mask<W> operator==(const Lanes& a, const Lanes& b) noexcept {
    return lane_wise::map<Mask<W>>([](const Wide& x, const Wide& y) { return (Bits)(x == y); }, a, b);
  }
  [[gnu::always_inline]] friend inline Mask<W> operator!=(const Lanes& a, const Lanes& b) noexcept { return ~(a == b); }
};

// a where m says yes, else b.
template <int W>
[[gnu::always_inline]] inline Lanes<W> select(const Mask<W>& m, const Lanes<W>& a, const Lanes<W>& b) noexcept {
  using Wide = typename Lanes<W>::Wide;
  using Bits = typename Mask<W>::Wide;
  return lane_wise::map<Lanes<W>>(
      [](const Bits& yes, const Wide& x, const Wide& y) { return (Wide)((yes & (Bits)x) | (~yes & (Bits)y)); }, m, a,
      b);
}
template <int N, int W>
[[gnu::always_inline]] inline Vec<N, Lanes<W>> select(const Mask<W>& m, const Vec<N, Lanes<W>>& a,
                                                      const Vec<N, Lanes<W>>& b) noexcept {
  Vec<N, Lanes<W>> r;
  for (int i = 0; i < N; ++i) r[i] = select(m, a[i], b[i]);
  return r;
}

template <int W>
[[gnu::always_inline]] inline Mask<W> finite(const Lanes<W>& x) noexcept {
  return x - x == Lanes<W>(0.0);
}

namespace lane_wise {
// f(x) of doubles, lane by lane.
template <int W, class F, class... A>
[[gnu::noinline]] Lanes<W> one_by_one(const F& f, const Lanes<W>& x, const A&... more) noexcept {
  Lanes<W> r;
  for (int i = 0; i < W; ++i) r.set(i, f(x[i], more[i]...));
  return r;
}

// Whether every lane has the bits of the first: a clock that all share. Zeros are not asked for their signs.
template <int W>
[[gnu::always_inline]] inline bool alike(const Lanes<W>& x) noexcept {
  const double first = x.part[0][0];
  return all(x == Lanes<W>(first)) && first != 0.0;
}

// Sine and cosine of angles that are not too far, or nothing.
template <int W>
struct Circle {
  Lanes<W> sine, cosine;  // of the angle less quarter turns
  Mask<W> quadrant;       // in the last two bits
};
template <int W>
[[gnu::always_inline]] inline Circle<W> circle(const Lanes<W>& x) noexcept {
  const auto t = trigonometry::turned(x, Lanes<W>(0.0));
  return {trigonometry::sine(t.angle, t.rest), trigonometry::cosine(t.angle, t.rest), t.shown.bits()};
}
// The one that a quadrant asks for, with its sign: sine on from `first` quadrants.
template <int W>
[[gnu::always_inline]] inline Lanes<W> in_quadrant(const Circle<W>& p, int first) noexcept {
  using Bits = typename Mask<W>::Wide;
  const Mask<W> at = map<Mask<W>>([first](const Bits& q) { return q + first; }, p.quadrant);
  const Mask<W> odd = map<Mask<W>>([](const Bits& q) { return -(q & 1); }, at);
  const Mask<W> sign = map<Mask<W>>([](const Bits& q) { return (q & 2) << 62; }, at);
  return Lanes<W>::of(select(odd, p.cosine, p.sine).bits() ^ sign);
}
template <int W>
[[gnu::always_inline]] inline bool near(const Lanes<W>& x) noexcept {
  return all(abs(x) <= Lanes<W>(trigonometry::far));
}
}  // namespace lane_wise

template <int W>
[[gnu::always_inline]] inline Lanes<W> abs(const Lanes<W>& x) noexcept {
  using Bits = typename Mask<W>::Wide;
  return Lanes<W>::of(
      lane_wise::map<Mask<W>>([](const Bits& b) { return b & std::numeric_limits<std::int64_t>::max(); }, x.bits()));
}
template <int W>
[[gnu::always_inline]] inline Lanes<W> max(const Lanes<W>& a, const Lanes<W>& b) noexcept {
  return select(a > b, a, b);
}
template <int W>
[[gnu::always_inline]] inline Lanes<W> min(const Lanes<W>& a, const Lanes<W>& b) noexcept {
  return select(a < b, a, b);
}

template <int W>
Lanes<W> sin(const Lanes<W>& x) noexcept {
  if (lane_wise::alike(x)) return sin(x[0]);
  if (!lane_wise::near(x)) return lane_wise::one_by_one([](double v) { return sin(v); }, x);
  return lane_wise::in_quadrant(lane_wise::circle(x), 0);
}
template <int W>
Lanes<W> cos(const Lanes<W>& x) noexcept {
  if (lane_wise::alike(x)) return cos(x[0]);
  if (!lane_wise::near(x)) return lane_wise::one_by_one([](double v) { return cos(v); }, x);
  return lane_wise::in_quadrant(lane_wise::circle(x), 1);
}
template <int W>
OnCircle<Lanes<W>> on_circle(const Lanes<W>& x) noexcept {
  if (!lane_wise::near(x)) return {cos(x), sin(x)};
  const lane_wise::Circle<W> p = lane_wise::circle(x);
  return {lane_wise::in_quadrant(p, 1), lane_wise::in_quadrant(p, 0)};
}

namespace lane_wise {
// 2^n of whole numbers n, -1022 <= n <= 1023.
template <int W>
[[gnu::always_inline]] inline Lanes<W> power_of_two(const Lanes<W>& n) noexcept {
  using Bits = typename Mask<W>::Wide;
  // Added, it shows n + 1023 in the last bits.
  return Lanes<W>::of(map<Mask<W>>([](const Bits& b) { return b << 52; }, (n + (0x1.8p52 + 1023.0)).bits()));
}
}  // namespace lane_wise

template <int W>
Lanes<W> exp(const Lanes<W>& x) noexcept {
  if (!all(abs(x) <= Lanes<W>(700.0))) return lane_wise::one_by_one([](double v) { return exp(v); }, x);
  const auto r = exponential::reduce(x);
  return (1.0 + r.rise) * lane_wise::power_of_two(r.power);
}
template <int W>
Lanes<W> tanh(const Lanes<W>& x) noexcept {
  const Lanes<W> d = abs(x);
  if (!all(d < Lanes<W>(22.0))) return lane_wise::one_by_one([](double v) { return tanh(v); }, x);
  const auto r = exponential::reduce(Lanes<W>(2.0 * d));
  const Lanes<W> scale = lane_wise::power_of_two(r.power);
  const Lanes<W> e = scale * r.rise + (scale - 1.0);
  const Lanes<W> t = select(e > Lanes<W>(2.0), 1.0 - 2.0 / (e + 2.0), e / (e + 2.0));
  return Lanes<W>::of(t.bits() ^ (x.bits() ^ d.bits()));  // the sign of x
}
template <int W>
Lanes<W> sqrt(const Lanes<W>& x) noexcept {
  return lane_wise::one_by_one([](double v) { return std::sqrt(v); }, x);
}
template <int W>
Lanes<W> log(const Lanes<W>& x) noexcept {
  return lane_wise::one_by_one([](double v) { return std::log(v); }, x);
}
template <int W>
Lanes<W> atan2(const Lanes<W>& y, const Lanes<W>& x) noexcept {
  return lane_wise::one_by_one([](double a, double b) { return std::atan2(a, b); }, y, x);
}

}  // namespace saltus

template <int W>
struct Eigen::NumTraits<saltus::Lanes<W>> : Eigen::GenericNumTraits<double> {
  using Real = saltus::Lanes<W>;
  using NonInteger = saltus::Lanes<W>;
  using Nested = saltus::Lanes<W>;
  using Literal = double;
  enum {
    IsComplex = 0,
    IsInteger = 0,
    IsSigned = 1,
    RequireInitialization = 0,
    ReadCost = 1,
    AddCost = 2,
    MulCost = 2
  };
};
template <int W, class Op>
struct Eigen::ScalarBinaryOpTraits<saltus::Lanes<W>, double, Op> {
  using ReturnType = saltus::Lanes<W>;
};
template <int W, class Op>
struct Eigen::ScalarBinaryOpTraits<double, saltus::Lanes<W>, Op> {
  using ReturnType = saltus::Lanes<W>;
};
