// Several numbers side by side: the number type with which element formulas run in production.
#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <type_traits>
#if defined(__AVX512F__)
#include <immintrin.h>
#endif

namespace undine
{

/// Eight doubles that are added, multiplied, compared together; formulas templated on their number type take
/// it like a double. Comparisons give a `Lanes::Mask`; use `select` and `any` instead of `if`. GCC and Clang
/// vectors: the compiler splits them into what the machine has.
class Lanes
{
public:
  static constexpr int size = 8;
  typedef double Numbers __attribute__((vector_size(size * sizeof(double))));
  typedef std::int64_t Mask __attribute__((vector_size(size * sizeof(std::int64_t)))); ///< −1 true, 0 false

  constexpr Lanes() : x_{} {}
  constexpr Lanes(double all) : x_{all, all, all, all, all, all, all, all} {}
  constexpr Lanes(Numbers x) : x_(x) {}

  double operator[](int k) const { return x_[k]; }
  void set(int k, double value) { x_[k] = value; }
  const Numbers& numbers() const { return x_; }

  Lanes& operator+=(const Lanes& b)
  {
    x_ += b.x_;
    return *this;
  }
  Lanes& operator-=(const Lanes& b)
  {
    x_ -= b.x_;
    return *this;
  }
  Lanes& operator*=(const Lanes& b)
  {
    x_ *= b.x_;
    return *this;
  }
  friend Lanes operator+(const Lanes& a, const Lanes& b) { return a.x_ + b.x_; }
  friend Lanes operator-(const Lanes& a, const Lanes& b) { return a.x_ - b.x_; }
  friend Lanes operator*(const Lanes& a, const Lanes& b) { return a.x_ * b.x_; }
  friend Lanes operator/(const Lanes& a, const Lanes& b) { return a.x_ / b.x_; }
  friend Lanes operator-(const Lanes& a) { return -a.x_; }
  friend Mask operator>(const Lanes& a, const Lanes& b) { return a.x_ > b.x_; }
  friend Mask operator<(const Lanes& a, const Lanes& b) { return a.x_ < b.x_; }
  friend Mask operator<=(const Lanes& a, const Lanes& b) { return a.x_ <= b.x_; }

  friend Lanes select(const Mask& condition, const Lanes& yes, const Lanes& no)
  {
    return condition ? yes.x_ : no.x_;
  }
  friend Lanes sqrt(const Lanes& a) // no builtin for vectors: left alone, GCC takes eight roots one by one
  {
#if defined(__AVX512F__)
    return Numbers(_mm512_sqrt_pd(__m512d(a.x_)));
#else
    Lanes y;
    for (int k = 0; k < size; ++k)
      y.x_[k] = __builtin_sqrt(a.x_[k]);
    return y;
#endif
  }

