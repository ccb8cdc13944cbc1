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

private:
  Numbers x_;
};

inline bool any(bool condition) { return condition; }
inline bool any(const Lanes::Mask& condition)
{
  const auto four = __builtin_shufflevector(condition, condition, 0, 1, 2, 3) |
                    __builtin_shufflevector(condition, condition, 4, 5, 6, 7);
  const auto two = __builtin_shufflevector(four, four, 0, 1) | __builtin_shufflevector(four, four, 2, 3);
  return (two[0] | two[1]) != 0;
}
/// condition ? yes : no, for numbers that may be Lanes.
inline double select(bool condition, double yes, double no) { return condition ? yes : no; }

inline Lanes max(const Lanes& a, const Lanes& b) { return select(a > b, a, b); }
inline Lanes min(const Lanes& a, const Lanes& b) { return select(a < b, a, b); }
inline Lanes abs(const Lanes& a) { return max(a, -a); }

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
  typedef double Two __attribute__((vector_size(2 * sizeof(double))));
  Two p[8];
  for (int e = 0; e < 8; ++e)
    __builtin_memcpy(&p[e], from[e], sizeof p[e]);
  const auto join = [&](int e, int f) { return __builtin_shufflevector(p[e], p[f], 0, 1, 2, 3); };
  const Lanes::Numbers even = __builtin_shufflevector(join(0, 2), join(4, 6), 0, 1, 2, 3, 4, 5, 6, 7),
                       odd = __builtin_shufflevector(join(1, 3), join(5, 7), 0, 1, 2, 3, 4, 5, 6, 7);
  a = __builtin_shufflevector(even, odd, 0, 8, 2, 10, 4, 12, 6, 14);
  b = __builtin_shufflevector(even, odd, 1, 9, 3, 11, 5, 13, 7, 15);
}

/// Eight rows of eight numbers become columns: lane e of column[k] is row[e][k], k < 8. Rows are aligned to
/// 64 bytes.
inline void load_columns(const double* const (&row)[Lanes::size], Lanes* column)
{
  using Eight = Lanes::Numbers;
  Eight a[8], b[8];
  for (int e = 0; e < 8; ++e)
    a[e] = *reinterpret_cast<const Eight*>(row[e]);
  for (int e = 0; e < 8; e += 2) // pairs of numbers of two rows …
  {
    b[e] = __builtin_shufflevector(a[e], a[e + 1], 0, 8, 2, 10, 4, 12, 6, 14);
    b[e + 1] = __builtin_shufflevector(a[e], a[e + 1], 1, 9, 3, 11, 5, 13, 7, 15);
  }
  for (int e = 0; e < 8; e += 4) // … of four …
    for (int k = 0; k < 2; ++k)
    {
      a[e + k] = __builtin_shufflevector(b[e + k], b[e + k + 2], 0, 1, 8, 9, 4, 5, 12, 13);
      a[e + k + 2] = __builtin_shufflevector(b[e + k], b[e + k + 2], 2, 3, 10, 11, 6, 7, 14, 15);
    }
  for (int k = 0; k < 4; ++k) // … of eight
  {
    column[k] = __builtin_shufflevector(a[k], a[k + 4], 0, 1, 2, 3, 8, 9, 10, 11);
    column[k + 4] = __builtin_shufflevector(a[k], a[k + 4], 4, 5, 6, 7, 12, 13, 14, 15);
  }
}

/// Four numbers that are added together.
typedef double FourNumbers __attribute__((vector_size(4 * sizeof(double))));

/// Four columns become eight rows: row[e][k] is lane e of column k.
inline void store_rows(const Lanes (&column)[4], FourNumbers (&row)[Lanes::size])
{
  using Eight = Lanes::Numbers;
  const Eight c0 = column[0].numbers(), c1 = column[1].numbers(), c2 = column[2].numbers(),
              c3 = column[3].numbers();
  const Eight even01 = __builtin_shufflevector(c0, c1, 0, 8, 2, 10, 4, 12, 6, 14),
              odd01 = __builtin_shufflevector(c0, c1, 1, 9, 3, 11, 5, 13, 7, 15),
              even23 = __builtin_shufflevector(c2, c3, 0, 8, 2, 10, 4, 12, 6, 14),
              odd23 = __builtin_shufflevector(c2, c3, 1, 9, 3, 11, 5, 13, 7, 15);
  row[0] = __builtin_shufflevector(even01, even23, 0, 1, 8, 9);
  row[1] = __builtin_shufflevector(odd01, odd23, 0, 1, 8, 9);
  row[2] = __builtin_shufflevector(even01, even23, 2, 3, 10, 11);
  row[3] = __builtin_shufflevector(odd01, odd23, 2, 3, 10, 11);
  row[4] = __builtin_shufflevector(even01, even23, 4, 5, 12, 13);
  row[5] = __builtin_shufflevector(odd01, odd23, 4, 5, 12, 13);
  row[6] = __builtin_shufflevector(even01, even23, 6, 7, 14, 15);
  row[7] = __builtin_shufflevector(odd01, odd23, 6, 7, 14, 15);
}

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