  /// 1/√a of positive numbers, relative error below 1e-15.
  friend Lanes inverse_sqrt(const Lanes& a)
  {
#if defined(__AVX512F__) // y of 14 bits, e = 1 − a y²: y (1 − e)^(−½) by its series; a third of root and
                         // division
    const Numbers y(_mm512_rsqrt14_pd(__m512d(a.x_))), e = 1.0 - a.x_ * y * y;
    return y + y * e * (0.5 + e * (0.375 + e * 0.3125));
#else
    return Lanes(1.0) / sqrt(a);
#endif
  }

private:
  Numbers x_;
};

inline double inverse_sqrt(double a) { return 1.0 / std::sqrt(a); }
inline bool any(bool condition) { return condition; }
inline bool any(const Lanes::Mask& condition)
{
#if defined(__AVX512F__)
  return _mm512_test_epi64_mask(__m512i(condition), __m512i(condition)) != 0;
#else
  const auto four = __builtin_shufflevector(condition, condition, 0, 1, 2, 3) |
                    __builtin_shufflevector(condition, condition, 4, 5, 6, 7);
  const auto two = __builtin_shufflevector(four, four, 0, 1) | __builtin_shufflevector(four, four, 2, 3);
  return (two[0] | two[1]) != 0;
#endif
}
/// condition ? yes : no, for numbers that may be Lanes.
inline double select(bool condition, double yes, double no) { return condition ? yes : no; }

/// The second where one is not a number.
inline Lanes max(const Lanes& a, const Lanes& b)
{
#if defined(__AVX512F__) // GCC sees one instruction in this and not in the comparison
  return Lanes::Numbers(_mm512_max_pd(__m512d(a.numbers()), __m512d(b.numbers())));
#else
  return select(a > b, a, b);
#endif
}
inline Lanes min(const Lanes& a, const Lanes& b)
{
#if defined(__AVX512F__)
  return Lanes::Numbers(_mm512_min_pd(__m512d(a.numbers()), __m512d(b.numbers())));
#else
  return select(a < b, a, b);
#endif
}
inline Lanes abs(const Lanes& a)
{
  return reinterpret_cast<Lanes::Numbers>(reinterpret_cast<Lanes::Mask>(a.numbers()) & INT64_MAX);
}

/// `count` ≤ 8 numbers from memory; lanes beyond them repeat the first.
inline Lanes load_lanes(const double* from, int count)
{
  if (count == Lanes::size)
  {
    Lanes::Numbers x;
    __builtin_memcpy(&x, from, sizeof x);
    return x;
  }
  Lanes x(from[0]);
  for (int k = 1; k < count; ++k)
    x.set(k, from[k]);
  return x;
}
/// The first `count` ≤ 8 lanes to memory.
inline void store_lanes(const Lanes& x, double* to, int count)
{
  if (count == Lanes::size)
    __builtin_memcpy(to, &x.numbers(), sizeof x.numbers());
  else
    for (int k = 0; k < count; ++k)
      to[k] = x[k];
}

/// Eight pairs of numbers become two columns: lane e of a and b is from[e][0] and from[e][1].
inline void load_pairs(const double* const (&from)[Lanes::size], Lanes& a, Lanes& b)
{
#if defined(__AVX512F__)
  const auto four = [&from](int e) // pairs e, e + 2, e + 4, e + 6, straight from memory
  {
    __m512d p = _mm512_castpd128_pd512(_mm_loadu_pd(from[e]));
    p = _mm512_mask_broadcast_f64x2(p, 0x0c, _mm_loadu_pd(from[e + 2]));
    p = _mm512_mask_broadcast_f64x2(p, 0x30, _mm_loadu_pd(from[e + 4]));
    return Lanes::Numbers(_mm512_mask_broadcast_f64x2(p, 0xc0, _mm_loadu_pd(from[e + 6])));
  };
#else
  typedef double Two __attribute__((vector_size(2 * sizeof(double))));
  const auto join = [](const double* p, const double* q)
  {
    Two two[2];
    __builtin_memcpy(&two[0], p, sizeof two[0]);
    __builtin_memcpy(&two[1], q, sizeof two[1]);
    return __builtin_shufflevector(two[0], two[1], 0, 1, 2, 3);
  };
  const auto four = [&](int e) -> Lanes::Numbers
  {
    return __builtin_shufflevector(join(from[e], from[e + 2]), join(from[e + 4], from[e + 6]), 0, 1, 2, 3, 4,
                                   5, 6, 7);
  };
#endif
  const Lanes::Numbers even = four(0), odd = four(1);
  a = __builtin_shufflevector(even, odd, 0, 8, 2, 10, 4, 12, 6, 14);
  b = __builtin_shufflevector(even, odd, 1, 9, 3, 11, 5, 13, 7, 15);
}

/// Four numbers that are loaded, added, stored together.
typedef double FourNumbers __attribute__((vector_size(4 * sizeof(double))));

/// Eight rows of four numbers, two and two: in registers, where rows and columns turn into each other.
class EightRows
{
public:
  /// Rows in memory, aligned to 32 bytes.
  explicit EightRows(const double* const (&row)[Lanes::size])
  {
    const auto join = [&row](int e, int f) -> Lanes
    {
      const auto &first = *reinterpret_cast<const FourNumbers*>(row[e]),
                 &second = *reinterpret_cast<const FourNumbers*>(row[f]);
#if defined(__AVX512F__) // the second straight from memory: GCC would load it and shuffle
      return Lanes::Numbers(_mm512_insertf64x4(_mm512_castpd256_pd512(__m256d(first)), __m256d(second), 1));
#else
      return Lanes::Numbers(__builtin_shufflevector(first, second, 0, 1, 2, 3, 4, 5, 6, 7));
#endif
    };
    two_[0] = join(0, 2);
    two_[1] = join(1, 3);
    two_[2] = join(4, 6);
    two_[3] = join(5, 7);
  }
  /// Row e is lane e of the four columns.
  explicit EightRows(const Lanes (&column)[4])
  {
    using Eight = Lanes::Numbers;
    const Eight &a = column[0].numbers(), &b = column[1].numbers(), &c = column[2].numbers(),
                &d = column[3].numbers();
    const Eight ab = __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14),
                AB = __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15),
                cd = __builtin_shufflevector(c, d, 0, 8, 2, 10, 4, 12, 6, 14),
                CD = __builtin_shufflevector(c, d, 1, 9, 3, 11, 5, 13, 7, 15);
    two_[0] = Eight(__builtin_shufflevector(ab, cd, 0, 1, 8, 9, 2, 3, 10, 11));
    two_[1] = Eight(__builtin_shufflevector(AB, CD, 0, 1, 8, 9, 2, 3, 10, 11));
    two_[2] = Eight(__builtin_shufflevector(ab, cd, 4, 5, 12, 13, 6, 7, 14, 15));
    two_[3] = Eight(__builtin_shufflevector(AB, CD, 4, 5, 12, 13, 6, 7, 14, 15));
  }
  /// Every row, number by number, becomes f(row, other row).
  template <class F>
  void combine(const EightRows& other, F&& f)
  {
    for (std::size_t k = 0; k < 4; ++k)
      two_[k] = f(two_[k], other.two_[k]);
  }
  EightRows& operator+=(const EightRows& other)
  {
    combine(other, [](const Lanes& a, const Lanes& b) { return a + b; });
    return *this;
  }
  EightRows& operator-=(const EightRows& other)
  {
    combine(other, [](const Lanes& a, const Lanes& b) { return a - b; });
    return *this;
  }

  /// Row e, without a way through memory.
  template <std::size_t e>
  FourNumbers row() const
  {
    const Lanes::Numbers& two = two_[e / 4 * 2 + e % 2].numbers();
    if constexpr (e / 2 % 2 == 0)
      return __builtin_shufflevector(two, two, 0, 1, 2, 3);
    else
      return __builtin_shufflevector(two, two, 4, 5, 6, 7);
  }
  /// Lane e of column[k] is number k of row e.
  void columns(Lanes* column) const
  {
    using Eight = Lanes::Numbers;
    const Eight &a = two_[0].numbers(), &b = two_[1].numbers(), &c = two_[2].numbers(),
                &d = two_[3].numbers();
    const Eight ab = __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14),
                cd = __builtin_shufflevector(c, d, 0, 8, 2, 10, 4, 12, 6, 14),
                AB = __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15),
                CD = __builtin_shufflevector(c, d, 1, 9, 3, 11, 5, 13, 7, 15);
    column[0] = Eight(__builtin_shufflevector(ab, cd, 0, 1, 4, 5, 8, 9, 12, 13));
    column[1] = Eight(__builtin_shufflevector(AB, CD, 0, 1, 4, 5, 8, 9, 12, 13));
    column[2] = Eight(__builtin_shufflevector(ab, cd, 2, 3, 6, 7, 10, 11, 14, 15));
    column[3] = Eight(__builtin_shufflevector(AB, CD, 2, 3, 6, 7, 10, 11, 14, 15));
  }
  /// The first of the columns.
  Lanes first_column() const
  {
    using Eight = Lanes::Numbers;
    const Eight lower =
                    __builtin_shufflevector(two_[0].numbers(), two_[1].numbers(), 0, 8, 4, 12, 0, 8, 4, 12),
                upper =
                    __builtin_shufflevector(two_[2].numbers(), two_[3].numbers(), 0, 8, 4, 12, 0, 8, 4, 12);
    return Eight(__builtin_shufflevector(lower, upper, 0, 1, 2, 3, 12, 13, 14, 15));
  }

private:
  Lanes two_[4]; ///< rows 0, 2; 1, 3; 4, 6; 5, 7
};

/// ln(1 + x), x > −1, relative error below 2e-16 · 2 (the polynomial is that of fdlibm's e_log.c). NaN for x
/// < −1.
inline Lanes log1p(const Lanes& x)
{
  using Bits = Lanes::Mask;
  const Lanes::Numbers J = x.numbers() + 1.0;
  // J = 2^k m with m in [√½, √2): shift the bits so that the exponent field of √½ falls on 0.
  const Bits bits = reinterpret_cast<Bits>(J);
  const Bits shifted = bits - 0x3fe6a09e667f3bcdLL;
  const Bits k = shifted >> 52;
  const Lanes::Numbers m = reinterpret_cast<Lanes::Numbers>(bits - (k << 52));
  const Lanes::Numbers exponent = __builtin_convertvector(k, Lanes::Numbers);
  const Lanes::Numbers f = (k == 0) ? x.numbers() : m - 1.0; // x itself keeps the digits of small x
  const Lanes::Numbers s = f / (2.0 + f), z = s * s;
  const Lanes::Numbers R =
      z * (6.666666666666735130e-01 +
           z * (3.999999999940941908e-01 +
                z * (2.857142874366239149e-01 +
                     z * (2.222219843214978396e-01 +
                          z * (1.818357216161805012e-01 +
                               z * (1.531383769920937332e-01 + z * 1.479819860511658591e-01))))));
  const Lanes::Numbers value = exponent * 0.693147180559945309417232 + (f - s * (f - R));
  return (J > 0.0) ? value : Lanes::Numbers{} * 0.0 + __builtin_nan("");
}

/// eˣ − 1 without cancellation at small x; relative error below 1e-15 for |x| < 20.
inline Lanes expm1(const Lanes& x)
{
  using Bits = Lanes::Mask;
  // x = n ln 2 + r, |r| ≤ ½ ln 2;  e^r − 1 by its series, eˣ − 1 = 2ⁿ (e^r − 1) + (2ⁿ − 1).
  const Lanes::Numbers scaled = x.numbers() * 1.442695040888963407;
  const Lanes::Numbers shift = Lanes(6755399441055744.0).numbers(); // 1.5 · 2⁵²: adding it rounds to integers
  const Lanes::Numbers n = (scaled + shift) - shift;
  const Lanes::Numbers r = (x.numbers() - n * 6.93147180369123816490e-01) - n * 1.90821492927058770002e-10;
  Lanes::Numbers p = Lanes(1.0 / 6227020800.0).numbers(); // 1/13!
  for (const double inverse_factorial :
       {1.0 / 479001600.0, 1.0 / 39916800.0, 1.0 / 3628800.0, 1.0 / 362880.0, 1.0 / 40320.0, 1.0 / 5040.0,
        1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5})
    p = p * r + inverse_factorial;
  const Lanes::Numbers small = r + r * r * p;
  const Bits integer = __builtin_convertvector(n, Bits);
  const Lanes::Numbers power = reinterpret_cast<Lanes::Numbers>((integer + 1023) << 52);
  return power * small + (power - 1.0);
}

template <class Real>
constexpr int lanes_of = std::is_same_v<Real, Lanes> ? Lanes::size : 1;

/// Lane `k` of a number that may be a plain double.
inline double lane(double x, int) { return x; }
inline double lane(const Lanes& x, int k) { return x[k]; }
inline void set_lane(double& x, int, double value) { x = value; }
inline void set_lane(Lanes& x, int k, double value) { x.set(k, value); }
inline bool lane(bool x, int) { return x; }
inline bool lane(const Lanes::Mask& x, int k) { return x[k] != 0; }

} // namespace undine
